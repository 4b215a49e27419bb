"""Sensors and simulators: grids, what chance does, and in which steps values are reported.

P is received power, ln P = ln I - 2 ln(r / 10 m): light spreads with the square of the range and the firmware
multiplies by it again, so that I follows the surface and the noise follows the power.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

WHITE = 0.6
"""Intensity of a white Lambert surface, head on: lobes up to 1.7 times as bright stay below the top."""


class Sensor(NamedTuple):
    """Where beams point, and the steps (0 none) of what is written, by the sensor and by who simulates it."""

    half_turn_rad: float
    top_deg: float
    bottom_deg: float
    intensity_step: float = 0.0
    range_step_m: float = 0.0


SENSORS = {
    "turn": Sensor(np.pi, 3.0, -24.0),
    "front": Sensor(np.pi / 3, 3.0, -22.0),
    "coarse": Sensor(np.pi, 3.0, -24.0, 1 / 255, 0.004),
}


SIMULATORS = ("ideal", "noisy")


@dataclass(frozen=True)
class Chance:
    """What a sensor has of its own in a case where nothing is hidden: shares and standard deviations."""

    gain: float
    speckle: float
    photons: float
    range_sd_m: float
    lost: float


def draw_chance(rng: np.random.Generator) -> Chance:
    return Chance(
        gain=float(np.exp(rng.normal(0, 0.15))),
        speckle=float(rng.uniform(0.02, 0.05)),
        photons=float(rng.uniform(2e4, 6e4)),
        range_sd_m=float(rng.uniform(0.008, 0.015)),
        lost=float(rng.uniform(0.001, 0.004)),
    )


def make_grid(sensor: Sensor, rows: int, columns: int) -> tuple[np.ndarray, np.ndarray]:
    """Azimuths (columns,) of cell centres, falling, and elevations (rows,), top first and denser there; rad."""
    azimuth = sensor.half_turn_rad * (1 - (2 * np.arange(columns) + 1) / columns)
    share = np.linspace(0, 1, rows) ** 1.4
    return azimuth, np.deg2rad(sensor.top_deg + (sensor.bottom_deg - sensor.top_deg) * share)


def photon_noise(power: np.ndarray, chance: Chance, rng: np.random.Generator) -> np.ndarray:
    """Factors of mean 1: gamma variates, whose variance is the speckle's plus one over the photons counted."""
    variance = chance.speckle**2 + 1 / (chance.photons * np.maximum(power, 1e-6))
    variance = np.minimum(variance, 0.25)
    return rng.gamma(1 / variance) * variance


def rounded(value: np.ndarray, step: float) -> np.ndarray:
    return np.round(value / step) * step if step else value


def simulate(
    simulator: str, optics: Sensor, range_m: np.ndarray, intensity: np.ndarray, rng: np.random.Generator
) -> dict[str, np.ndarray]:
    """What a simulator writes of one frame: `ideal` the values themselves, `noisy` as those with noise settings do.

    noisy: intensities 6 % and 0.008 off and in 256 steps, ranges 1.5 cm off, one ray in a hundred lost.
    """
    hit = range_m > 0
    if simulator == "noisy":
        intensity = intensity * (1 + 0.06 * rng.normal(size=hit.shape)) + 0.008 * rng.normal(size=hit.shape)
        intensity = rounded(np.clip(intensity, 0, 1), 1 / 255)
        range_m = range_m + 0.015 * rng.normal(size=hit.shape)
        hit = hit & (rng.random(hit.shape) >= 0.01)
    range_m, intensity = rounded(range_m, optics.range_step_m), rounded(np.clip(intensity, 0, 1), optics.intensity_step)
    return {"range": np.where(hit, range_m, 0), "intensity": np.where(hit, intensity, 0)}
