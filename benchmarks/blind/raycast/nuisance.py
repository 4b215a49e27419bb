"""What differs between simulation and sensor although nothing is hidden."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

LEVELS = ("exact", "default", "misspecified")


@dataclass(frozen=True)
class Nuisance:
    """Standard deviations and shares; lengths in m, angles in rad, levels of light in nats."""

    texture_sd: float
    """Of what the renderer knows of the surfaces' texture."""
    detail_sd: float
    """Of what it does not."""
    thing_sd: float
    table_sd: float
    gain: float
    normals_sd_rad: float
    wrong_label: float
    pose_rad: float
    pose_m: float
    shot_sd: float
    range_sd_m: float
    loss: float
    edge_loss: float


def draw_nuisance(rng: np.random.Generator, level: str) -> Nuisance:
    """'exact': exact geometry and the low end of every band; 'default': all of it; 'misspecified': the high end.

    Raises:
        ValueError: no such level.
    """
    if level not in LEVELS:
        raise ValueError(f"nuisance {level!r} is not known; choose one of {', '.join(LEVELS)}")
    low, high = {"exact": (0.0, 0.2), "default": (0.0, 1.0), "misspecified": (0.8, 1.0)}[level]
    geometry = level != "exact"

    def within(least: float, most: float) -> float:
        return least + (most - least) * float(rng.uniform(low, high))

    return Nuisance(
        texture_sd=within(0.05, 0.2),
        detail_sd=within(0.03, 0.12),
        thing_sd=within(0.1, 0.25),
        table_sd=0.2,
        gain=float(rng.normal(0, 0.15)),
        normals_sd_rad=geometry * within(0.01, 0.06),
        wrong_label=geometry * within(0.0, 0.05),
        pose_rad=geometry * within(3e-4, 9e-4),
        pose_m=geometry * within(0.005, 0.02),
        shot_sd=within(0.03, 0.08),
        range_sd_m=within(0.008, 0.02),
        loss=within(0.001, 0.005),
        edge_loss=within(0.002, 0.01),
    )
