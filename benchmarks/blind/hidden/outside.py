"""Disagreements that no entry of the catalogue describes; a right answer gives the channel and a listed covariate."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from benchmarks.blind.hidden.frames import State
from benchmarks.blind.hidden.laws import About
from benchmarks.blind.hidden.plan import Maker, Plan, at, sign_of


class Outside(NamedTuple):
    """A kind from outside: channel, acceptable covariates, nearest catalogue entries, minimal relevant size."""

    make: Maker
    channel: str
    covariates: tuple[str, ...]
    character: str
    near: tuple[str, ...]
    amount: str
    floor: float
    cap: float = np.inf


def _gain(of: Callable) -> Maker:
    def make(amount: float, rng: np.random.Generator, about: About) -> Plan:
        law = of(amount, rng, about)

        def hook(s: State) -> None:
            s.intensity = s.intensity * np.exp(law(s))

        return at("receiver", hook, amount=amount)

    return make


def _bias(of: Callable) -> Maker:
    def make(amount: float, rng: np.random.Generator, about: About) -> Plan:
        law = of(amount, rng, about)

        def hook(s: State) -> None:
            s.bias_m = s.bias_m + np.where(s.hit, law(s), 0.0)

        return at("ranging", hook, amount=amount)

    return make


def _drop(of: Callable) -> Maker:
    def make(amount: float, rng: np.random.Generator, about: About) -> Plan:
        law = of(amount, rng, about)
        return at("detection", lambda s: s.lose(np.clip(law(s), 0, 0.98)), amount=amount)

    return make


def _time_step(amount, rng, about):
    """Gain that steps twice between gain states in the course of the recording."""
    up, down = about.minutes * rng.uniform(0.2, 0.4), about.minutes * rng.uniform(0.6, 0.8)
    size = amount * sign_of(rng)
    return lambda s: size * (up <= s.moment.time_s / 60 < down)


def _scan_step(amount, rng, about):
    """Gain that steps within the scan: the second bank of an analogue-digital converter."""
    share, size = rng.uniform(0.35, 0.65), amount * sign_of(rng)
    return lambda s: size * (s.column >= share * s.hit.shape[1])


def _azimuth_wave(amount, rng, about):
    waves, start = int(rng.integers(3, 9)), rng.uniform(0, 2 * np.pi)
    low, high = about.edge_azimuth
    rate = waves * 2 * np.pi / (high - low)
    return lambda s: amount * np.sin(rate * s.azimuth + start)


def _azimuth_drop(amount, rng, about):
    wave = _azimuth_wave(1.0, rng, about)
    return lambda s: amount * (1 + wave(s))


def _column_parity(amount, rng, about):
    size = amount * sign_of(rng)
    return lambda s: size * (s.column % 2 - 0.5)


def _row_parity(amount: float, rng: np.random.Generator, about: About) -> Plan:
    """An offset (not a gain) on every other row: two readout banks with their own black level."""
    odd = int(rng.integers(2))

    def hook(s: State) -> None:
        s.intensity = np.where(s.hit & (s.row % 2 == odd), s.intensity + amount, s.intensity)

    return at("receiver", hook, amount=amount)


def _hue(amount, rng, about):
    """Gain by the camera's hue: reflectance that follows pigment."""
    turn = rng.uniform(0, 2 * np.pi)

    def law(s: State) -> np.ndarray:
        red, green, blue = (s.rgb[..., k].astype(float) for k in range(3))
        hue = np.arctan2(np.sqrt(3) * (green - blue), 2 * red - green - blue)
        return amount * np.cos(hue - turn)

    return law


def _speed_gain(amount, rng, about):
    size = amount * sign_of(rng)
    return lambda s: size * s.moment.speed_m_s / 10


def _class_bias(amount, rng, about):
    kinds = rng.choice([7, 11, 21, 26], size=2, replace=False)
    size = amount * sign_of(rng)
    return lambda s: np.where(s.semantic == kinds[0], size, np.where(s.semantic == kinds[1], -size, 0.0))


def _range_drop(amount, rng, about):
    period, start = rng.uniform(5, 12), rng.uniform(0, 2 * np.pi)
    return lambda s: amount * (1 + np.sin(2 * np.pi * np.where(s.hit, s.range_m, 0) / period + start))


def _speed_drop(amount, rng, about):
    return lambda s: amount * (s.moment.speed_m_s / 10) ** 2


def _dark_drop(amount, rng, about):
    """Surfaces dark to the camera lose returns."""
    return lambda s: amount * 2 * np.maximum(0, 1 - s.rgb.astype(float).mean(-1) / 128)


AZIMUTH = ("azimuth", "column")
CLASS = ("class", "semantic")
RGB = ("rgb", "hue", "color", "luminance")
TIME = ("time", "frame", "scene", "step")
SPEED = ("speed",)
OUTSIDE = {
    "gain_step_time": Outside(_gain(_time_step), "intensity", TIME, "step", ("emitter_drift",), "nats", 0.12, 1.0),
    "gain_step_scan": Outside(
        _gain(_scan_step), "intensity", (*AZIMUTH, "step", "time"), "step", ("window_contamination",), "nats", 0.06, 1.0
    ),
    "azimuth_periodic_gain": Outside(_gain(_azimuth_wave), "intensity", AZIMUTH, "periodic", (), "nats", 0.05, 0.8),
    "column_parity_gain": Outside(_gain(_column_parity), "intensity", AZIMUTH, "periodic", (), "nats", 0.05, 0.8),
    "row_parity_offset": Outside(
        _row_parity, "intensity", ("row", "elevation"), "periodic", ("beam_gain",), "offset", 0.01, 0.1
    ),
    "hue_gain": Outside(_gain(_hue), "intensity", RGB, "periodic", (), "nats", 0.08, 0.8),
    "speed_gain": Outside(_gain(_speed_gain), "intensity", SPEED, "monotone", (), "nats at 10 m/s", 0.12, 0.8),
    "class_range_bias": Outside(_bias(_class_bias), "range", CLASS, "other", ("range_walk",), "m", 0.02, 0.3),
    "azimuth_periodic_range_bias": Outside(_bias(_azimuth_wave), "range", AZIMUTH, "periodic", (), "m", 0.015, 0.3),
    "azimuth_periodic_drop": Outside(_drop(_azimuth_drop), "drop", AZIMUTH, "periodic", (), "probability", 0.02, 0.45),
    "range_periodic_drop": Outside(_drop(_range_drop), "drop", ("range",), "periodic", (), "probability", 0.02, 0.45),
    "speed_drop": Outside(_drop(_speed_drop), "drop", SPEED, "monotone", (), "probability at 10 m/s", 0.03, 0.25),
    "dark_drop": Outside(_drop(_dark_drop), "drop", RGB, "monotone", ("material_dropout",), "probability", 0.03, 0.4),
}
