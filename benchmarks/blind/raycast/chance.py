"""Random numbers that follow from a case's words alone, and smooth noise in space."""

from __future__ import annotations

import hashlib

import numpy as np

_VALUE_NOISE_SD = 0.37
"""Of uniform values on a lattice, blended smoothly along three axes."""


def stream(case: str, *what: object) -> np.random.Generator:
    """A generator for one purpose of one case."""
    words = " ".join(str(w) for w in (case, *what))
    return np.random.default_rng(list(hashlib.sha256(words.encode()).digest()))


def cell_value(cell: np.ndarray, salt: int) -> np.ndarray:
    """Uniform in -1..1, the same for the same cell (*n, 3) of whole numbers."""
    mix = cell.astype(np.int64) @ np.array([374761393, 668265263, 2147483647]) + np.int64(salt) * np.int64(1274126177)
    h = mix.astype(np.uint64)
    for shift, factor in ((33, 0xFF51AFD7ED558CCD), (33, 0xC4CEB9FE1A85EC53)):
        h = (h ^ (h >> np.uint64(shift))) * np.uint64(factor)
    h ^= h >> np.uint64(33)
    return (h >> np.uint64(11)).astype(float) / 2.0**52 - 1


def value_noise(point: np.ndarray, cell_m: float, salt: int) -> np.ndarray:
    """Smooth noise of mean 0 and standard deviation 1 at points (*n, 3), varying over `cell_m`."""
    at = np.asarray(point) / cell_m + 0.31
    low = np.floor(at)
    share = at - low
    share = share * share * (3 - 2 * share)
    total = np.zeros(at.shape[:-1])
    for corner in np.ndindex(2, 2, 2):
        weight = np.where(np.array(corner) == 1, share, 1 - share).prod(-1)
        total += weight * cell_value(low + np.array(corner), salt)
    return total / _VALUE_NOISE_SD
