"""Training in memory: many small networks, none of which is a run with a folder, checkpoints and a card (`loop`)."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, TypeVar

import numpy as np

from jaxsim.progress import Progress

_State = TypeVar("_State")
_Batch = TypeVar("_Batch")


def descend(
    step: Callable[[_State, _Batch, int], tuple[_State, Any]],
    state: _State,
    batches: Iterable[_Batch],
    *,
    steps: int,
    by: str,
) -> _State:
    """The state after a step on each batch; `step` takes (state, batch k, k) and gives the next state and its loss.

    There are `steps` batches; `by` begins messages and names the bar. Raises ValueError where a loss is not finite.
    """
    bar = Progress(batches, total=steps, desc=f"{by} learns", unit="step", leave=False)
    for k, batch in enumerate(bar):
        state, loss = step(state, batch, k)
        if not np.isfinite(float(loss)):
            raise ValueError(f"{by}: the loss of step {k} is {float(loss)}; lower the rate (lr)")
        bar.set_postfix(loss=f"{float(loss):.3f}", refresh=False)
    return state
