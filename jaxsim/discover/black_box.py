"""What free curves reach with the same data: the floor of a gap."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxsim.discover.additive import RIDGE
from jaxsim.discover.distance import CLIP_M
from jaxsim.discover.fit import Problem
from jaxsim.discover.likelihood import CHANNELS
from jaxsim.discover.localise import COVARIATES, curve_basis, values_of
from jaxsim.discover.residuals import residuals


def black_box(problem: Problem, fitted: Float[np.ndarray, " b"], covariates: Sequence[str]) -> Problem:
    """The problem with an additive model of free curves along `covariates` in place of an effect: least squares on the
    residuals of the fitted blocks (ranges within CLIP_M, for squares would follow a few far ones), added to ln I, to
    the reading and to the share that is lost. Curves are of the mean alone; scatter stays what it is."""
    rays, train = jax.tree.map(np.asarray, problem.ev.rays), np.asarray(fitted) > 0
    said = {}
    found = residuals(problem, fitted)
    for name in CHANNELS:
        off, _, counts = found[name]
        design = [curve_basis(values_of(one, rays, counts), one) for one in COVARIATES if one in covariates]
        x = np.concatenate([np.ones((int(counts.sum()), 1), np.float32), *design], axis=1)
        y = np.clip(off[counts], -CLIP_M, CLIP_M) if name == "range" else off[counts]
        learn = np.broadcast_to(train[:, None, None], counts.shape)[counts]
        beta = np.linalg.solve(x[learn].T @ x[learn] + RIDGE * np.eye(x.shape[1]), x[learn].T @ y[learn])
        said[name] = np.zeros(counts.shape, np.float32)
        said[name][counts] = x @ beta
    lost = np.asarray(~problem.ev.returned) - found["drop"][0]
    kept = np.log1p(-np.clip(lost + said["drop"], 1e-3, 1 - 1e-3)) - np.log1p(-lost)
    curved = replace(
        problem.ev.rays,
        log_intensity=problem.ev.rays.log_intensity + said["intensity"],
        reading_m=problem.ev.rays.reading_m + said["range"],
        log_keep=problem.ev.rays.log_keep + jnp.where(rays.hit, kept, 0).astype(jnp.float32),
    )
    return replace(problem, ev=replace(problem.ev, rays=curved))
