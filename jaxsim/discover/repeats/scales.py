"""The scales at which maps of residuals are looked at: places, parities and periods, and any pattern that comes back.

Every statistic of a scene is a sum over its cells, so that it changes its sign with the scene's residuals. Only some
columns of a frame are looked at, others in each frame; sums over the columns that are there, with their own phases, are
the periodogram of uneven samples (Lomb 1976, doi 10.1007/BF00648343). What aliases in one scene does not in the next,
whose columns lie elsewhere.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int, Num

from jaxsim.discover.repeats.maps import Pattern, Sums

ROWS_OF_CELL = 4
"""Rows of a cell."""
ASLANT = (8, 16)
"""Periods over all rows, and over all columns, up to which waves that run aslant are tried."""
PER_PERIOD = 2
"""Waves along rows or columns are tried in steps of half a period over the image, from one on."""


@dataclass(frozen=True)
class Scale:
    """k patterns of one kind."""

    name: str
    """row, column, cell, parity or wave; `any row`, `any column`, `any cell` ask whether maps agree in any way."""
    along: str
    """row, column, or row x column."""
    sums: Callable[[Sums], Num[np.ndarray, "n k"]]
    """Sums of each scene and pattern; complex of waves."""
    pattern: Callable[[int, complex], Pattern] | None
    """The k-th, of height 1; a wave with the phase of a sum. None where all of them together are asked about."""
    words: Callable[[int], str]
    """The place or period."""
    period: Callable[[int], float | None] = lambda k: None
    """Period in rows or columns."""
    formula: Callable[[int, complex], str] | None = None
    """Formula of a wave of height 1."""
    square: float | None = None
    """Mean square of what a cell counts with in each pattern; None where it counts with 1 or not at all."""
    turns: Callable[[int], tuple[float, float]] | None = None
    """Turns of a wave: its periods in a row, and in a column."""

    def information(self, weight: Sums) -> Float[np.ndarray, " k"]:
        """Variance of each pattern's sum over scenes and cells of these weights."""
        counted = self.sums(weight)
        if self.square is None:
            return counted.sum(0)
        return np.full(counted.shape[1], self.square * weight.sum())


def scales(rows: int, columns: int, *, bins: int) -> list[Scale]:
    """All scales of a grid; places are groups of columns, `bins` of them: as many as a frame shows columns."""
    bins = min(bins, columns)
    row, column = np.mgrid[:rows, :columns]
    place = column * bins // columns
    group = row // ROWS_OF_CELL * bins + place
    # Up to a period over two cells: faster waves alias.
    up = np.arange(PER_PERIOD, PER_PERIOD * rows // 2)
    across = np.arange(PER_PERIOD, PER_PERIOD * columns // 2)
    aslant = PER_PERIOD * _aslant(rows, columns)

    def of_row(total: Sums) -> Float[np.ndarray, "n r"]:
        return total.sum(2)

    def beside(k: int) -> str:
        of = np.flatnonzero(place[0] == k)
        return f"columns {of[0]} to {of[-1]}" if len(of) > 1 else f"column {of[0]}"

    def cell(k: int) -> str:
        top = k // bins * ROWS_OF_CELL
        return f"rows {top} to {min(top + ROWS_OF_CELL, rows) - 1}, {beside(k % bins)}"

    return [
        _parity("row", row, "odd rows against even ones"),
        _parity("column", column, "odd columns against even ones"),
        _parity("row x column", row + column, "a chequerboard of rows and columns"),
        Scale("row", "row", of_row, lambda k, _: (row == k) * 1.0, lambda k: f"row {k}"),
        Scale("column", "column", _sums_of(place), lambda k, _: (place == k) * 1.0, beside),
        Scale("cell", "row x column", _sums_of(group), lambda k, _: (group == k) * 1.0, cell),
        _waves("row", np.stack([up, 0 * up], 1), rows=rows, columns=columns),
        _waves("column", np.stack([0 * across, across], 1), rows=rows, columns=columns),
        _waves("row x column", aslant, rows=rows, columns=columns),
        Scale("any row", "row", of_row, None, lambda k: "from row to row"),
        Scale("any column", "column", lambda total: total.sum(1), None, lambda k: "from column to column"),
        Scale("any cell", "row x column", lambda total: total.reshape(len(total), -1), None, lambda k: "cell by cell"),
    ]


def _sums_of(label: Int[np.ndarray, "r c"]) -> Callable[[Sums], Float[np.ndarray, "n k"]]:
    """Sums over the cells of each label."""
    flat = label.ravel()
    count = int(flat.max()) + 1
    return lambda total: np.stack([np.bincount(flat, one.ravel(), minlength=count) for one in total])


def _parity(along: str, number: Int[np.ndarray, "r c"], words: str) -> Scale:
    """Rays of odd `number` against those of even ones, half a height each."""
    odd = number % 2 - 0.5
    return Scale(
        "parity",
        along,
        lambda total: np.einsum("nrc,rc->n", total, odd)[:, None],
        lambda k, _: odd,
        lambda k: words,
        lambda k: 2.0,
        square=0.25,
    )


def _aslant(rows: int, columns: int) -> Int[np.ndarray, "k 2"]:
    """Whole periods over the rows (up or down) and over the columns."""
    # Half of the plane suffices: a wave and its mirror image are one.
    up, across = min(ASLANT[0], rows // 2), min(ASLANT[1], columns // 2)
    return np.array([(i, j) for i in range(-up, up + 1) if i for j in range(1, across + 1)], int).reshape(-1, 2)


def _waves(along: str, steps: Int[np.ndarray, "k 2"], *, rows: int, columns: int) -> Scale:
    """Waves of so many steps over rows and columns, a step being the part PER_PERIOD of a period over the image."""

    def sums(total: Sums) -> Num[np.ndarray, "n k"]:
        # An axis along which nothing turns is summed first.
        if not steps[:, 0].any():
            total = total.sum(1, keepdims=True)
        if not steps[:, 1].any():
            total = total.sum(2, keepdims=True)
        # Padded with zeros, so that the transform has parts of a period too.
        size = [PER_PERIOD * n if n > 1 else 1 for n in total.shape[1:]]
        return np.stack([np.fft.fft2(one, size)[steps[:, 0], steps[:, 1]] for one in total])

    def pattern(k: int, phase: complex) -> Pattern:
        row, column = np.mgrid[:rows, :columns]
        turn = (steps[k, 0] * row / rows + steps[k, 1] * column / columns) / PER_PERIOD
        return np.cos(2 * np.pi * turn + np.angle(phase))

    def words(k: int) -> str:
        up, across = steps[k] / PER_PERIOD
        parts = [f"{abs(n):g} over the {name}" for n, name in ((up, "rows"), (across, "columns")) if n]
        return f"periods: {' and '.join(parts)}"

    def period(k: int) -> float | None:
        up, across = steps[k] / PER_PERIOD
        return float(columns / across) if across else float(rows / abs(up))

    def turns(k: int) -> tuple[float, float]:
        up, across = steps[k] / PER_PERIOD
        return float(up / rows), float(across / columns)

    def formula(k: int, phase: complex) -> str:
        up, across = steps[k] / PER_PERIOD
        parts = [f"{n:g}·{name}/{size}" for n, name, size in ((up, "row", rows), (across, "column", columns)) if n]
        return f"cos(2π·({' + '.join(parts)}) {np.angle(phase):+.3g})"

    return Scale("wave", along, sums, pattern, words, period, formula, square=1.0, turns=turns)
