"""Sizes of small streets, readings that were moved, and candidates made by hand."""

from dataclasses import replace

import numpy as np

from jaxsim.discover.unpaired.columns import Columns
from jaxsim.discover.unpaired.conditional import Conditional, Term
from jaxsim.discover.unpaired.equations import Block
from jaxsim.discover.unpaired.select import UnpairedCandidate
from jaxsim.effects import EFFECTS

SMALL = {"scenes": 12, "rows": 24, "columns": 192}
RAYS = 1000


def moved(problem: Conditional, change: np.ndarray) -> Conditional:
    """The problem with a change of ln I in its measured readings; its equations stay as they were."""
    return replace(problem, y=problem.y + np.where(problem.comparison.measured[problem.comparison.scene], change, 0))


def candidate(name: str, gain: float, *, chance: float = 0.0025, scenes: int = 10) -> UnpairedCandidate:
    columns = Columns(EFFECTS[name], {}, np.zeros((1, 1)), np.ones(1))
    term = Term(name, columns, Block(np.zeros(1, int), np.ones(1)))
    return UnpairedCandidate(term, 5.0, chance, gain + 0.1 * np.arange(scenes, dtype=float))
