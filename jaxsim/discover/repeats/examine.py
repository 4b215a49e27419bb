"""The question put to a comparison: what still repeats once everything that was named is in place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import jax.numpy as jnp
import numpy as np

from jaxsim.discover.add import Chain, in_place
from jaxsim.discover.model.cast import blocks, cast
from jaxsim.discover.model.fit import Problem
from jaxsim.discover.model.noise import Noise
from jaxsim.discover.model.null import first_residuals
from jaxsim.discover.model.random_effects import conditional_residuals, normal_equations
from jaxsim.discover.read import Division
from jaxsim.discover.repeats.find import find_repeats
from jaxsim.discover.repeats.maps import maps_of
from jaxsim.discover.rules import RULES
from jaxsim.discover.verdict import Repeat
from jaxsim.effects.chain import SensorModel


def examine(
    division: Division,
    scenes: Sequence[str],
    null: Problem,
    chain: Chain,
    *,
    noise: Noise,
    known: SensorModel,
) -> tuple[Repeat, ...]:
    """What repeats in `division` with the effects of `chain`, which leave `noise`, and the `known` ones in place.

    More columns are looked at than fits were given. `scenes` are those of the frames.
    """
    rows, columns = division.scan.range_m.shape[1:]
    chosen = blocks(scenes, rows, columns, rays=RULES.repeats_rays)
    dense = replace(division, blocks=chosen, rays=cast(division.scan, chosen.frame, chosen.column))
    ev, scene = dense.all_evidence(known)
    finding = np.arange(len(dense.parts.find) + len(dense.parts.judge)) < len(dense.parts.find)
    fitted = finding[scene].astype(np.float32)
    raw = Problem(division.scan, ev, normal_equations(ev, null.noise, *first_residuals(ev)), noise, null.clutter)
    problem = in_place(raw, chain, simulated=True)
    off = conditional_residuals(problem.ev, raw.equations, jnp.asarray(fitted))
    problem = replace(problem, equations=normal_equations(problem.ev, noise, *off))
    maps = maps_of(problem, fitted, scene, columns=columns)
    return find_repeats(maps, finding, bins=RULES.repeats_bins)
