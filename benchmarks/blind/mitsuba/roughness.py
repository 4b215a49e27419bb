"""The law of a rough surface, rendered: a field of facets, seen by a sensor that carries its own light.

Oren & Nayar (SIGGRAPH 1994) integrate over V-cavities; here a Gaussian relief is cast by Mitsuba, so that facets hide
each other as they do. Light that facets throw at each other is left out.
"""

from __future__ import annotations

from collections.abc import Callable

import mitsuba as mi
import numpy as np

from benchmarks.blind.mitsuba.materials import CONTEXT, even, lambert
from benchmarks.blind.mitsuba.shapes import relief

ANGLES_DEG = (0, 10, 20, 30, 40, 50, 60, 65, 70, 75, 80, 84, 87)
CELLS, WIDTH_CELLS, RAYS = 320, 3.0, 3000


def rough_gain(roughness_rad: float, rng: np.random.Generator) -> Callable[[np.ndarray], np.ndarray]:
    """How much brighter than Lambert a surface is at an incidence angle (rad), 1 head on.

    Args:
        roughness_rad: standard deviation of the facets' slopes along an axis.
    """
    relief_m = _gaussian_relief(roughness_rad, rng)
    scene = mi.load_dict({"type": "scene", "relief": relief(relief_m, 1.0)})
    white = lambert(even(0.98)).true
    angles = np.deg2rad(ANGLES_DEG)
    light = np.array([_mean_light(scene, white, angle, rng) for angle in angles])
    ratio = light / np.cos(angles) / light[0]
    return lambda theta: np.interp(theta, angles, ratio)


def _mean_light(scene: mi.Scene, white: mi.BSDF, angle: float, rng: np.random.Generator) -> float:
    """Mean of f cos over rays that fall on the middle of the relief at one angle, from all sides."""
    around = rng.uniform(0, 2 * np.pi, RAYS)
    ahead = np.stack([np.sin(angle) * np.cos(around), np.sin(angle) * np.sin(around), np.full(RAYS, -np.cos(angle))], 1)
    target = np.concatenate([rng.uniform(-30, 30, (RAYS, 2)), np.zeros((RAYS, 1))], 1)
    light = []
    for start, direction in zip((target - 12 / np.cos(angle) * ahead).tolist(), ahead.tolist(), strict=True):
        hit = scene.ray_intersect(mi.Ray3f(mi.Point3f(start), mi.Vector3f(direction)))
        if hit.is_valid():
            light.append(white.eval(CONTEXT, hit, hit.wi)[0])
    return float(np.mean(light))


def _gaussian_relief(roughness_rad: float, rng: np.random.Generator) -> np.ndarray:
    """Heights (cells) whose gradient along an axis has the standard deviation tan(roughness_rad)."""
    wave = np.fft.fftfreq(CELLS)[:, None] ** 2 + np.fft.fftfreq(CELLS)[None] ** 2
    blur = np.exp(-2 * (np.pi * WIDTH_CELLS) ** 2 * wave)
    height = np.fft.ifft2(np.fft.fft2(rng.normal(size=(CELLS, CELLS))) * blur).real
    return height * np.tan(roughness_rad) / np.diff(height, axis=0).std()
