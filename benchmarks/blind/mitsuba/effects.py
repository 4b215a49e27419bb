"""What may be hidden: each a law of this world's own, and what a finder may rightly answer.

An effect is planned once a case: maker(amount, setting) gives its parameters (in the catalogue's terms where it has
them) and a function that changes a `Reading` before chance acts (`light`) or after (`reading`). Amounts at severity 1
are those of benchmarks/blind/hidden/units.json.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np


@dataclass
class Reading:
    """A frame on its way to being reported, (rows, columns); parts change in place. power: see `sensors`."""

    range_m: np.ndarray
    intensity: np.ndarray
    power: np.ndarray
    semantic: np.ndarray
    azimuth_rad: np.ndarray
    keep: np.ndarray
    shift_m: np.ndarray
    scatter_m: np.ndarray

    def scale(self, factor: np.ndarray | float) -> None:
        self.intensity = self.intensity * factor
        self.power = self.power * factor


class Setting(NamedTuple):
    """What a plan may look at: random numbers, the number of beams, the azimuth of the view's edge, common classes."""

    rng: np.random.Generator
    rows: int
    half_turn_rad: float
    classes: tuple[int, ...]


class Plan(NamedTuple):
    parameters: dict[str, Any]
    light: Callable[[Reading], None] | None = None
    reading: Callable[[Reading], None] | None = None


def range_falloff(amount: float, setting: Setting) -> Plan:
    """The firmware undoes a power of range that is not 2."""
    exponent = amount * setting.rng.choice([-1, 1])

    def light(r: Reading) -> None:
        r.intensity = r.intensity * (r.range_m / 10) ** -exponent

    return Plan({"exponent": float(exponent)}, light)


def atmospheric_extinction(amount: float, setting: Setting) -> Plan:
    """Beer and Lambert, there and back."""
    return Plan({"coefficient_per_m": amount}, lambda r: r.scale(np.exp(-2 * amount * r.range_m)))


def near_range_overlap(amount: float, setting: Setting) -> Plan:
    """The share of the spot that the receiver sees, whose field has twice the spot's radius and lies beside it.

    The centres are k / r radii of the field apart; k is such that the share at `amount` is 1 - 1/e.
    """
    apart = np.linspace(0.5, 1.5, 2001)
    share = _seen(apart, 0.5)
    there = float(np.interp(1 / np.e, 1 - share, apart))

    def light(r: Reading) -> None:
        r.scale(np.maximum(np.interp(there * amount / r.range_m, apart, share), 1e-3))

    return Plan({"distance_m": amount}, light)


def _seen(apart: np.ndarray, radius: float) -> np.ndarray:
    """Share of a disc of that radius within a disc of radius 1 whose centre is `apart` from its own; borders cross."""
    own = np.arccos(np.clip((apart**2 + radius**2 - 1) / (2 * apart * radius), -1, 1))
    other = np.arccos(np.clip((apart**2 + 1 - radius**2) / (2 * apart), -1, 1))
    lens = radius**2 * (own - np.sin(2 * own) / 2) + other - np.sin(2 * other) / 2
    return lens / (np.pi * radius**2)


def window_contamination(amount: float, setting: Setting) -> Plan:
    """A smear with a flat middle dims what passes it, and loses some of it.

    Its profile exp(-|x|³ / 2 w³) is nearest to a Gaussian 1.083 times as high and 0.854 times as wide.
    """
    wide, drop = setting.rng.uniform(0.2, 0.5), setting.rng.uniform(0.2, 0.6)
    middle = setting.rng.uniform(-1, 1) * (setting.half_turn_rad - 0.3)
    loss = min(0.95, amount)

    def light(r: Reading) -> None:
        away = np.abs(np.angle(np.exp(1j * (r.azimuth_rad - middle))))
        stain = loss * np.exp(-0.5 * (away / wide) ** 3)
        r.scale(1 - stain)
        r.keep = r.keep * (1 - drop * stain)

    nearest = {"loss": 1.083 * loss, "azimuth_rad": float(middle), "width_rad": 0.854 * float(wide)}
    return Plan({**nearest, "drop": float(drop)}, light)


def beam_gain(amount: float, setting: Setting) -> Plan:
    gain = _centred(setting, amount)
    return Plan({"gain": gain.tolist()}, lambda r: r.scale(np.exp(gain)[:, None]))


def beam_range_bias(amount: float, setting: Setting) -> Plan:
    bias = _centred(setting, amount)

    def light(r: Reading) -> None:
        r.shift_m = r.shift_m + bias[:, None]

    return Plan({"bias_m": bias.tolist()}, light)


def range_scale(amount: float, setting: Setting) -> Plan:
    """The clock that counts the time of flight runs too fast or too slow."""
    scale = float(amount * setting.rng.choice([-1, 1]))

    def light(r: Reading) -> None:
        r.shift_m = r.shift_m + scale * r.range_m

    return Plan({"scale": scale}, light)


def range_noise(amount: float, setting: Setting) -> Plan:
    """Fewer photons tell the time of a pulse less well; `amount` at ln P = -2."""

    def light(r: Reading) -> None:
        r.scatter_m = np.hypot(r.scatter_m, amount * np.sqrt(np.exp(-2) / np.maximum(r.power, 1e-6)))

    return Plan({"sd_m": amount}, light)


def gamma_response(amount: float, setting: Setting) -> Plan:
    gamma = float(np.exp(amount * setting.rng.choice([-1, -1, -1, 1])))

    def reading(r: Reading) -> None:
        r.intensity = r.intensity**gamma

    return Plan({"gamma": gamma}, reading=reading)


def intensity_quantization(amount: float, setting: Setting) -> Plan:
    def reading(r: Reading) -> None:
        r.intensity = np.round(r.intensity / amount) * amount

    return Plan({"step": amount}, reading=reading)


def random_dropout(amount: float, setting: Setting) -> Plan:
    def light(r: Reading) -> None:
        r.keep = r.keep * (1 - amount)

    return Plan({"probability": amount}, light)


def material_dropout(amount: float, setting: Setting) -> Plan:
    """One class of those that are common loses returns; classes that are not seen have no truth (null)."""
    chosen, lost = int(setting.rng.choice(setting.classes)), min(0.95, amount)

    def light(r: Reading) -> None:
        r.keep = r.keep * np.where(r.semantic == chosen, 1 - lost, 1)

    table = [lost if k == chosen else 0.0 if k in setting.classes else None for k in range(34)]
    return Plan({"probability": table}, light)


def _centred(setting: Setting, sd: float) -> np.ndarray:
    """A number a beam, of mean 0 and that standard deviation."""
    x = setting.rng.normal(size=setting.rows)
    return sd * (x - x.mean()) / x.std()


class Effect(NamedTuple):
    """A row of the vocabulary.

    make: None where surfaces differ (`case`); unit: amount at severity 1; covariates: where it shows; right: the names
    of which any is no mistake, if there are more than its own: a renderer's law is not the catalogue's.
    """

    make: Callable[[float, Setting], Plan] | None
    unit: float
    channels: tuple[str, ...]
    covariates: tuple[str, ...]
    right: tuple[str, ...] = ()


BRIGHT, RANGING, DROP = ("intensity",), ("range",), ("drop",)
FAR, BEAMS, KINDS, LEVELS = ("range", "power"), ("row", "elevation"), ("class", "semantic"), ("intensity", "power")
ANGLE, TURN = ("incidence",), ("azimuth", "column", "heading")
EFFECTS = {
    "incidence_cosine": Effect(None, 0.09, BRIGHT, ANGLE),
    "oren_nayar": Effect(None, 0.12, BRIGHT, ANGLE, ("oren_nayar", "incidence_cosine")),
    "specular_lobe": Effect(None, 0.1, BRIGHT, (*ANGLE, *KINDS)),
    "range_falloff": Effect(range_falloff, 0.09, BRIGHT, FAR),
    "atmospheric_extinction": Effect(atmospheric_extinction, 0.001, BRIGHT, FAR),
    "near_range_overlap": Effect(near_range_overlap, 2.0, BRIGHT, (*FAR, *BEAMS)),
    "window_contamination": Effect(window_contamination, 0.09, ("intensity", "drop"), TURN),
    "beam_gain": Effect(beam_gain, 0.03, BRIGHT, BEAMS),
    "gamma_response": Effect(gamma_response, 0.056, BRIGHT, (*LEVELS, *ANGLE, *KINDS)),
    "intensity_quantization": Effect(intensity_quantization, 0.004, BRIGHT, LEVELS),
    "random_dropout": Effect(random_dropout, 0.0125, DROP, ()),
    "material_dropout": Effect(material_dropout, 0.1, DROP, KINDS),
    "range_noise": Effect(range_noise, 0.0025, RANGING, (*LEVELS, "range")),
    "range_scale": Effect(range_scale, 0.0005, RANGING, ("range",)),
    "beam_range_bias": Effect(beam_range_bias, 0.01, RANGING, BEAMS),
}
