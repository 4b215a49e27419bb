"""What the rays of a LiDAR on a car's roof hit in a street of boxes, by the slab test of every ray with every box."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

HEIGHT_M = 2.4
"""Of the sensor above the road."""
CURB_M = 7.0
ROAD, PAVEMENT, HOUSE, POLE, TREE, CAR = 1, 2, 3, 6, 9, 14
"""Tags of CARLA 0.9.14 and later."""


@dataclass(frozen=True)
class Hits:
    """What rays (rows of channels, columns) hit first."""

    distance_m: np.ndarray
    """0 where nothing is."""
    cosine: np.ndarray
    """Of the angle between ray and surface normal."""
    tag: np.ndarray
    thing: np.ndarray
    """The box's number, from 1; 0 of the ground."""


def directions(channels: int, columns: int, *, upper_deg: float, lower_deg: float) -> np.ndarray:
    """Unit vectors (channels, columns, 3), x forward, y to the left; channels evenly spaced, the upper first."""
    elevation = np.deg2rad(np.linspace(upper_deg, lower_deg, channels))[:, None]
    azimuth = np.pi - (np.arange(columns) + 0.5) * 2 * np.pi / columns
    level = np.cos(elevation)
    up = np.broadcast_to(np.sin(elevation), (channels, columns))
    return np.stack([level * np.cos(azimuth), level * np.sin(azimuth), up], axis=-1)


def look(ray: np.ndarray, rng: np.random.Generator) -> Hits:
    """A street that `rng` draws, seen along unit vectors `ray` (..., 3) from the sensor."""
    box, tag = _boxes(rng)
    with np.errstate(divide="ignore", invalid="ignore"):
        ground = np.where(ray[..., 2] < 0, -HEIGHT_M / ray[..., 2], np.inf)
        near, far = np.full((*ray.shape[:-1], len(box)), -np.inf), np.full((*ray.shape[:-1], len(box)), np.inf)
        side = np.zeros(near.shape, int)
        for axis in range(3):
            ends = [box[:, axis, end] / ray[..., axis, None] for end in (0, 1)]
            enters, leaves = np.minimum(*ends), np.maximum(*ends)
            side = np.where(enters > near, axis, side)
            near, far = np.maximum(near, enters), np.minimum(far, leaves)
    distance = np.where((near < far) & (near > 0), near, np.inf)
    first = distance.argmin(-1)
    to_box = np.take_along_axis(distance, first[..., None], -1)[..., 0]
    on_box = to_box < ground
    axis = np.where(on_box, np.take_along_axis(side, first[..., None], -1)[..., 0], 2)
    nearest = np.minimum(to_box, ground)
    hit = np.isfinite(nearest)
    across = np.abs(np.where(hit, nearest, 0) * ray[..., 1])
    return Hits(
        np.where(hit, nearest, 0),
        np.abs(np.take_along_axis(ray, axis[..., None], -1)[..., 0]),
        np.where(on_box, tag[first], np.where(across < CURB_M, ROAD, PAVEMENT)),
        np.where(on_box, first + 1, 0),
    )


def _boxes(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Ends of axis-aligned boxes (n, axes, low and high; m), and their tags."""
    found: list[tuple[tuple[float, float], ...]] = []
    tags: list[int] = []

    def add(tag: int, centre: tuple[float, float], size: tuple[float, float, float], foot: float = 0.0) -> None:
        (x, y), (length, width, height), low = centre, size, foot - HEIGHT_M
        found.append(((x - length / 2, x + length / 2), (y - width / 2, y + width / 2), (low, low + height)))
        tags.append(tag)

    for side in (-1, 1):
        x = rng.uniform(-110, -90)
        while x < 110:
            length = rng.uniform(8, 25)
            add(HOUSE, (x + length / 2, side * rng.uniform(16, 22)), (length, 10, rng.uniform(5, 18)))
            x += length + (rng.uniform(4, 15) if rng.random() < 0.4 else 0)
        for x in np.arange(-80, 80, 16) + rng.uniform(-4, 4, 10):
            add(POLE, (x, side * (CURB_M + 1)), (0.3, 0.3, 6))
            if rng.random() < 0.5:
                add(TREE, (x + 7, side * (CURB_M + 2.5)), (3, 3, 3), foot=2.5)
        for x in rng.uniform(-60, 60, 5):
            if abs(x) > 5:
                add(CAR, (x, side * rng.choice([2.0, 5.6])), (4.3, 1.8, 1.5), foot=0.2)
    return np.array(found), np.array(tags)
