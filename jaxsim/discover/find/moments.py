"""Moments at which all intensities of a recording step: a gain that switches between two states, a new firmware.

Each scene's level is fitted, for streets differ by themselves; so residuals show no step, and a curve along time that
must hold on scenes between those that it was fitted to cannot bend so. Levels in the order of time show it. They are
held against levels that scatter by a normal law and step nowhere: few scenes have too few orders to tell three of them
from chance, however clear they are. So what is found here is asked of held-out scenes as well.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxsim.discover.model.fit import Problem
from jaxsim.discover.model.null_model import first_residuals
from jaxsim.discover.model.random_effects import levels_of
from jaxsim.discover.rules import RULES
from jaxsim.discover.scenes import ORDER_PARTS, chance_of
from jaxsim.products import einsum


def steps_in_time(problem: Problem) -> tuple[float, ...]:
    """Times, s since the first frame, from which on intensities are brighter or darker: one where they stay so, two
    where they come back. None where levels that only scatter step as clearly, or where scenes share their moments, as
    the sectors of one drive do."""
    begun, ended = moments_of(problem)
    order = np.argsort(begun)
    if len(order) < RULES.moment_fewest or (ended[order][:-1] >= begun[order][1:]).any():
        return ()
    level = levels_by_scene(problem)[order]
    spans = spans_of(len(order))
    apart = standard_errors(spans, level[:, None])[:, 0]
    span = spans[apart.argmax()]
    step = np.where(span, level[span].mean(), level[~span].mean())
    # A drift is brighter at its end as well.
    line = np.polyval(np.polyfit(begun[order], level, 1), begun[order])
    drifts = ((level - step) ** 2).sum() > RULES.moment_share * ((level - line) ** 2).sum()
    if drifts or np.ptp(step) < RULES.moment_nats:
        return ()
    # A few at a time: of many scenes there are many thousand spans.
    scattered = np.array_split(np.random.default_rng(0).normal(size=(len(level), RULES.sign_draws)), ORDER_PARTS, 1)
    largest = np.concatenate([standard_errors(spans, some).max(0) for some in scattered])
    if chance_of(largest, float(apart.max())) > RULES.moment_level:
        return ()
    changes = np.flatnonzero(span[1:] != span[:-1]) + 1
    return tuple(float(begun[order][k]) for k in changes)


def moments_of(problem: Problem) -> tuple[Float[np.ndarray, " s"], Float[np.ndarray, " s"]]:
    """When each scene begins and ends, s since the first frame."""
    rays = problem.ev.rays
    time_s = np.broadcast_to(np.asarray(rays.time_s, float), np.asarray(rays.hit).shape)
    scene = _scene(problem)
    of_scene = [time_s[scene == k] for k in range(scene.max() + 1)]
    return np.array([one.min() for one in of_scene]), np.array([one.max() for one in of_scene])


def levels_by_scene(problem: Problem) -> Float[np.ndarray, " s"]:
    """Nats by which each scene's rays are brighter than simulated, beyond what all scenes' are."""
    ev, equations = problem.ev, problem.equations
    residual, _ = first_residuals(ev)
    shared = levels_of(ev, equations, ev.all_blocks, residual=residual).shared
    weight = np.asarray(equations.intensity, float)
    off = np.asarray(residual - einsum("bcrp,p->bcr", ev.features, shared), float)
    scene = _scene(problem)
    total = np.bincount(scene, (weight * off).sum((1, 2)))
    return total / np.maximum(np.bincount(scene, weight.sum((1, 2))), 1e-12)


def spans_of(scenes: int) -> Bool[np.ndarray, "k s"]:
    """All scenes from one on, and from one to another, with `Rules.moment_scenes` of them inside and outside."""
    k = np.arange(scenes)
    ends = [(begin, end) for begin in range(1, scenes) for end in range(begin + 1, scenes + 1)]
    spans = np.array([(k >= begin) & (k < end) for begin, end in ends])
    inside = spans.sum(1)
    return spans[(inside >= RULES.moment_scenes) & (inside <= scenes - RULES.moment_scenes)]


def standard_errors(spans: Bool[np.ndarray, "k s"], level: Float[np.ndarray, "s d"]) -> Float[np.ndarray, "k d"]:
    """How far the mean level of each span's scenes lies from that of the others, of d series of levels, in standard
    errors by what scenes scatter inside and outside."""
    inside = spans.sum(1)[:, None]
    outside = spans.shape[1] - inside
    sums = spans.astype(float) @ level
    within = sums / inside
    beside = (level.sum(0) - sums) / outside
    squares = (level**2).sum(0) - inside * within**2 - outside * beside**2
    variance = np.maximum(squares, 1e-12) / (spans.shape[1] - 2) * (1 / inside + 1 / outside)
    return np.abs(within - beside) / np.sqrt(variance)


def _scene(problem: Problem) -> Int[np.ndarray, " b"]:
    """Each block's scene, as its place among those that there are."""
    return np.unique(np.asarray(problem.ev.scene), return_inverse=True)[1]
