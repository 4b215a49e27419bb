"""Tabulated and waveform-level laws, and the catalogue value that fits each best.

The catalogue's closed forms are what a finder may fit; the sensor here follows tables and integrals instead. A key
states the catalogue's parameters: least squares over the surfaces that the case really contains, with the
nuisances that any finder refits (a level for each law of intensity) left free.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.optimize import least_squares


class About(NamedTuple):
    """The surfaces of a case, from its noise-free simulation; one entry a hit ray, thinned to some ten thousand."""

    range_m: np.ndarray
    theta: np.ndarray
    semantic: np.ndarray
    intensity: np.ndarray  # with the sensor's gain and the true class table
    power: np.ndarray
    row: np.ndarray
    azimuth: np.ndarray
    edge_azimuth: tuple[float, float]
    rows: int
    minutes: float


def table(knots: np.ndarray, values: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """Monotone interpolation of a measured table, level beyond its ends."""
    spline = PchipInterpolator(knots, values)
    return lambda x: spline(np.clip(x, knots[0], knots[-1]))


def fit(model, start: Sequence[float], x: np.ndarray, y: np.ndarray, free_level: bool) -> np.ndarray:
    """Least-squares parameters of model(x, *parameters) to y, with or without a free additive level."""

    def residual(p: np.ndarray) -> np.ndarray:
        d = model(x, *p) - y
        return d - d.mean() if free_level else d

    return least_squares(residual, start, loss="linear").x


def oren_nayar_facets(roughness_rad: float, knots: int = 24) -> Callable[[np.ndarray], np.ndarray]:
    """Retro-reflected light over cosine: V-cavities of Gaussian slopes, their facets integrated numerically.

    A facet of slope a and azimuth q sees the beam at cos i = cos θ cos a + sin θ sin a cos q; it is lit and seen
    with the same weight, and shadowed by G = min(1, 2 cos a cos θ / cos i) (Torrance and Sparrow's cavity).
    """
    theta = np.linspace(0, np.deg2rad(89), knots)[:, None, None]
    a = np.linspace(0, np.pi / 2 * 0.96, 61)[None, :, None]
    q = ((np.arange(36) + 0.5) * 2 * np.pi / 36)[None, None]
    density = np.exp(-0.5 * (a / max(roughness_rad, 1e-3)) ** 2) * np.sin(np.maximum(a, 1e-3))
    cos_i = np.maximum(np.cos(theta) * np.cos(a) + np.sin(theta) * np.sin(a) * np.cos(q), 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        shadow = np.minimum(1, np.where(cos_i > 0, 2 * np.cos(a) * np.cos(theta) / cos_i, 0))
    light = (density * cos_i**2 * shadow / np.cos(a)).sum((1, 2)) / (density * np.ones_like(q)).sum((1, 2))
    ratio = light / np.cos(theta[:, 0, 0]) ** 2
    return table(theta[:, 0, 0], ratio / ratio[0])


def oren_nayar_formula(theta: np.ndarray, s: float) -> np.ndarray:
    """The catalogue's qualitative form, in nats."""
    a, b = 1 - 0.5 * s * s / (s * s + 0.33), 0.45 * s * s / (s * s + 0.09)
    return np.log(np.maximum(a + b * np.sin(theta) * np.tan(theta), 1e-6))


def foggy_transmission(coefficient_per_m: float) -> Callable[[np.ndarray], np.ndarray]:
    """Two-way transmission of a pulse whose band and aerosol mix see three coefficients, 0.85 to 1.15 of the mean."""
    parts = coefficient_per_m * np.array([0.85, 1.0, 1.15])
    return lambda r: np.exp(-2 * parts[:, None] * np.ravel(r)[None]).mean(0).reshape(np.shape(r))


def defocus(distance_m: float) -> Callable[[np.ndarray], np.ndarray]:
    """Share of the blurred spot on the detector, averaged over 7 zones of the aperture."""
    zones = distance_m * np.linspace(0.8, 1.2, 7)
    return lambda r: (1 - np.exp(-((np.ravel(r)[None] / zones[:, None]) ** 2))).mean(0).reshape(np.shape(r))


def stretched_pulse(range_m: np.ndarray, theta: np.ndarray, divergence_rad: float) -> np.ndarray:
    """Range excess (m) of the trailing edge: 19 sub-rays across the divergence, each with its range on the surface.

    The reading is the range below which 99 % of the echo's energy (uniform over the footprint) has come back.
    """
    angle = (np.arange(19) + 0.5) / 19 - 0.5
    lean = np.minimum(theta[..., None] + divergence_rad * angle, 1.5694)
    sub = range_m[..., None] * np.cos(theta)[..., None] / np.cos(lean)
    return np.quantile(sub, 0.99, axis=-1) - range_m


def walk_law(intensity: np.ndarray, reference: float) -> np.ndarray:
    """Leading-edge delay left after the firmware's correction, 1 in the dark and 0 in the bright limit."""
    x = np.maximum(intensity, 0) / reference
    return 0.6 * np.exp(-x) + 0.4 / (1 + x) ** 3


def bump(angle: np.ndarray, width_rad: float) -> np.ndarray:
    """Raised cosine of the half height of a Gaussian of that width, zero beyond; angles in rad, any turn."""
    away = np.abs(np.angle(np.exp(1j * angle)))
    return np.where(away < 2.35 * width_rad, 0.5 + 0.5 * np.cos(np.pi * away / (2.35 * width_rad)), 0.0)


def gaussian_of_bump(width_rad: float) -> tuple[float, float]:
    """Amplitude and width of the Gaussian that fits `bump` best."""
    x = np.linspace(-3 * width_rad, 3 * width_rad, 301)
    scale, width = fit(lambda t, a, s: a * np.exp(-0.5 * (t / s) ** 2), [1.0, width_rad], x, bump(x, width_rad), False)
    return float(scale), float(abs(width))
