"""What one kind of surface alone shows, and the others do not: something of these streets, and nothing of the sensor.

Close to the sensor there is little but road, and far away little but walls. Where the roads of one side are darker than
those of the other, readings look as if the sensor saw less close by. But a sensor does the same to every surface: with
the ground left out an effect must gain something still, and so it must without what is upright.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float

from jaxsim.discover.rules import RULES
from jaxsim.discover.scenes import clipped
from jaxsim.discover.unpaired.columns import GROUND, UPRIGHT, kinds
from jaxsim.discover.unpaired.conditional import Conditional, Term
from jaxsim.discover.unpaired.held_out import held_out
from jaxsim.discover.unpaired.law import Block, RandomEffects, equations

WORDS = {GROUND: "the ground", UPRIGHT: "upright surfaces"}


def shown_alone_by(problem: Conditional, term: Term) -> str:
    """The kind of surface without which a term gains nothing on held-out scenes, in words; empty where there is none.
    What is left when a kind is nearly all that there is says nothing, and is not asked."""
    kind = kinds(problem.comparison)
    for number, word in WORDS.items():
        rest = kind != number
        if rest.mean() >= RULES.unpaired_kind_least_share and clipped(gained(problem, term, rest)).sum() <= 0:
            return word
    return ""


def gained(problem: Conditional, term: Term, rest: Bool[np.ndarray, " n"]) -> Float[np.ndarray, " f"]:
    """What the term gains on each find scene that its fit has not seen, nats, where law, nuisances and term are learned
    from the `rest` of the rays alone."""
    near = problem.nuisance
    size = len(near.columns)
    random = problem.random
    eq = equations(
        problem.y[rest],
        problem.law[rest],
        problem.side[rest][:, np.concatenate([near.columns, term.block.columns])],
        random=RandomEffects(random.columns[rest], random.sd, random.patch[rest], random.patch_sd),
        scene=problem.comparison.scene[rest],
        scenes=len(problem.comparison.scenes),
        variance=problem.variance,
    )
    near = replace(near, columns=np.arange(size))
    block = Block(size + np.arange(len(term.block.columns)), term.block.precision, term.block.sign)
    # Scenes scatter as they do with all surfaces.
    part = replace(problem, equations=eq.scaled(problem.inflation), nuisance=near)
    return held_out(part, near, [block])[0]
