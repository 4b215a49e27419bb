"""What surfaces of a class alone say, and all others deny: something of these surfaces, and nothing of the sensor.

A simulated street may have flat soil where the real one undulates, and solid crowns where real ones are of leaves. What
that does to readings can look like an effect of a sensor, as noise that grows while echoes weaken does. But a sensor
does the same to every surface. So without the class that says most for an effect the others may say little of it, and
must not clearly speak against it.
"""

from __future__ import annotations

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool

from jaxsim.data.cityscapes import NAMES
from jaxsim.discover.model.evidence import Evidence
from jaxsim.discover.model.fit import NOTHING, Problem, channels_of, fit, fit_noise, score_at
from jaxsim.discover.model.null import reweighted
from jaxsim.discover.model.parameters import to_values
from jaxsim.discover.name.select import FittedStep
from jaxsim.discover.rules import RULES
from jaxsim.discover.scenes import clipped, p_value
from jaxsim.effects.effect import CHANNELS


def denied_without(step: FittedStep, problem: Problem) -> str:
    """The class without whose surfaces all others clearly speak against an effect that was fitted to a problem, by
    name; empty where there is none."""
    effect, fitted = step.chosen.effect, step.fit
    used = [CHANNELS.index(name) for name in channels_of(effect)]
    every = problem.ev.all_blocks
    semantic, hit = np.asarray(problem.ev.rays.semantic), np.asarray(problem.ev.rays.hit)
    values = {name: np.asarray(value) for name, value in to_values(effect, fitted.z).items()}
    kinds, counts = np.unique(semantic[hit], return_counts=True)
    shares = counts / max(counts.sum(), 1)
    for kind in kinds[(shares >= RULES.class_least_share) & (shares <= 1 - RULES.class_least_share)]:
        rest = replace(problem, ev=leaving_out(problem.ev, semantic == kind))
        with_effect = score_at(effect, rest, every, z=fitted.z, noise=fitted.noise)
        without = score_at(NOTHING, rest, every, z={}, noise=problem.noise)
        if (with_effect - without)[:, used].sum() >= 0:
            continue
        # Noise that was fitted to all surfaces may be too much or too little for these: it is fitted to them.
        rest = reweighted(rest, every)
        placed = fit(effect, rest, every, starts=(values,), fixed=True)
        lost = clipped(rest.ev.by_scene((fit_noise(rest, every).score - placed.score)[:, used].sum(-1)))
        if lost.sum() > RULES.bar_nats and p_value(lost) <= RULES.denied_level:
            return NAMES[int(kind)]
    return ""


def leaving_out(ev: Evidence, out: Bool[np.ndarray, "b c r"]) -> Evidence:
    """The evidence without rays: they hit nothing and return nothing."""
    kept = jnp.asarray(~out)
    return replace(
        ev,
        rays=replace(ev.rays, hit=ev.rays.hit & kept),
        returned=ev.returned & kept,
        compared=ev.compared & kept,
        features=jnp.where(kept[..., None], ev.features, 0),
    )
