"""What the find scenes show before any effect is added: the null model, and what its residuals depend on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Int

from jaxsim.discover.find import Dependence, interactions, localise, reported, spelled
from jaxsim.discover.model.fit import CLUTTER, Problem
from jaxsim.discover.model.null import fit_null
from jaxsim.discover.model.residuals import standardised
from jaxsim.discover.read import NOTHING_YET, Division
from jaxsim.discover.verdict import Where
from jaxsim.effects.chain import SensorModel


@dataclass(frozen=True)
class Dependences:
    """What the find scenes show before any effect is added."""

    null: Problem
    scene: Int[np.ndarray, " b"]
    """The scene of each block."""
    single: list[Dependence]
    """Dependences of the null's residuals on single covariates, strongest first."""
    where: tuple[Where, ...]
    """Those that a verdict lists, pairs of covariates among them."""
    pairs: tuple[Dependence, ...]
    """Pairs of covariates that are sure enough for it, `A x B`."""


def find_dependences(division: Division, known: SensorModel = NOTHING_YET) -> Dependences:
    """The null model of the find scenes with the `known` effects in place, and what its residuals depend on. Raises
    ValueError for a learned law of what the frames do not hold."""
    for law in known.learned:
        law.check(division.scan)
    ev, scene = division.evidence(division.parts.find, known)
    clutter = any(name in CLUTTER for name, _ in known.effects)
    null, _ = fit_null(division.scan, ev, ev.all_blocks, clutter=clutter)
    rays, residuals = standardised(null, ev.all_blocks)
    single = localise(rays, residuals, scene)
    pairs = interactions(rays, residuals, scene)
    listed = reported([*single, *pairs])
    where = tuple(Where(one.channel, spelled(one.covariate), one.p_value, one.share) for one in listed)
    return Dependences(null, scene, single, where, tuple(reported(pairs)))
