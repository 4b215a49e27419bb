"""The gap on judge scenes, before and after: scenes that nothing was fitted to.

Each channel has a distance that an engineer reads off: the mean absolute error of ln I (nats) and of the range
(m, at most 1) on the rays that both sides compare, and the log loss of return (nats a ray). Nuisances that
frames share come from the find scenes; a frame's own (objects, pose) are fitted before and after alike.
"""

from __future__ import annotations

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxsim.discover.additive import RIDGE
from jaxsim.discover.evidence import Evidence
from jaxsim.discover.fit import Problem
from jaxsim.discover.likelihood import CHANNELS, log_lost
from jaxsim.discover.localise import CATEGORICAL, COVARIATES, curve_basis, values_of
from jaxsim.discover.nuisance import Noise
from jaxsim.discover.over_scenes import half_width, mean_interval, ratio_interval
from jaxsim.discover.random_effects import left_over
from jaxsim.discover.residuals import residuals
from jaxsim.discover.result import CurveLine
from jaxsim.discover.verdict import Gap, Interval
from jaxsim.effects import Effect
from jaxsim.frame import Array

UNITS = {
    "intensity": "mean absolute error of ln I",
    "range": "mean absolute error, m",
    "drop": "log loss of return, nats a ray",
}
CLIP_M = 1.0


def distances(problem: Problem, fitted: Float[np.ndarray, " b"]) -> Float[Array, "b 3 2"]:
    """Sums and counts of each block's distances by channel."""
    left = left_over(problem.ev, problem.weights, jnp.asarray(fitted, jnp.float32))
    return _distances(problem.ev, problem.noise, *left)


@jax.jit
def _distances(
    ev: Evidence, noise: Noise, off_i: Float[Array, "b c r"], off_r: Float[Array, "b c r"]
) -> Float[Array, "b 3 2"]:
    rays, smooth = ev.rays, ev.rays.hit & ev.returned & ~ev.edge
    gone = jnp.clip(rays.column_loss, 0, 0.999)
    lost = jnp.logaddexp(jnp.log1p(-gone) + log_lost(rays, ev, noise), jnp.log(gone + 1e-9))
    lost = jnp.clip(lost, -30.0, -1e-7)
    miss = -jnp.where(ev.returned, jnp.log(-jnp.expm1(lost)), lost)
    wrong = jnp.minimum(jnp.abs(off_r), CLIP_M)
    pairs = ((jnp.abs(off_i), ev.compared), (wrong, smooth), (miss, rays.hit))
    sums = [jnp.where(counts, x, 0).sum((1, 2)) for x, counts in pairs]
    counts = [counts.sum((1, 2)).astype(jnp.float32) for _, counts in pairs]
    return jnp.stack([jnp.stack(sums, -1), jnp.stack(counts, -1)], axis=-1)


def by_scene(per_block: Float[np.ndarray, "b 3 2"], unit: np.ndarray) -> Float[np.ndarray, "u 3"]:
    """Mean distance of each scene and channel; NaN where nothing is compared."""
    units = np.unique(unit)
    total = np.stack([per_block[unit == u].sum(0) for u in units])
    with np.errstate(invalid="ignore"):
        return np.where(total[..., 1] > 0, total[..., 0] / np.maximum(total[..., 1], 1), np.nan)


def gaps(
    before: Float[np.ndarray, "u 3"],
    after: Float[np.ndarray, "u 3"],
    placebo: Float[np.ndarray, "u 3"],
    floor: Float[np.ndarray, "u 3"],
    channels: Sequence[str],
) -> tuple[dict[str, Gap], Interval | None]:
    """Gap by channel, and the closure (before - after) / (before - floor) of the named effects' channels together, each
    channel's distances as shares of its own before; none where the scenes do not agree that the floor lies below.

    Scenes are paired: intervals are those of a scene's own differences (`over_scenes`).
    """
    found = {}
    shrunk, room = before - after, before - floor
    for k, name in enumerate(CHANNELS):
        values = [float(np.nanmean(x[:, k])) for x in (before, after, floor, placebo)]
        low, high = mean_interval(shrunk[:, k])
        win = float(np.nanmean(shrunk[:, k] > 0))
        found[name] = Gap(values[0], values[1], low, high, UNITS[name], values[2], values[3], win)
    used = [k for k, name in enumerate(CHANNELS) if name in channels and found[name].before > 0]
    if not used:
        return found, None
    sizes = np.array([found[CHANNELS[k]].before for k in used])
    top, bottom = (shrunk[:, used] / sizes).sum(1), (room[:, used] / sizes).sum(1)
    if not mean_interval(bottom)[0] > 0:
        return found, None  # nothing that a black box could explain for certain
    ends = ratio_interval(top, bottom)
    both = np.isfinite(top) & np.isfinite(bottom)
    return found, Interval(float(top[both].sum() / bottom[both].sum()), *ends, "share of what can be explained")


MAP_COLUMNS = 32
"""Columns of a residual map, before it is spread over the grid: rays are thinned to whole columns."""


def maps_of(problem: Problem, fitted: np.ndarray, judged: np.ndarray) -> dict[str, Float[np.ndarray, "r c"]]:
    """Mean residual of the judged blocks on the grid, by channel."""
    columns = len(np.asarray(problem.scan.grid.azimuth_rad))
    bins = min(columns, MAP_COLUMNS)
    row, column = (np.asarray(part)[judged] for part in (problem.ev.rays.row, problem.ev.rays.column))
    place = row * bins + column * bins // columns
    rows = int(row.max()) + 1
    spread = np.arange(columns) * bins // columns
    maps = {}
    for name, (off, _, counts) in residuals(problem, fitted).items():
        keep = counts[judged]
        count = np.bincount(place[keep], minlength=rows * bins)
        total = np.bincount(place[keep], off[judged][keep], minlength=rows * bins)
        mean = np.where(count > 0, total / np.maximum(count, 1), np.nan).reshape(rows, bins)
        maps[name] = mean[:, spread]
    return maps


RESIDUAL_UNITS = {
    "intensity": "ln I, measured minus simulated",
    "range": "m, measured minus simulated",
    "drop": "share lost, measured minus expected",
}


def curves_along(
    before: Problem, after: Problem, fitted: np.ndarray, judged: np.ndarray, unit: np.ndarray, effects: Sequence[Effect]
) -> tuple[CurveLine, ...]:
    """Mean residual along each named effect's own covariates, on judged blocks."""
    wanted = {
        (channel, covariate): None
        for effect in effects
        for channel in effect.channels
        for covariate in effect.covariates
    }
    old, new = residuals(before, fitted), residuals(after, fitted)
    rays = jax.tree.map(lambda leaf: np.asarray(leaf)[judged] if np.ndim(leaf) else leaf, before.ev.rays)
    lines = []
    for channel, covariate in wanted:
        if covariate not in COVARIATES:
            continue
        x = np.asarray(COVARIATES[covariate](rays), float)
        counts = old[channel][2][judged] & new[channel][2][judged]
        if counts.sum() < 200:
            continue
        of_unit = np.broadcast_to(unit[judged][:, None, None], counts.shape)[counts]
        x = x[counts]
        values = np.unique(x)
        # One point a beam or class; of other covariates, as many rays in each bin.
        edges = [*values, np.inf] if covariate in CATEGORICAL else np.unique(np.quantile(x, np.linspace(0, 1, 17)))
        if len(edges) < 3:
            continue
        place = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, len(edges) - 2)
        size = len(edges) - 1
        n = np.maximum(np.bincount(place, minlength=size), 1)
        means = [np.bincount(place, r[channel][0][judged][counts], minlength=size) / n for r in (old, new)]
        scenes = []
        for u in np.unique(of_unit):
            own = of_unit == u
            k = np.bincount(place[own], minlength=size)
            total = np.bincount(place[own], old[channel][0][judged][counts][own], minlength=size)
            scenes.append(np.where(k > 0, total / np.maximum(k, 1), np.nan))
        centre, band = np.bincount(place, x, minlength=size) / n, half_width(np.array(scenes))
        lines.append(CurveLine(channel, covariate, RESIDUAL_UNITS[channel], centre, means[0], means[1], band))
    return tuple(lines)


def floors(
    problem: Problem,
    fitted: np.ndarray,
    judged: np.ndarray,
    unit: np.ndarray,
    before: Float[np.ndarray, "u 3"],
    covariates: Sequence[str],
) -> Float[np.ndarray, "u 3"]:
    """Distances that a black box reaches: an additive model of free curves along `covariates`, fitted to the find
    scenes' residuals (ranges within CLIP_M, for squares would follow a few far ones)."""
    result = before.copy()
    rays = jax.tree.map(np.asarray, problem.ev.rays)
    train = fitted > 0
    found = residuals(problem, fitted)
    for k, name in enumerate(CHANNELS):
        off, _, counts = found[name]
        design = [curve_basis(values_of(one, rays, counts), one) for one in COVARIATES if one in covariates]
        x = np.concatenate([np.ones((int(counts.sum()), 1), np.float32), *design], axis=1)
        y = np.clip(off[counts], -CLIP_M, CLIP_M) if name == "range" else off[counts]
        learn = np.broadcast_to(train[:, None, None], counts.shape)[counts]
        beta = np.linalg.solve(x[learn].T @ x[learn] + RIDGE * np.eye(x.shape[1]), x[learn].T @ y[learn])
        said = x @ beta
        if name == "drop":
            base = np.asarray(~problem.ev.returned)[counts]
            p = np.clip(base - y + said, 1e-3, 1 - 1e-3)
            left = -np.where(base, np.log(p), np.log1p(-p))
        else:
            left = np.abs(y - said)
            left = np.minimum(left, CLIP_M) if name == "range" else left
        of_unit = np.broadcast_to(unit[:, None, None], counts.shape)[counts]
        for row, u in enumerate(np.unique(unit[judged])):
            own = of_unit == u
            if own.any():
                result[row, k] = left[own].mean()
    return result
