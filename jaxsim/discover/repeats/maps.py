"""Residuals of a problem, summed by scene on the polar grid, and the scales at which these maps are looked at: places,
parities and periods, and any pattern that comes back.

Every statistic of a scene is a sum over its cells, so that it changes its sign with the scene's residuals. Only some
columns of a frame are looked at, others in each frame; sums over the columns that are there, with their own phases, are
the periodogram of uneven samples (Lomb 1976, doi 10.1007/BF00648343). What aliases in one scene does not in the next,
whose columns lie elsewhere.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int, Num

from jaxsim.discover.model.evidence import Evidence
from jaxsim.discover.model.fit import Problem
from jaxsim.discover.model.noise import DEGREES
from jaxsim.discover.model.noise_levels import FINEST, lattice_step
from jaxsim.discover.model.null_model import residual_spread
from jaxsim.discover.model.random_effects import conditional_residuals
from jaxsim.discover.rules import RULES
from jaxsim.effects.rays import FLOOR, Array

MapSums = Float[np.ndarray, "n r c"]
PatternMap = Float[np.ndarray, "r c"]
MADE_HEIGHT = 0.1
"""Height of a made pattern, nats and m: far from where levels and poses are clipped."""
ROWS_OF_CELL = 4
"""Rows of a cell."""
ASLANT = (8, 16)
"""Periods over all rows, and over all columns, up to which waves that run aslant are tried."""
PER_PERIOD = 2
"""Waves along rows or columns are tried in steps of half a period over the image, from one on."""


@dataclass(frozen=True)
class Maps:
    """One channel of n scenes. Rays that are not looked at count nothing: only some columns of each frame are."""

    weight: MapSums
    """Sum over the rays of each cell of 1 / variance in the channel's unit."""
    total: MapSums
    """Weight times residual."""
    response: Callable[[PatternMap], MapSums]
    """What `total` would be if the residuals were a pattern (in the channel's unit) and nothing else, levels and poses
    fitted to it."""
    coarse: PatternMap | None = None
    """What rounding may be off by in each cell, in the channel's unit: half a step a side. Where streets are
    alike, on the road, it repeats. None where nothing is rounded."""

    def rounding(self, pattern: PatternMap) -> float:
        """How high rounding may make this pattern: `coarse` in its cells, root mean square."""
        if self.coarse is None:
            return 0.0
        counts = self.weight.sum(0) * pattern**2
        return float(np.sqrt((counts * self.coarse**2).sum() / max(counts.sum(), 1e-12)))

    def centred(self, total: MapSums) -> MapSums:
        """Each scene's weighted mean taken out: a level is no pattern, and would leak between uneven columns."""
        whole = self.weight.sum((1, 2), keepdims=True)
        return total - self.weight * total.sum((1, 2), keepdims=True) / np.maximum(whole, 1e-12)

    @classmethod
    def plain(cls, weight: MapSums, residual: MapSums) -> Maps:
        """Maps of residuals that no level takes up."""
        return cls(weight, weight * residual, lambda pattern: weight * pattern)


def maps_of(
    problem: Problem, in_fit: Float[np.ndarray, " b"], scene: Int[np.ndarray, " b"], *, columns: int
) -> dict[str, Maps]:
    """The maps of each channel: ln I in nats, range in m, and share of rays lost minus expected; shared levels follow
    from the `in_fit` blocks. `scene` is that of each block, `columns` the grid's."""
    ev, eq = problem.ev, problem.equations
    rays = RaysInCells.of(problem, in_fit, scene, columns=columns)
    sd_i, sd_r, p = residual_spread(ev, problem.noise)
    off_i, off_r = conditional_residuals(ev, eq, rays.in_fit)
    half = half_steps(ev)
    # Ln I of a reading is off by its rounding over its size: dark cells are coarse.
    light = np.maximum(np.exp(np.asarray(ev.rays.log_intensity, np.float64)), FLOOR)
    # A lost ray is a coin: residual lost - p, variance p (1 - p).
    p = np.asarray(p, np.float64)
    lost = ~np.asarray(ev.returned) - p
    weight = np.where(np.asarray(ev.rays.hit), 1 / (p * (1 - p) + RULES.repeats_least_variance), 0)
    return {
        "intensity": rays.levelled(0, eq.intensity, off_i, sd=sd_i, half_step=half["intensity"], size=light),
        "range": rays.levelled(1, eq.range_, off_r, sd=sd_r, half_step=half["range"], size=np.ones_like(light)),
        "drop": Maps(
            rays.summed(weight), rays.summed(weight * lost), lambda pattern: rays.summed(weight * rays.at(pattern))
        ),
    }


@dataclass(frozen=True)
class RaysInCells:
    """The rays of a problem, each in a cell of its scene."""

    problem: Problem
    in_fit: Float[np.ndarray, " b"]
    """1 for blocks from which shared levels follow, 0 for others."""
    cell: Int[np.ndarray, " rays"]
    """Each ray's cell in one long vector of all scenes' cells: sums by cell are one pass over the rays."""
    shape: tuple[int, int, int]
    """Scenes, rows and columns."""

    @classmethod
    def of(
        cls, problem: Problem, in_fit: Float[np.ndarray, " b"], scene: Int[np.ndarray, " b"], *, columns: int
    ) -> RaysInCells:
        """The blocks' rays, of these scenes, on a grid of so many columns."""
        row, column = np.asarray(problem.ev.rays.row), np.asarray(problem.ev.rays.column)
        shape = (int(scene.max()) + 1, row.shape[-1], columns)
        cell = np.ravel_multi_index((np.broadcast_to(scene[:, None, None], row.shape), row, column), shape).ravel()
        return cls(problem, np.asarray(in_fit, np.float32), cell, shape)

    def at(self, pattern: PatternMap) -> Float[np.ndarray, "b n r"]:
        """The height of a pattern at each ray."""
        return pattern[np.asarray(self.problem.ev.rays.row), np.asarray(self.problem.ev.rays.column)]

    def summed(self, values: np.ndarray) -> MapSums:
        """Sums by cell of the rays' values, those left out that are none."""
        flat = np.where(np.isfinite(values), values, 0).ravel()
        return np.bincount(self.cell, flat, minlength=int(np.prod(self.shape))).reshape(self.shape)

    def levelled(
        self, channel: int, weight: Array, off: Array, *, sd: Array, half_step: float, size: np.ndarray
    ) -> Maps:
        """The maps of residuals `off` of which levels and poses took their part, those of ln I (channel 0) or of range
        (1); rounding may move each by `half_step` over the `size` of its reading."""
        weights, variance = np.asarray(weight, np.float64), np.asarray(sd, np.float64) ** 2
        steeper = 1 - robust_slope(weights, variance)

        def response(pattern: PatternMap) -> MapSums:
            made = MADE_HEIGHT * self.at(pattern)
            # What stays of it in the residuals makes weights smaller, on the side to which it points.
            only = self.left_of(made - steeper * self.left_of(made, channel), channel)
            return self.summed(weights * only / MADE_HEIGHT)

        coarse = None
        if half_step:
            squares = self.summed(weights * (half_step / size) ** 2).sum(0)
            coarse = np.sqrt(squares / np.maximum(self.summed(weights).sum(0), 1e-12))
        total = self.summed(weights * np.asarray(off, np.float64))
        return Maps(self.summed(weights), total, response, coarse)

    def left_of(self, made: np.ndarray, channel: int) -> np.ndarray:
        """Residuals if measured and simulated differed by this alone: what levels and poses leave of it."""
        ev, shift = self.problem.ev, made.astype(np.float32)
        alone = replace(ev, log_intensity=ev.rays.log_intensity + shift, range_m=ev.rays.reading_m + shift)
        return np.asarray(conditional_residuals(alone, self.problem.equations, self.in_fit)[channel], np.float64)


def half_steps(ev: Evidence) -> dict[str, float]:
    """Half a step of the simulator's lattice plus half a step of the sensor's: of intensities, and of ranges in m; 0
    where neither rounds."""
    returned = np.asarray(ev.returned)
    readings = {"intensity": ev.intensity, "range": np.asarray(ev.range_m)}
    steps = {}
    for simulated, (channel, values) in zip(np.asarray(ev.own_step).tolist(), readings.items(), strict=True):
        seen = values[returned]
        step = lattice_step(
            seen[:: max(1, len(seen) // RULES.interaction_residuals)], finest=FINEST[f"{channel}_quantization"]
        )
        steps[channel] = (simulated + step) / 2
    return steps


def robust_slope(weight: np.ndarray, variance: np.ndarray) -> float:
    """How much a small shift of all residuals changes weight times residual, over the weight: less than 1, since a
    Student-t's weight (DEGREES + 1) / (DEGREES + z^2) / variance falls with the residual."""
    share = weight * np.broadcast_to(variance, weight.shape)
    slope = 2 * DEGREES / (DEGREES + 1) * share - 1
    return float((weight * slope).sum() / max(weight.sum(), 1e-12))


@dataclass(frozen=True)
class PatternScale:
    """k patterns of one kind."""

    name: str
    """row, column, cell, parity or wave; `any row`, `any column`, `any cell` ask whether maps agree in any way."""
    along: str
    """row, column, or row x column."""
    sums: Callable[[MapSums], Num[np.ndarray, "n k"]]
    """Sums of each scene and pattern; complex of waves."""
    pattern: Callable[[int, complex], PatternMap] | None
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

    def information(self, weight: MapSums) -> Float[np.ndarray, " k"]:
        """Variance of each pattern's sum over scenes and cells of these weights."""
        counted = self.sums(weight)
        if self.square is None:
            return counted.sum(0)
        return np.full(counted.shape[1], self.square * weight.sum())


def scales(rows: int, columns: int) -> list[PatternScale]:
    """All scales of a grid; places are groups of columns, `Rules.repeats_bins` of them or fewer."""
    bins = min(RULES.repeats_bins, columns)
    row, column = np.mgrid[:rows, :columns]
    bin_of = column * bins // columns
    group = row // ROWS_OF_CELL * bins + bin_of
    # Up to a period over two cells: faster waves alias.
    up = np.arange(PER_PERIOD, PER_PERIOD * rows // 2)
    across = np.arange(PER_PERIOD, PER_PERIOD * columns // 2)
    aslant = PER_PERIOD * _aslant(rows, columns)

    def of_row(total: MapSums) -> Float[np.ndarray, "n r"]:
        return total.sum(2)

    def beside(k: int) -> str:
        of = np.flatnonzero(bin_of[0] == k)
        return f"columns {of[0]} to {of[-1]}" if len(of) > 1 else f"column {of[0]}"

    def cell(k: int) -> str:
        top = k // bins * ROWS_OF_CELL
        return f"rows {top} to {min(top + ROWS_OF_CELL, rows) - 1}, {beside(k % bins)}"

    return [
        _parity("row", row, "odd rows against even ones"),
        _parity("column", column, "odd columns against even ones"),
        _parity("row x column", row + column, "a chequerboard of rows and columns"),
        PatternScale("row", "row", of_row, lambda k, _: (row == k) * 1.0, lambda k: f"row {k}"),
        PatternScale("column", "column", _sums_of(bin_of), lambda k, _: (bin_of == k) * 1.0, beside),
        PatternScale("cell", "row x column", _sums_of(group), lambda k, _: (group == k) * 1.0, cell),
        _waves("row", np.stack([up, 0 * up], 1), rows=rows, columns=columns),
        _waves("column", np.stack([0 * across, across], 1), rows=rows, columns=columns),
        _waves("row x column", aslant, rows=rows, columns=columns),
        PatternScale("any row", "row", of_row, None, lambda k: "from row to row"),
        PatternScale("any column", "column", lambda total: total.sum(1), None, lambda k: "from column to column"),
        PatternScale(
            "any cell", "row x column", lambda total: total.reshape(len(total), -1), None, lambda k: "cell by cell"
        ),
    ]


def _sums_of(label: Int[np.ndarray, "r c"]) -> Callable[[MapSums], Float[np.ndarray, "n k"]]:
    """Sums over the cells of each label."""
    flat = label.ravel()
    count = int(flat.max()) + 1
    return lambda total: np.stack([np.bincount(flat, image.ravel(), minlength=count) for image in total])


def _parity(along: str, number: Int[np.ndarray, "r c"], words: str) -> PatternScale:
    """Rays of odd `number` against those of even ones, half a height each."""
    odd = number % 2 - 0.5
    return PatternScale(
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


def _waves(along: str, steps: Int[np.ndarray, "k 2"], *, rows: int, columns: int) -> PatternScale:
    """Waves of so many steps over rows and columns, a step being the part PER_PERIOD of a period over the image."""

    def sums(total: MapSums) -> Num[np.ndarray, "n k"]:
        # An axis along which nothing turns is summed first.
        if not steps[:, 0].any():
            total = total.sum(1, keepdims=True)
        if not steps[:, 1].any():
            total = total.sum(2, keepdims=True)
        # Padded with zeros, so that the transform has parts of a period too.
        size = [PER_PERIOD * n if n > 1 else 1 for n in total.shape[1:]]
        return np.stack([np.fft.fft2(image, size)[steps[:, 0], steps[:, 1]] for image in total])

    def pattern(k: int, phase: complex) -> PatternMap:
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

    return PatternScale("wave", along, sums, pattern, words, period, formula, square=1.0, turns=turns)
