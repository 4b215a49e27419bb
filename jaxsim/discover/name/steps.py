"""What forward selection goes through, whatever its candidates are: one effect a step, and what stood beside it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar, runtime_checkable

import numpy as np
from jaxtyping import Float

from jaxsim.discover.rules import RULES
from jaxsim.discover.scenes import clipped, p_value


@runtime_checkable
class Ranked(Protocol):
    """A candidate as a ranking sees it."""

    @property
    def effect(self) -> Any: ...

    @property
    def by_scene(self) -> Float[np.ndarray, " s"]:
        """Gain on held-out scenes, nats."""
        ...

    @property
    def total(self) -> float:
        """Gain of all scenes, none of which decides alone, nats."""
        ...


C = TypeVar("C", bound=Ranked)


@dataclass(frozen=True)
class Step(Generic[C]):
    """One effect added, and what stood beside it."""

    chosen: C
    alike: tuple[C, ...]
    """Candidates that are not clearly worse."""
    ranking: tuple[C, ...]
    """All candidates, best first."""


def worse(candidate: Ranked, best: Ranked, *, share: float = RULES.alike_share, nats: float = RULES.alike_nats) -> bool:
    """Whether the scenes say that `candidate` explains clearly less than `best`: less than `share` of what it does, or
    by more than `nats` on which they agree."""
    difference = clipped(best.by_scene - candidate.by_scene)
    if candidate.total < share * best.total and difference.sum() > 0:
        return True
    return bool(p_value(difference) <= RULES.alike_level and difference.sum() > nats)


def runner_up(steps: Sequence[Step[C]]) -> C | None:
    """The best candidate of the first step that is nowhere named and no look-alike of what is."""
    if not steps:
        return None
    taken = {one.effect.name for step in steps for one in (step.chosen, *step.alike)}
    return next((one for one in steps[0].ranking if one.effect.name not in taken), None)
