"""Surfaces that share a reflectance of their own: objects, and patches of what is no object."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from jaxsim.effects.rays import Scan
from jaxsim.geometry.polar import directions

OBJECT_SD, PATCH_SD, STRIP_SD, STREET_SD = 0.2, 0.15, 0.1, 0.1
"""Of the reflectance, nats: of an object and of a patch of ground or wall about its class in the street, of a strip
about its surface, of all that is of one class in one street about the class."""
FIRM = 1e12
"""1 / variance of what has no reflectance of its own."""
PATCH_M = 6.0
"""Ground and walls are alike over about so much."""
ROOM = 2048
"""Strips and surfaces are counted up to a multiple of this, so that fits of other frames need not be compiled again."""


def surfaces_of(
    scan: Scan, at: tuple[np.ndarray, ...]
) -> tuple[Int[np.ndarray, "b c r"], Int[np.ndarray, " t"], Float[np.ndarray, " s"]]:
    """`Evidence.strip`, `surface` and `hold`: each surface lies in one block."""
    instance = np.asarray(scan.instance)[at].astype(np.int64)
    hit, kind, range_m = (np.asarray(raster)[at] for raster in (scan.hit, scan.semantic, scan.range_m))
    ray = np.asarray(directions(scan.grid))[at[1], at[2]]
    x, y = (np.floor(np.where(hit, range_m * ray[..., k], 0) / PATCH_M).astype(np.int64) for k in (0, 1))
    block = np.broadcast_to(np.arange(len(instance))[:, None, None], instance.shape)
    thing = instance > 0
    key = np.stack([block, thing, np.where(thing, instance, kind), np.where(thing, 0, x), np.where(thing, 0, y)])
    _, first, number = np.unique(key[:, hit], axis=1, return_index=True, return_inverse=True)
    _, begin, of = np.unique(np.stack([number.ravel(), at[2][hit]]), axis=1, return_index=True, return_inverse=True)
    strip = np.zeros(instance.shape, np.int32)
    strip[hit] = of.ravel() + 1
    surface = np.zeros(_room(len(begin)), np.int32)
    surface[1 : len(begin) + 1] = number.ravel()[begin] + 1
    hold = np.full(_room(len(first)), FIRM, np.float32)
    hold[1 : len(first) + 1] = 1 / np.where(thing[hit][first], OBJECT_SD, PATCH_SD) ** 2
    return strip, surface, hold


def _room(count: int) -> int:
    return -(-(count + 1) // ROOM) * ROOM
