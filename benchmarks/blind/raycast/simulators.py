"""Errors that the simulated side has of its own; the sensor has the noise and the lattices too, drawn independently."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import gaussian_filter

from benchmarks.blind.raycast.nuisance import Nuisance

UNKNOWN = 0


@dataclass(frozen=True)
class Simulator:
    """All 0 but the texture in a renderer without noise."""

    texture: float = 1.0
    """Share of the materials' texture that it shows."""
    proportional_sd: float = 0.0
    floor_sd: float = 0.0
    """Noise of the intensity, as a share and of full scale."""
    range_sd_m: float = 0.0
    loss: float = 0.0
    levels: int = 0
    """Of the reported intensity; 0: no lattice."""
    range_step_m: float = 0.0
    smooth_sd: float = 0.0
    """Errors in nats that neighbouring rays share; with them the noise of normals leaves the intensity alone."""


SIMULATORS = {
    "ideal": Simulator(),
    "noisy": Simulator(proportional_sd=0.06, floor_sd=0.008, range_sd_m=0.015, loss=0.01, levels=255),
    "rounded": Simulator(levels=255, range_step_m=0.01),
    "network": Simulator(texture=0.5, smooth_sd=0.1),
}


def draw_simulator(name: str, rng: np.random.Generator) -> Simulator:
    """The simulator of a name; `rounded` has ranges in millimetres or centimetres.

    Raises:
        ValueError: no such simulator.
    """
    if name not in SIMULATORS:
        raise ValueError(f"simulator {name!r} is not known; choose one of {', '.join(SIMULATORS)}")
    found = SIMULATORS[name]
    return replace(found, range_step_m=float(rng.choice([0.001, 0.01]))) if found.range_step_m else found


def as_noisy(simulator: Simulator, nuisance: Nuisance) -> Nuisance:
    """A sensor with the statistics of a noisy simulator."""
    if not simulator.loss:
        return nuisance
    s = simulator
    return replace(nuisance, shot_sd=s.proportional_sd, range_sd_m=s.range_sd_m, loss=s.loss)


def rounded(simulator: Simulator, frame: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Range and intensity on the lattices, if there are any."""
    light, r, step = frame["intensity"], frame["range"], simulator.range_step_m
    if simulator.levels:
        light = np.round(light * simulator.levels) / simulator.levels
    if step:
        r = np.where(r > 0, np.maximum(np.round(r / step), 1) * step, 0.0)
    return frame | {"intensity": light, "range": r}


def simulated(
    simulator: Simulator, frame: dict[str, np.ndarray], rng: np.random.Generator, *, full_turn: bool
) -> dict[str, np.ndarray]:
    """A rendered frame as this simulator writes it; a ray that it loses has no class, object nor angle."""
    hit, shape = frame["range"] > 0, frame["range"].shape
    nats = simulator.texture * frame["texture"]
    if simulator.smooth_sd:
        field = gaussian_filter(rng.normal(size=shape), (2, 8), mode=("nearest", "wrap" if full_turn else "nearest"))
        nats = nats + simulator.smooth_sd * field / field.std()
    shade = frame["true_cos"] / np.cos(frame["incidence"]) if simulator.smooth_sd else 1.0
    light = frame["intensity"] * shade * np.exp(nats) * (1 + simulator.proportional_sd * rng.normal(size=shape))
    light = np.clip(light + simulator.floor_sd * rng.normal(size=shape), 0, 1)
    r = frame["range"] + simulator.range_sd_m * rng.normal(size=shape)
    kept = hit & (rng.random(shape) >= simulator.loss) & (r > 0.05)
    out = frame | {"range": np.where(kept, r, 0.0), "intensity": np.where(kept, light, 0.0)}
    for name, empty in (("incidence", 0.0), ("semantic", UNKNOWN), ("instance", 0)):
        out[name] = np.where(hit & ~kept, empty, frame[name])
    return rounded(simulator, out)
