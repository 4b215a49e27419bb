"""The part of a verdict that says what its answer does on the frames that were not read for it."""

from __future__ import annotations

from dataclasses import dataclass

from jaxsim.discover.verdict.parts import Interval


@dataclass(frozen=True)
class OddFrame:
    """A frame that the answer serves ill."""

    name: str
    scene: str
    nats: float
    """What it gains by the answer, all channels together."""


@dataclass(frozen=True)
class EveryFrame:
    """What the answer does on all frames that were not read for it, because so many do not fit into memory."""

    frames: int
    scenes: int
    unseen: int
    """Of these scenes, those of which no frame helped to find or to fit anything."""
    gained: dict[str, Interval]
    """Log-likelihood by channel, nats a frame, mean over scenes."""
    gained_unseen: dict[str, Interval]
    """The same of the unseen scenes alone."""
    before: dict[str, Interval]
    """Mean errors by channel, in the units of the gap, without the answer."""
    after: dict[str, Interval]
    """The same with it."""
    worst: tuple[OddFrame, ...]
    """The frames that gain least, the least first."""
