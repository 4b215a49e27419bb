"""How high the bar must be for the data at hand: the naming run on measurements in which nothing is missing.

Flexible candidates gain something on any data, because no null model is quite right, and how much depends on the
data: on the noise of the normals, on few scenes, on how materials are spread. So the nulls carry the data's own
nuisances (`redraw`), and what is named must gain more than anything did on any of them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
from jaxtyping import Int

from jaxsim.discover.find.localise import localise
from jaxsim.discover.model.fit import Problem
from jaxsim.discover.model.null import fit_null
from jaxsim.discover.model.residuals import standardised
from jaxsim.discover.name.bootstrap import redraw
from jaxsim.discover.name.candidates import Candidate, survey
from jaxsim.discover.name.select import BAR, Bars, scenes_agree, smooth_is_enough
from jaxsim.discover.name.unexplained import free_curves, sure
from jaxsim.discover.verdict import Nulls
from jaxsim.effects import Effect


def bars_of(nulls: Nulls, scenes: int) -> Bars:
    """The bars in nats in all, of so many scenes."""
    return Bars(nulls.bar * scenes, nulls.free_bar * scenes)


def run_nulls(
    problem: Problem,
    explained: Problem,
    unit: Int[np.ndarray, " b"],
    effects: Iterable[Effect],
    count: int,
    *,
    say: Callable[[str], None] = lambda line: None,
) -> Nulls:
    """The naming's first step on `count` nulls drawn from `problem`, and the bars that none of them passes, for effects
    and for free curves; at least the standing one. `unit` is the scene of each block."""
    catalogue, scenes = tuple(effects), len(np.unique(unit))
    everyone = np.ones(len(unit), np.float32)
    names, gains, free = [], [], []
    for seed in range(count):
        null, _ = fit_null(problem.scan, redraw(problem, explained, seed), everyone, clutter=problem.clutter)
        best = _strongest(c for c in survey(null, catalogue) if scenes_agree(c) and not smooth_is_enough(c))
        places = localise(*standardised(null, everyone), unit)
        curve = _strongest(c for _, c in free_curves(null, places) if sure(c))
        names.append(best.effect.name if best else "")
        gains.append(best.total if best else 0.0)
        free.append(curve.total if curve else 0.0)
        found = f"{names[-1]} gains {gains[-1]:.1f} nats" if best else "no effect that scenes agree on"
        say(f"null {seed + 1} of {count}: {found}" + (f", a free curve gains {free[-1]:.1f}" if curve else ""))
    return Nulls(
        effects=tuple(names),
        gains=tuple(gain / scenes for gain in gains),
        free=tuple(gain / scenes for gain in free),
        answered=sum(max(pair) > BAR for pair in zip(gains, free, strict=True)),
        bar=max(BAR, *gains) / scenes,
        free_bar=max(BAR, *free) / scenes,
    )


def _strongest(candidates: Iterable[Candidate]) -> Candidate | None:
    good = [one for one in candidates if one.total > 0]
    return max(good, key=lambda one: one.total) if good else None
