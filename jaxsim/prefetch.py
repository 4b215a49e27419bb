"""What is needed next is made while what is at hand is worked on: batches, frames, pairs, whoever makes them."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, Future
from itertools import islice
from typing import Any, TypeVar

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")


def prefetch(
    pool: Executor, make: Callable[[_Item], _Result], items: Iterable[_Item], *, ahead: int = 1
) -> Iterator[_Result]:
    """What `make` makes of each item, in their order; up to `ahead` more are being made in the pool or wait.

    The first are asked of the pool at once, before any is taken. What spoils one is raised when its turn comes; what
    has not begun by then, or when no more are taken, is not made.
    """
    left = iter(items)
    waiting = deque(pool.submit(make, item) for item in islice(left, ahead + 1))
    taken = _taken(waiting, (pool.submit(make, item) for item in left))
    next(taken)  # into its `try`: dropped before the first is taken, it cancels what waits, too
    return taken


def _taken(waiting: deque[Future[_Result]], more: Iterator[Future[_Result]]) -> Iterator[Any]:
    """None, and then the results."""
    try:
        yield None
        while waiting:
            yield waiting.popleft().result()
            waiting.extend(islice(more, 1))
    finally:
        for future in waiting:
            future.cancel()
