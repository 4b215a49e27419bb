"""Toy frames of which only some have beam gains, from a moment on and under a tag; or only some columns."""

from dataclasses import replace

import jax
import numpy as np

from jaxsim.discover.model.evidence import gather
from jaxsim.discover.model.null_model import fit_null
from jaxsim.discover.regimes.questions import Facts
from tests.discover.toy import device, toy

FRAMES, COLUMNS, ROWS = 10, 60, 16
INSIDE = np.arange(FRAMES) >= 5
SECTOR = (np.arange(COLUMNS) >= 10) & (np.arange(COLUMNS) < 30)
GAINS = np.random.default_rng(3).normal(0, 0.08, ROWS)


def halves(frames=INSIDE, columns=None, *, seed: int = 5, share: float = 1.0, falloff: float = 0.0):
    """(null problem, facts) of a share of the beam gains, or of a power of the range that falls, in these frames and
    columns, all by default."""
    scan, measured = toy(frames=FRAMES, rows=ROWS, columns=COLUMNS, seed=seed)
    inside = np.asarray(frames)[:, None] & (np.ones(COLUMNS, bool) if columns is None else columns)[None]
    change = share * GAINS[None, :, None] - falloff * np.log(scan.range_m / 10)
    light = measured.intensity * np.exp(np.where(inside[:, None, :], change, 0))
    measured = replace(measured, intensity=np.clip(light, 0, 1).astype(np.float32))
    tags = {"night": np.asarray(frames), "rain": np.arange(FRAMES) % 2 == 0}
    scan, measured = device(replace(scan, tags=tags), measured)
    frame = np.arange(FRAMES)
    column = np.broadcast_to(np.arange(0, COLUMNS, 2), (FRAMES, COLUMNS // 2))
    ev = gather(scan, measured, frame=frame, column=column, scene=frame)
    with jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):
        null = fit_null(scan, ev)
    names = tuple(f"drive {k}" for k in range(FRAMES))
    return null, Facts(scan, names, frame, frame, column)
