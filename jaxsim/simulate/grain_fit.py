"""Learning how cells scatter together, from measured frames and what a network says of them.

Each measured intensity becomes its rank in the network's distribution for that cell (the probability integral
transform), and the rank a standard normal number z. How alike z is in cells so many columns or rows apart, on a surface
and across edges, is told by mean products; the same are taken of draws of each field that `grain` knows, on the very
same cells, and the shares of the fields are those with which the two agree best (non-negative least squares).

Of drops only the outcome is known. A ray that drops where z < a, and another where z' < b, drop together by
    P(z < a, z' < b) - P(z < a) P(z' < b) = sum over n >= 1 of rho^n / n! f(a) f(b) He_(n-1)(a) He_(n-1)(b)
(the tetrachoric series, Pearson 1900; f the normal density, He Hermite's polynomials), whose mean over couples of
cells is solved for rho.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import jax
import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import nnls
from scipy.stats import norm

from jaxsim.config import QUANTILES
from jaxsim.frame import LOST_BELOW, Pair
from jaxsim.progress import Progress
from jaxsim.simulate.grain import Breaks, Field, Grain, breaks_of, drawn_of
from jaxsim.simulate.predict import Prediction

# Numbers whose text gives no reason are conventions.
LAGS = (1, 2, 4, 8, 16, 32, 64, 128)
"""Distances in columns and rows at which cells are compared: up to twice the longest of the fields."""
BENDS_M = (0.05, 0.5)
"""Couples of cells are compared by the greatest bend of the range between them: below the first, the second, or beyond.
Also the edges that fields heed."""
FIELD_LENGTHS = (1.0, 4.0, 16.0, 64.0)
"""Lengths of the candidates, in columns; the shares mix those between which a length lies."""
ROWS_A_COLUMN = (0.25, 1.0)
"""Their lengths in rows, over those in columns: on the ground cells a row apart lie farther from each other than cells
a column apart."""
CANDIDATES = (
    Field(1.0),
    Field(1.0, None, None),
    *(Field(1.0, n, n * ratio, edge) for n in FIELD_LENGTHS for ratio in ROWS_A_COLUMN for edge in (*BENDS_M, None)),
)
OUTER = 0.002
"""Ranks are told from here to as far below 1, z within +-2.88: an intensity far off the distribution would otherwise be
worth an infinite z."""
DRAWS_OF_FIELD = 4
"""Draws of each candidate on each frame; their mean products stand for how alike it makes cells."""
FEWEST_COUPLES = 50
"""So many couples of cells of one distance, direction and bend make a mean product that counts."""
ORDERS = 24
"""Terms of the series: up to a correlation of 0.9 it is within 0.002 of what it stands for (`pytest
tests/simulate/test_grain_fit.py -k series`)."""
LEAST_FIELD_SHARE = 0.005
"""Shares of the variance below this are left out: every field that is kept is drawn for every frame."""
NO_DISTRIBUTION = (
    "grain: this run's network gives one intensity a cell, no distribution to draw from; train one with "
    "--generator.form unet"
)
FRAMES = 32
"""As many frames are looked at, evenly spread over what is given: more tell the same."""


@dataclass(frozen=True)
class GrainScan:
    """A measured frame beside what a network says of it."""

    on: Breaks
    looked: Bool[np.ndarray, "rows columns"]
    """Cells of which the network says anything."""
    back: Bool[np.ndarray, "rows columns"]
    """Cells that reported an intensity above 0, whether the network says anything of them or not."""
    intensity: Float[np.ndarray, "rows columns"]
    quantiles: Float[np.ndarray, "rows columns q"]
    drop_share: Float[np.ndarray, "rows columns"]


def learn_grain(
    predict: Callable[[Any, Pair], Prediction], params: Any, pairs: Sequence[Pair], *, scenes: Sequence[str]
) -> Grain:
    """How cells of these frames, each of a scene, scatter together about what a network says of them, which should not
    have learned from them. Raises ValueError for a network that gives no distribution, and where there are too few
    cells to tell."""
    chosen = np.unique(np.linspace(0, len(pairs) - 1, FRAMES).astype(int)) if len(pairs) else []
    bar = Progress(chosen, desc="grain", unit="frame", leave=False)
    scans = [_scan(predict(params, pairs[int(k)]), pairs[int(k)]) for k in bar]
    looked_at = dict.fromkeys(scenes[int(k)] for k in chosen)
    return Grain(fit_intensity(scans), fit_drop(scans), tuple(looked_at))


def _scan(says: Prediction, pair: Pair) -> GrainScan:
    if says.quantiles is None or says.drop_share is None:
        raise ValueError(NO_DISTRIBUTION)
    seen, value = pair.painted, np.asarray(pair.measured.intensity)
    looked = np.asarray(seen.valid)
    # A ray that reports 0 counts as lost, as in training.
    back = np.asarray(pair.measured.valid) & (value >= LOST_BELOW)
    on = breaks_of(seen.range_m, seen.valid, kind=seen.semantic, thing=seen.instance)
    return GrainScan(on, looked, back, value, np.asarray(says.quantiles), np.asarray(says.drop_share))


def fit_intensity(scans: Iterable[GrainScan]) -> tuple[Field, ...]:
    """Fields of the intensities. Raises ValueError where too few cells came back to tell."""
    sums = ProductSums()
    for k, scan in enumerate(scans):
        z = norm.ppf(ranks_of(scan.intensity, scan.quantiles))
        couples = CellCouples(scan.on, scan.looked & scan.back)
        sums.add(couples, np.stack([couples.of(z), *couples.sums(z**2)]), k=k)
    # A network may be too sure, here or there: alike is what cells are beside how far they miss at all.
    return sums.shares(lambda means: means[0] / np.sqrt(np.maximum(means[1] * means[2], 1e-9)))


def fit_drop(scans: Iterable[GrainScan]) -> tuple[Field, ...]:
    """Fields of the drops. Raises ValueError where too few cells are known to tell."""
    sums = ProductSums()
    for k, scan in enumerate(scans):
        couples = CellCouples(scan.on, scan.looked)
        # A probability of 0 or 1 has no threshold.
        share = np.clip(scan.drop_share.astype(float), 1e-4, 1 - 1e-4)
        missed = ~scan.back - share
        each = [*couples.sums(missed), *couples.sums(missed**2), *couples.sums(share * (1 - share))]
        sums.add(couples, np.stack([*each, *couples.of(np.stack([missed, *_terms(norm.ppf(share))]))]), k=k)
    return sums.shares(_of_drops)


def ranks_of(
    measured: Float[np.ndarray, "rows columns"], quantiles: Float[np.ndarray, "rows columns q"]
) -> Float[np.ndarray, "rows columns"]:
    """Share of each cell's distribution that lies below what was measured: as `drawn` has it, linear between QUANTILES
    and on beyond them."""
    rank = np.zeros(measured.shape)
    for k in range(len(QUANTILES) - 1):
        low, high = quantiles[..., k], quantiles[..., k + 1]
        piece = QUANTILES[k] + (QUANTILES[k + 1] - QUANTILES[k]) * (measured - low) / np.maximum(high - low, 1e-6)
        rank = np.where((measured >= low) | (k == 0), piece, rank)
    return np.clip(rank, OUTER, 1 - OUTER)


class CellCouples:
    """Known cells of one frame two by two, by direction, distance and what lies between them (a bin each)."""

    def __init__(self, on: Breaks, known: Bool[np.ndarray, "rows columns"]):
        self.on, self.known = on, known
        cell = np.arange(known.size).reshape(known.shape)
        self.cells: list[tuple[np.ndarray, np.ndarray]] = []
        bends = (on.down_m, on.new_down), (on.across_m, on.new_across)
        for axis in (0, 1):
            bend = np.moveaxis(np.asarray(bends[axis][0]), axis, 0)
            new = np.moveaxis(np.asarray(bends[axis][1]), axis, 0)
            index, known_along = np.moveaxis(cell, axis, 0), np.moveaxis(known, axis, 0)
            # So many cells from the first on begin anew by a bend of that size, or by another label.
            passed = [np.cumsum((bend >= least) | new, axis=0) for least in BENDS_M]
            for lag in LAGS:
                both = known_along[:-lag] & known_along[lag:]
                held = [(count[lag:] == count[:-lag])[both] for count in passed]
                # On one surface, across a bend that the first border alone tells, across an edge.
                for chosen in (held[0], held[1] & ~held[0], ~held[1]):
                    self.cells.append((index[:-lag][both][chosen], index[lag:][both][chosen]))

    def of(self, rasters: Float[np.ndarray, "*k rows columns"]) -> Float[np.ndarray, "*k bins"]:
        """Sums of the products of both cells."""
        flat = rasters.reshape(*rasters.shape[:-2], -1)
        return np.stack([(flat[..., one] * flat[..., other]).sum(-1) for one, other in self.cells], axis=-1)

    def sums(self, raster: Float[np.ndarray, "rows columns"]) -> list[Float[np.ndarray, " bins"]]:
        """Sums of the one cell, and of the other."""
        flat = raster.ravel()
        return [np.array([flat[both[k]].sum() for both in self.cells]) for k in (0, 1)]

    @property
    def count(self) -> Float[np.ndarray, " bins"]:
        return np.array([float(len(one)) for one, _ in self.cells])


class ProductSums:
    """Sums of products over frames, of what was measured and of draws of each candidate on the same cells."""

    def __init__(self) -> None:
        bins = 2 * len(LAGS) * (len(BENDS_M) + 1)
        self.couples = np.zeros(bins)
        self.measured = np.zeros(1)
        self.drawn = np.zeros((len(CANDIDATES), bins))

    def add(self, couples: CellCouples, measured: Float[np.ndarray, "n bins"], *, k: int) -> None:
        """Adds those of frame k."""
        self.couples = self.couples + couples.count
        self.measured = self.measured + measured
        for draw in range(DRAWS_OF_FIELD):
            # By the frame and the draw: learned twice, a grain is the same.
            keys = jax.random.split(jax.random.fold_in(jax.random.key(k), draw), len(CANDIDATES))
            fields = [np.asarray(drawn_of(field, couples.on, key)) for field, key in zip(CANDIDATES, keys, strict=True)]
            self.drawn = self.drawn + couples.of(np.stack(fields)) / DRAWS_OF_FIELD

    def shares(self, correlation: Callable[[np.ndarray], np.ndarray]) -> tuple[Field, ...]:
        """The candidates with the shares that explain best how alike cells are."""
        enough = self.couples >= FEWEST_COUPLES
        if not enough.any():
            raise ValueError(
                f"grain: fewer than {FEWEST_COUPLES} pairs of cells of any distance; learn from more frames"
            )
        # Least squares weigh by the root of the count: a mean of n couples has a variance of 1 / n.
        weight = np.sqrt(self.couples[enough])
        seen = np.clip(correlation(self.measured[:, enough] / self.couples[enough]), -1, 1)
        fields = (self.drawn[:, enough] / self.couples[enough]).T
        # A cell is one with itself: the shares sum to 1, a condition of great weight.
        heavy = 1e3 * weight.sum()
        design = np.concatenate([fields * weight[:, None], np.full((1, len(CANDIDATES)), heavy)])
        shares, _ = nnls(design, np.append(seen * weight, heavy))
        shares = np.where(shares < LEAST_FIELD_SHARE, 0, shares)
        shares = np.round(shares / shares.sum(), 4)
        shared = zip(CANDIDATES, shares.tolist(), strict=True)
        return tuple(replace(field, share=share) for field, share in shared if share)


def _terms(threshold: Float[np.ndarray, "rows columns"]) -> Float[np.ndarray, "orders rows columns"]:
    """Of each order f(a) He_(n-1)(a) / sqrt(n!), whose products are the series' terms."""
    # He_n / sqrt(n!) step by step: He_n and n! each for itself would leave the digits of a float.
    hermite = [np.ones_like(threshold), threshold]
    for n in range(1, ORDERS - 1):
        hermite.append((threshold * hermite[n] - np.sqrt(n) * hermite[n - 1]) / np.sqrt(n + 1))
    return np.stack([norm.pdf(threshold) * h / np.sqrt(n) for n, h in enumerate(hermite, 1)])


def _of_drops(means: Float[np.ndarray, "n bins"]) -> Float[np.ndarray, " bins"]:
    """The correlation of z with which drops are as alike as was seen; 0 where they are less alike than by chance.

    `means` are those of what was missed, of one cell and of the other, of its squares, of the variances that the
    network told, of products, and of the series' terms.
    """
    # A network may say too many drops here and too few there: alike is what is left beside that.
    variance = (means[2] - means[0] ** 2) * (means[3] - means[1] ** 2)
    seen = (means[6] - means[0] * means[1]) / np.sqrt(np.maximum(variance, 1e-9))
    rho = np.linspace(0, 1, 201)
    series = rho[:, None] ** np.arange(1, ORDERS + 1) @ means[7:] / np.sqrt(np.maximum(means[4] * means[5], 1e-9))
    # Drops are the more alike the larger rho is, so that the table is read backwards.
    return np.array([np.interp(value, of, rho) for value, of in zip(seen, series.T, strict=True)])
