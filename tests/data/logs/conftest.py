"""A small sensor in a round room, point by point as drivers deliver it."""

import numpy as np
import pytest

RINGS, FIRINGS = 16, 180
ELEVATION = np.deg2rad(np.linspace(12, -18, RINGS))
"""Top first; the sensor numbers its rings from below, as most do."""


def room(seed: int = 0, turned: float = 0.2) -> dict[str, np.ndarray]:
    """Fields of a turn in the order of the firings: clockwise from the rear, each ring a little later than the last."""
    rng = np.random.default_rng(seed)
    step = 2 * np.pi / FIRINGS
    firing, ring = np.meshgrid(np.arange(FIRINGS), np.arange(RINGS), indexing="ij")
    azimuth = np.pi - (firing + turned + 0.4 * ring / RINGS) * step
    elevation = ELEVATION[::-1][ring]
    range_m = 10 + 3 * np.cos(azimuth) + 0.05 * ring
    level = range_m * np.cos(elevation)
    return {
        "x": (level * np.cos(azimuth)).astype("f4").ravel(),
        "y": (level * np.sin(azimuth)).astype("f4").ravel(),
        "z": (range_m * np.sin(elevation)).astype("f4").ravel(),
        "intensity": rng.integers(1, 256, firing.size).astype("u1"),
        "ring": ring.astype("u2").ravel(),
        "t": (firing * 500_000 + ring * 1000).astype("u4").ravel(),
    }


def expected(fields: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Range and intensity as (RINGS, FIRINGS), top row first, left to right."""
    range_m = np.sqrt(sum(fields[a].astype(float) ** 2 for a in "xyz")).reshape(FIRINGS, RINGS).T[::-1]
    return range_m, fields["intensity"].reshape(FIRINGS, RINGS).T[::-1] / 255


@pytest.fixture
def fields():
    return room()
