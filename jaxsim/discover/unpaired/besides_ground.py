"""What the ground alone shows, and nothing else does: something of these streets, and nothing of the sensor.

Close to the sensor there is little but road. Where the roads of one side are darker than those of the other, readings
look as if the sensor saw less close by. But a sensor does the same to every surface: with the ground left out an effect
must gain something still. Of the ground alone that cannot be asked, for along it range and angle go together.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float

from jaxsim.discover.rules import RULES
from jaxsim.discover.scenes import clipped
from jaxsim.discover.unpaired.columns import GROUND, kinds
from jaxsim.discover.unpaired.conditional import Conditional, Term
from jaxsim.discover.unpaired.equations import Block, RandomEffects, equations
from jaxsim.discover.unpaired.held_out import held_out


def shown_by_ground_alone(problem: Conditional, term: Term) -> bool:
    """Whether a term gains nothing on held-out scenes without the ground. Where next to nothing else is there, that is
    not asked."""
    rest = kinds(problem.comparison) != GROUND
    return float(rest.mean()) >= RULES.unpaired_least_besides and float(clipped(gained(problem, term, rest)).sum()) <= 0


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
