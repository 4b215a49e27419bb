"""What a pattern is as a law of the sensor model: which numbers of it are fitted, and the `Learned` that they make."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from jaxsim.discover.repeats.find import FoundPattern
from jaxsim.discover.repeats.maps import Pattern, Sums
from jaxsim.effects.learned import LIMITS, Learned

Heights = Float[np.ndarray, " m"]


@dataclass(frozen=True)
class RepeatForm:
    """A pattern before its m heights are fitted."""

    found: FoundPattern
    count: int
    """How many heights there are."""
    spread: Callable[[Heights], Pattern]
    """The pattern of so many heights."""
    gather: Callable[[Sums], Float[np.ndarray, "n m"]]
    """The transpose of `spread`, scene by scene: how much the heights have to do with each scene's cells."""
    information: Callable[[Pattern], Heights]
    """Information on each height alone, of these weights of the cells."""
    variance: float
    """Variance of the heights, where they are many and share one: how large the pattern is. Infinite where each is its
    own."""

    def learned(self, heights: Heights, sd: Heights) -> Learned:
        """The law of fitted heights."""
        channel, scale = self.found.repeat.channel, self.found.scale
        if scale.turns:
            turns = scale.turns(self.found.number)
            used = [(name, (turn,)) for name, turn in zip(("row", "column"), turns, strict=True) if turn]
            # A wave of drops swings about a level of its own height: both together stay a probability.
            limit = LIMITS[channel][1] / (2 if channel == "drop" else 1)
            values = np.clip(heights, -limit, limit)
            names, knots = zip(*used, strict=True)
            return Learned(channel, "wave", names, knots, _plain(values), _plain(sd))
        if scale.name == "parity":
            names = tuple(f"even {name}s" for name in ("row", "column") if name in scale.along)
            # Two rows and two columns hold all of a parity.
            corner = self.spread(heights)[:2, :2]
            spread = self.spread(sd)[:2, :2]
            cut = np.ix_(*([0, 1] if name in scale.along else [0] for name in ("row", "column")))
            knots = ((0.0, 1.0),) * len(names)
            return Learned(channel, "table", names, knots, _allowed(corner[cut], channel), _plain(np.abs(spread[cut])))
        return _table(self.spread(heights), self.spread(sd), along=scale.along, channel=channel)


def form_of(found: FoundPattern, rows: int, columns: int) -> RepeatForm:
    """The form of a pattern on a grid of so many rows and columns."""
    scale, k = found.scale, found.number
    if scale.pattern is None:
        shape = [count if name in scale.along else 1 for name, count in (("row", rows), ("column", columns))]
        alone = tuple(axis + 1 for axis, count in enumerate(shape) if count == 1)

        def gather(total: Sums) -> Float[np.ndarray, "n m"]:
            return total.sum(alone, keepdims=True).reshape(len(total), -1)

        def spread(heights: Heights) -> Pattern:
            return np.broadcast_to(heights.reshape(shape), (rows, columns))

        size = found.repeat.size.value
        return RepeatForm(found, int(np.prod(shape)), spread, gather, lambda weight: gather(weight[None])[0], size**2)
    # A wave is free in its phase: its cosine and its sine.
    phases = (1, -1j) if scale.turns else (1,)
    made = np.stack([scale.pattern(k, one) for one in phases])
    return RepeatForm(
        found,
        len(made),
        lambda heights: np.einsum("m,mrc->rc", heights, made),
        lambda total: np.einsum("nrc,mrc->nm", total, made),
        lambda weight: np.einsum("rc,mrc->m", weight, made**2),
        np.inf,
    )


def _table(pattern: Pattern, sd: Pattern, *, along: str, channel: str) -> Learned:
    """A number for each row, column or cell that the pattern changes."""
    axes = [axis for axis, name in enumerate(("row", "column")) if name in along]
    # Along the other axis it is the same everywhere.
    for axis in {0, 1}.difference(axes):
        pattern, sd = pattern.take([0], axis), sd.take([0], axis)
    pattern = np.array(_allowed(pattern, channel)).reshape(pattern.shape)
    used = [np.flatnonzero(pattern.any(1 - axis)) for axis in (0, 1)]
    cut = np.ix_(*used)
    names = tuple(("row", "column")[axis] for axis in axes)
    knots = tuple(_plain(used[axis]) for axis in axes)
    return Learned(channel, "table", names, knots, _plain(pattern[cut]), _plain(np.abs(sd[cut])))


def _allowed(values: np.ndarray, channel: str) -> tuple[float, ...]:
    """The heights within what a law may change; of echoes no share below none is lost, so all are told above the
    least."""
    low, high = LIMITS[channel]
    return _plain(np.clip(values - min(values.min(), 0.0) if channel == "drop" else values, low, high))


def _plain(numbers: np.ndarray) -> tuple[float, ...]:
    return tuple(float(f"{number:.6g}") for number in np.ravel(numbers))
