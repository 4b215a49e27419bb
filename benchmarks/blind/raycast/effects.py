"""What can be hidden in this world, in the order in which light meets it; the key states the catalogue's parameters.

Several laws have but one form in the literature and are the catalogue's own (powers of range and cosine, Beer and
Lambert, gains, biases, lattices, losses). Others are not: `oren_nayar` is the full law with interreflections, and
`near_range_overlap` a blurred disc on a detector; their parameters are those of the catalogue's form that fits best.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import minimize_scalar

from benchmarks.blind.raycast.optics import Echoes

Hook = Callable[[Echoes, np.random.Generator], None]
DARKEST = 1e-4


class View(NamedTuple):
    """The surfaces that a case shows: one entry a hit ray, thinned; and the sensor's rows and bounds of azimuth."""

    range_m: np.ndarray
    theta: np.ndarray
    albedo: np.ndarray
    semantic: np.ndarray
    rows: int
    azimuths: tuple[float, float]


Make = Callable[[float, np.random.Generator, View], tuple[Hook, dict[str, Any]]]


class Effect(NamedTuple):
    """stage: when it acts; covariates: where it may rightly be said to show."""

    make: Make
    stage: str
    channels: tuple[str, ...]
    covariates: tuple[str, ...]
    cap: float = np.inf


STAGES = ("light", "receiver", "detection", "ranging")


def _unlike(law: np.ndarray, form: Callable[[float], np.ndarray], most: float) -> float:
    """The parameter of a form that fits a law (nats) best, up to a level."""
    return float(minimize_scalar(lambda p: float(np.var(form(p) - law)), bounds=(1e-3, most), method="bounded").x)


def incidence_cosine(amount: float, rng: np.random.Generator, view: View):
    n = amount * (1 if rng.random() < 0.3 else -1)
    return lambda e, _: e.dim(np.cos(e.theta) ** n), {"exponent": n}


def oren_nayar(amount: float, rng: np.random.Generator, view: View):
    """Oren and Nayar 1994, eq. 30, source and viewer in one direction."""
    s2 = amount**2

    def factor(theta: np.ndarray, albedo: np.ndarray) -> np.ndarray:
        direct = 1 - 0.5 * s2 / (s2 + 0.33) + 0.45 * s2 / (s2 + 0.09) * np.sin(theta) * np.tan(theta)
        return direct + 0.17 * albedo * s2 / (s2 + 0.13) * (1 - (2 * theta / np.pi) ** 2)

    def form(s: float) -> np.ndarray:
        a, b = 1 - 0.5 * s * s / (s * s + 0.33), 0.45 * s * s / (s * s + 0.09)
        return np.log(a + b * np.sin(view.theta) * np.tan(view.theta))

    found = _unlike(np.log(factor(view.theta, view.albedo)), form, 1.3)
    return lambda e, _: e.dim(factor(e.theta, e.albedo)), {"roughness_rad": found}


def range_falloff(amount: float, rng: np.random.Generator, view: View):
    """The firmware multiplies by too small (or too large) a power of range; the power received stays what it was."""
    p = amount * (1 if rng.random() < 0.75 else -1)

    def hook(e: Echoes, _: np.random.Generator) -> None:
        e.intensity = e.intensity * (np.where(e.hit, e.range_m, 10.0) / 10) ** -p

    return hook, {"exponent": p}


def atmospheric_extinction(amount: float, rng: np.random.Generator, view: View):
    return lambda e, _: e.dim(np.exp(-2 * amount * np.where(e.hit, e.range_m, 0))), {"coefficient_per_m": amount}


def near_range_overlap(amount: float, rng: np.random.Generator, view: View):
    """Close by, the image of the spot is a blurred disc larger than the detector, which is not quite sharp either."""
    edges = amount * np.linspace(0.6, 1.5, 10)

    def seen(r: np.ndarray) -> np.ndarray:
        return np.minimum(1, (r[..., None] / edges) ** 2).mean(-1)

    found = _unlike(np.log(seen(view.range_m)), lambda d: np.log(-np.expm1(-((view.range_m / d) ** 2))), 15.0)
    return lambda e, _: e.dim(seen(np.where(e.hit, e.range_m, 10.0))), {"distance_m": found}


def window_contamination(amount: float, rng: np.random.Generator, view: View):
    loss, width, drop = min(amount, 0.95), rng.uniform(0.15, 0.5), rng.uniform(0.2, 0.6)
    low, high = view.azimuths
    middle = rng.uniform(low + 0.25, high - 0.25)

    def hook(e: Echoes, _: np.random.Generator) -> None:
        away = np.angle(np.exp(1j * (e.grid.azimuth - middle)))
        film = loss * np.exp(-0.5 * (away / width) ** 2)[None]
        e.dim(1 - film)
        e.lose(drop * film)

    return hook, {"loss": loss, "azimuth_rad": float(middle), "width_rad": float(width), "drop": float(drop)}


def beam_gain(amount: float, rng: np.random.Generator, view: View):
    gain = _of_beams(rng, view.rows, amount)
    return lambda e, _: e.dim(np.exp(gain)[:, None]), {"gain": gain.tolist()}


def gamma_response(amount: float, rng: np.random.Generator, view: View):
    gamma = float(np.exp(amount * (-1 if rng.random() < 0.8 else 1)))

    def hook(e: Echoes, _: np.random.Generator) -> None:
        e.intensity = np.where(e.hit, np.maximum(e.intensity, DARKEST) ** gamma, 0.0)

    return hook, {"gamma": gamma}


def intensity_quantization(amount: float, rng: np.random.Generator, view: View):
    def hook(e: Echoes, _: np.random.Generator) -> None:
        e.intensity = np.round(np.clip(e.intensity, 0, 1) / amount) * amount

    return hook, {"step": amount}


def random_dropout(amount: float, rng: np.random.Generator, view: View):
    return lambda e, _: e.lose(amount), {"probability": amount}


def material_dropout(amount: float, rng: np.random.Generator, view: View):
    """One or two classes, each with at least a fiftieth of the rays."""
    share = np.bincount(view.semantic, minlength=34)[:34] / len(view.semantic)
    common = np.flatnonzero(share > 0.02)
    probability = np.zeros(34)
    for kind in rng.choice(common, size=min(len(common), int(rng.integers(1, 3))), replace=False):
        probability[kind] = min(0.95, amount * rng.uniform(0.8, 1.2))
    known = [float(p) if s > 0 else None for p, s in zip(probability, share, strict=True)]
    return lambda e, _: e.lose(probability[e.semantic]), {"probability": known}


def range_noise(amount: float, rng: np.random.Generator, view: View):
    """Jitter of the timing, as one over the root of the power; `amount` where ln P = -2."""

    def hook(e: Echoes, _: np.random.Generator) -> None:
        sd = amount * np.exp(-1.0) / np.sqrt(np.maximum(e.power, 1e-6))
        e.sd_m = np.hypot(e.sd_m, np.minimum(sd, 3.0))

    return hook, {"sd_m": amount}


def range_scale(amount: float, rng: np.random.Generator, view: View):
    scale = amount * float(rng.choice([-1, 1]))

    def hook(e: Echoes, _: np.random.Generator) -> None:
        e.bias_m = e.bias_m + scale * np.where(e.hit, e.range_m, 0)

    return hook, {"scale": scale}


def beam_range_bias(amount: float, rng: np.random.Generator, view: View):
    bias = _of_beams(rng, view.rows, amount)

    def hook(e: Echoes, _: np.random.Generator) -> None:
        e.bias_m = e.bias_m + bias[:, None]

    return hook, {"bias_m": bias.tolist()}


def range_quantization(amount: float, rng: np.random.Generator, view: View):
    """The lattice itself is laid on in `case.read_out`, after noise."""
    return lambda e, _: None, {"step_m": amount}


def _of_beams(rng: np.random.Generator, rows: int, sd: float) -> np.ndarray:
    """Values of mean 0 and exactly that standard deviation."""
    x = rng.normal(size=rows)
    x -= x.mean()
    return sd * x / x.std()


LIGHT, DROP, RANGE = ("intensity",), ("drop",), ("range",)
ROWS, FAR = ("row", "elevation"), ("range", "power")
EFFECTS: dict[str, Effect] = {
    "incidence_cosine": Effect(incidence_cosine, "light", LIGHT, ("incidence",), 1.0),
    "oren_nayar": Effect(oren_nayar, "light", LIGHT, ("incidence",), 1.1),
    "range_falloff": Effect(range_falloff, "light", LIGHT, FAR, 2.0),
    "atmospheric_extinction": Effect(atmospheric_extinction, "light", LIGHT, FAR, 0.05),
    "near_range_overlap": Effect(near_range_overlap, "light", LIGHT, (*FAR, *ROWS), 12.0),
    "window_contamination": Effect(
        window_contamination, "light", ("intensity", "drop"), ("azimuth", "column", "heading"), 0.9
    ),
    "beam_gain": Effect(beam_gain, "receiver", LIGHT, ROWS, 0.5),
    "gamma_response": Effect(
        gamma_response, "receiver", LIGHT, ("intensity", "power", "reflectance", "incidence", "class", "semantic"), 0.69
    ),
    "intensity_quantization": Effect(
        intensity_quantization, "receiver", LIGHT, ("intensity", "power", "reflectance"), 0.1
    ),
    "random_dropout": Effect(random_dropout, "detection", DROP, (), 0.9),
    "material_dropout": Effect(material_dropout, "detection", DROP, ("class", "semantic", "instance"), 0.95),
    "range_noise": Effect(range_noise, "ranging", RANGE, ("intensity", "reflectance", *FAR), 0.3),
    "range_scale": Effect(range_scale, "ranging", RANGE, ("range",), 0.02),
    "beam_range_bias": Effect(beam_range_bias, "ranging", RANGE, ROWS, 0.12),
    "range_quantization": Effect(range_quantization, "ranging", RANGE, ("range",), 0.5),
}
