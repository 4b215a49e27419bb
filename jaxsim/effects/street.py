"""The street on which effects are tried, with nothing missing: a road, house fronts to both sides and ahead, and boxes:
cars, trees, poles, signs. Rays are cast exactly."""

from __future__ import annotations

import jax
import numpy as np
from jaxtyping import Float

from jaxsim.effects.rays import Scan
from jaxsim.effects.scan import SIGN, scan_of
from jaxsim.frame import PolarGrid, PolarImage

HEIGHT_M = 1.73
"""Height of the sensor over the road."""
ROAD = 7
HOUSE = 11
POLE = 17
TREE = 21
CAR = 26
ALBEDO = {ROAD: 0.15, HOUSE: 0.4, POLE: 0.5, SIGN: 0.95, TREE: 0.3, CAR: 0.6}
Box = tuple[int, tuple[float, float, float], tuple[float, float, float]]
"""Class, middle and half sizes, m."""


def small_street(*, frames: int = 3, rows: int = 16, columns: int = 90) -> Scan:
    """The scan of as many streets as frames, on the device, the same at every call."""
    rng = np.random.default_rng(0)
    step = 2 * np.pi / columns
    azimuth, elevation = np.pi - step * (np.arange(columns) + 0.5), np.deg2rad(np.linspace(4, -24, rows))
    grid = PolarGrid(azimuth.astype(np.float32), elevation.astype(np.float32), np.zeros(rows, np.float32))
    # Directions of all rays, x ahead, y left, z up.
    ce = np.cos(elevation)[:, None]
    to = np.stack([ce * np.cos(azimuth), ce * np.sin(azimuth), np.sin(elevation)[:, None] + 0 * azimuth], -1)
    images = []
    facts = []
    about = []
    for k in range(frames):
        range_m, cosine, semantic, instance = _cast(to, _boxes(rng))
        hit = range_m < 120
        albedo = np.array([ALBEDO.get(c, 0.0) for c in range(34)])[semantic]
        seen = np.where(hit, range_m, 0).astype(np.float32)
        # Lambert's law: what comes back follows the cosine.
        images.append(PolarImage(seen, np.where(hit, albedo * cosine, 0).astype(np.float32), hit))
        colour = rng.integers(40, 220, (50, 3))[instance].astype(np.uint8)
        angle = np.where(hit, np.arccos(np.clip(cosine, 0, 1)), 0).astype(np.float32)
        facts.append({"incidence": angle, "semantic": semantic * hit, "instance": instance, "rgb": colour})
        about.append({"time": 30.0 * k, "speed": 3.0 * k, "heading": 0.7 * k})
    return jax.device_put(scan_of(grid, images, facts, about=about))


def _boxes(rng: np.random.Generator) -> list[Box]:
    """What stands in a street."""
    # Fronts at various distances, so that range, angle and row do not say the same.
    left, right, ahead = rng.uniform((7, 7, 25), (14, 14, 60)).tolist()
    front = 4.0 - HEIGHT_M
    boxes: list[Box] = [
        (HOUSE, (0.0, left + 1, front), (100.0, 1.0, 4.0)),
        (HOUSE, (0.0, -right - 1, front), (100.0, 1.0, 4.0)),
        (HOUSE, (ahead, 0.0, front), (1.0, 30.0, 4.0)),
    ]
    for kind, count, half in (
        (CAR, 6, (2.1, 0.9, 0.75)),
        (TREE, 4, (1.2, 1.2, 2.0)),
        (POLE, 4, (0.2, 0.2, 2.5)),
        (SIGN, 4, (0.05, 0.8, 1.6)),
    ):
        for _ in range(count):
            x, y = rng.uniform(-35, 40), rng.choice([-1, 1]) * rng.uniform(3, 6)
            boxes.append((kind, (float(x), float(y), half[2] - HEIGHT_M), half))
    return boxes


def _cast(to: Float[np.ndarray, "r c 3"], boxes: list[Box]) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Range (m; infinite where nothing is hit), cosine of incidence, class and number of what each ray meets first."""
    down = to[..., 2] < -1e-6
    best = np.where(down, HEIGHT_M / np.where(down, -to[..., 2], 1), np.inf)
    cosine, semantic = np.abs(to[..., 2]), np.full(best.shape, ROAD, np.int32)
    number = np.zeros(best.shape, np.int32)
    # No slab is divided by 0 by a ray along it.
    way = np.where(np.abs(to) < 1e-9, 1e-9, to)
    for k, (kind, middle, half) in enumerate(boxes, 1):
        # A ray enters a box where it has entered all three slabs.
        enters = (np.array(middle) - np.sign(way) * np.array(half)) / way
        leaves = (np.array(middle) + np.sign(way) * np.array(half)) / way
        face = enters.argmax(-1)
        t = enters.max(-1)
        met = (t > 0) & (t < leaves.min(-1)) & (t < best)
        best = np.where(met, t, best)
        cosine = np.where(met, np.take_along_axis(np.abs(to), face[..., None], -1)[..., 0], cosine)
        semantic, number = np.where(met, kind, semantic), np.where(met, k, number)
    return best, cosine, semantic, number
