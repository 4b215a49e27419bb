"""How high the bar must be for the data at hand: the naming run on measurements in which nothing is missing.

Flexible candidates gain something on any data, because no null model is quite right, and how much depends on the
data: on the noise of the normals, on few scenes, on how materials are spread. So the nulls carry the data's own
nuisances (`bootstrap`), and what is named must gain more than anything did on any of them.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from jaxtyping import Int

from jaxsim.discover.find.localise import localise
from jaxsim.discover.model.fit import Problem
from jaxsim.discover.model.null import fit_null
from jaxsim.discover.model.residuals import standardised
from jaxsim.discover.name.bootstrap import bootstrap
from jaxsim.discover.name.candidates import Candidate, rank_effects
from jaxsim.discover.name.select import Bars, Log
from jaxsim.discover.name.unexplained import free_curves, sure
from jaxsim.discover.rules import RULES
from jaxsim.discover.verdict import Nulls
from jaxsim.effects import Effect


def bars_of(nulls: Nulls, scenes: int) -> Bars:
    """The bars in nats in all, of so many scenes."""
    return Bars(nulls.bar * scenes, nulls.free_bar * scenes)


def run_nulls(
    problem: Problem,
    explained: Problem,
    effects: Iterable[Effect],
    *,
    scene: Int[np.ndarray, " b"],
    count: int,
    log: Log = lambda line: None,
) -> Nulls:
    """The naming's first step on `count` nulls drawn from `problem`, and the bars that none of them passes, for effects
    and for free curves; at least the standing one. `scene` is that of each block."""
    catalogue = tuple(effects)
    scenes = len(np.unique(scene))
    all_blocks = np.ones(len(scene), np.float32)
    names = []
    gains = []
    free = []
    for seed in range(count):
        drawn = bootstrap(problem, explained, seed)
        null, _ = fit_null(problem.scan, drawn, all_blocks, clutter=problem.clutter)
        best = _strongest(c for c in rank_effects(null, catalogue) if c.scenes_agree and not c.smooth_is_enough)
        places = localise(*standardised(null, all_blocks), scene)
        curve = _strongest(c for _, c in free_curves(null, places) if sure(c))
        names.append(best.effect.name if best else "")
        gains.append(best.total if best else 0.0)
        free.append(curve.total if curve else 0.0)
        text = f"{names[-1]} gains {gains[-1]:.1f} nats" if best else "no effect that scenes agree on"
        log(f"null {seed + 1} of {count}: {text}" + (f", a free curve gains {free[-1]:.1f}" if curve else ""))
    return Nulls(
        effects=tuple(names),
        gains=tuple(gain / scenes for gain in gains),
        free=tuple(gain / scenes for gain in free),
        answered=sum(max(pair) > RULES.bar_nats for pair in zip(gains, free, strict=True)),
        bar=max(RULES.bar_nats, *gains) / scenes,
        free_bar=max(RULES.bar_nats, *free) / scenes,
    )


def _strongest(candidates: Iterable[Candidate]) -> Candidate | None:
    good = [one for one in candidates if one.total > 0]
    return max(good, key=lambda one: one.total) if good else None
