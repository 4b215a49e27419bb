"""Batches made by threads while the devices work on those before."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Protocol, TypeVar

Batch = TypeVar("Batch", covariant=True)


class Loader(Protocol[Batch]):
    """Batches by number."""

    def __getitem__(self, k: int, /) -> Batch: ...


def ahead(loader: Loader[Batch], start: int, stop: int, *, threads: int = 2, buffer: int = 4) -> Iterator[Batch]:
    """Batches `start` to `stop` - 1 in order; while one is used, threads make up to `buffer` more."""
    with ThreadPoolExecutor(threads) as pool:
        waiting: list[Future[Batch]] = []
        for k in range(start, stop + buffer):
            if k < stop:
                waiting.append(pool.submit(loader.__getitem__, k))
            if len(waiting) > buffer or k >= stop:
                if not waiting:
                    return
                yield waiting.pop(0).result()
