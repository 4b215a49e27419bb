"""What is hidden in a case, and what the sensor says of a view."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

import numpy as np

from benchmarks.blind.mitsuba import sensors
from benchmarks.blind.mitsuba.effects import EFFECTS, Plan, Reading, Setting
from benchmarks.blind.mitsuba.render import View
from benchmarks.blind.mitsuba.roughness import rough_gain
from benchmarks.blind.mitsuba.street import VEHICLES

FAINTEST = 1e-4
"""Of white: no surface returns less."""
Light = Callable[[View], tuple[np.ndarray, np.ndarray]]


def hide(
    effect: str, amount: float, views: list[View], rng: np.random.Generator, rows: int, half_turn_rad: float
) -> tuple[Plan, Light]:
    """The plan of an effect, and what sensor and simulator know of the light of a view: (seen, known).

    Three effects are differences of the two. incidence_cosine: the simulator's cosine has too small a power.
    oren_nayar: the world is rough all over, and the simulator has Lambert's law. specular_lobe: of vehicles, it has the
    base alone.
    """
    count = Counter(np.concatenate([v.semantic[v.range_m > 0] for v in views]).tolist())
    classes = tuple(sorted(k for k, n in count.items() if n > 0.01 * count.total()))
    make = EFFECTS[effect].make if effect != "none" else None
    if make:
        return make(amount, Setting(rng, rows, half_turn_rad, classes)), lambda v: (v.true, v.true)
    if effect == "incidence_cosine":
        power = min(1.0, amount)
        return Plan({"exponent": power}), lambda v: (v.true, v.true * np.cos(v.incidence_rad) ** -power)
    if effect == "oren_nayar":
        gain = rough_gain(amount, rng)
        return Plan({"roughness_rad": amount}), lambda v: (v.plain * gain(v.incidence_rad), v.plain)
    if effect == "specular_lobe":
        return Plan({"strength": 4 * amount}), lambda v: (
            v.true,
            np.where(np.isin(v.semantic, VEHICLES), v.plain, v.true),
        )
    return Plan({}), lambda v: (v.true, v.true)


def measure(
    view: View, seen: np.ndarray, azimuth_rad: np.ndarray, plan: Plan, chance: sensors.Chance,
    optics: sensors.Sensor, rng: np.random.Generator,
) -> dict[str, np.ndarray]:  # fmt: skip
    """What the sensor reports of a view."""
    hit = view.range_m > 0
    range_m = np.where(hit, view.range_m, 10.0)
    intensity = sensors.WHITE * chance.gain * np.maximum(seen, FAINTEST)
    shape = hit.shape
    reading = Reading(
        range_m, intensity, intensity / (range_m / 10) ** 2, view.semantic, np.broadcast_to(azimuth_rad, shape),
        np.full(shape, 1 - chance.lost), np.zeros(shape), np.full(shape, chance.range_sd_m),
    )  # fmt: skip
    if plan.light:
        plan.light(reading)
    reading.intensity = reading.intensity * sensors.photon_noise(reading.power, chance, rng)
    if plan.reading:
        plan.reading(reading)
    measured_m = range_m + reading.shift_m + reading.scatter_m * rng.normal(size=shape)
    returned = hit & (rng.random(shape) < reading.keep) & (measured_m > 0.05)
    return {
        "range": np.where(returned, sensors.rounded(measured_m, optics.range_step_m), 0),
        "intensity": np.where(returned, sensors.rounded(np.clip(reading.intensity, 0, 1), optics.intensity_step), 0),
    }
