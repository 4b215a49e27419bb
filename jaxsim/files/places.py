"""Errors that know what is wrong and not where: their place is told here, for all."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def placed(where: str, *more: type[Exception], then: str = "") -> Iterator[None]:
    """A ValueError of the block, or an error of a kind among `more`, becomes one that begins with `where`, as
    `train: a.json`, and ends with `then`, what to do about it."""
    try:
        yield
    except (ValueError, *more) as error:
        # Of a KeyError the words are the key alone.
        told = f"lacks {error}" if isinstance(error, KeyError) else str(error)
        raise ValueError(f"{where}: {told}{then and f'; {then}'}") from error
