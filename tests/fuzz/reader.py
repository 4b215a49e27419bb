"""A reader under attack: how a small valid tree of files is made, and how it is read."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class Reader:
    """One reader and the files that it reads."""

    make: Callable[[Path], None]
    """Writes the valid tree into an empty folder."""
    read: Callable[[Path], Any]
    """Reads the tree in a folder; its value is compared with the valid tree's."""
    files: tuple[str, ...] = ("**/*",)
    """Which of the files are attacked."""
    largest: float = 1e9
    """No number of a sane value is beyond it."""
    within: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Bounds of fields by name."""
    sealed: bool = False
    """Whether the files carry a digest, so that a changed value must have been noticed."""


def one(name: str, content: str | bytes) -> Callable[[Path], None]:
    """A tree of a single file."""

    def make(folder: Path) -> None:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content.encode() if isinstance(content, str) else content)

    return make
