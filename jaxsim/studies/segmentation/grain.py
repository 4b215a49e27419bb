"""How far rays beside each other miss the middle of a network's distribution together.

What a network does not know of a car's paint it does not know of all the cells of that car. Draws of each cell for
itself would scatter the car like noise that no sensor has, and who learns from them takes noise for a car. So each
measured value is told as its rank in the network's distribution for that cell; as a standard normal number z its
correlation between cells of one class, so many columns or rows apart, is that of a sum of Gaussian fields of several
widths, whose shares are fitted to it (non-negative least squares); and draws have the ranks of such a sum (a Gaussian
copula; Sklar 1959).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.ndimage import gaussian_filter, gaussian_filter1d
from scipy.optimize import nnls
from scipy.stats import norm

from jaxsim.config import QUANTILES
from jaxsim.data.range_images import RangeImage

LAGS = (1, 2, 4, 8, 16, 32)
"""Distances in columns and rows at which the correlation is told."""
WIDTHS = (0.0, 1.0, 2.0, 4.0, 8.0, 16.0, np.inf)
"""Standard deviations of the fields' kernels, columns; 0 is each cell for itself, infinity all cells of a class."""
ROWS_A_COLUMN = 0.5
"""How much narrower a field is along rows: on the ground, cells a row apart lie farther from each other than cells a
column apart."""
OUTER = 0.01
"""Ranks are told from here to as far below 1."""


@dataclass(frozen=True)
class Grain:
    """Share of the variance that each field of WIDTHS has; they sum to 1."""

    shares: tuple[float, ...]

    def ranks(
        self, label: Int[np.ndarray, "rows columns"], random: np.random.Generator
    ) -> Float[np.ndarray, "rows columns"]:
        """Ranks of one draw, 0..1: fields of different classes have nothing to do with each other."""
        z = np.zeros(label.shape)
        for kind in np.unique(label):
            where = label == kind
            for share, width in zip(self.shares, WIDTHS, strict=True):
                if share:
                    z[where] += np.sqrt(share) * _field(label.shape, width, random)[where]
        return norm.cdf(z).astype(np.float32)


def fit_grain(scans: Iterable[tuple[RangeImage, Float[np.ndarray, "rows columns q"]]]) -> Grain:
    """The grain of measured images about the quantiles that a network gives for them."""
    products = np.zeros((2, len(LAGS)))
    pairs = np.zeros((2, len(LAGS)))
    variance, count = 0.0, 0
    for image, quantiles in scans:
        z = np.where(image.valid, norm.ppf(ranks_of(image.intensity, quantiles)), np.nan)
        variance, count = variance + float(np.nansum(z**2)), count + int(image.valid.sum())
        for axis in (0, 1):
            for k, lag in enumerate(LAGS):
                if lag < z.shape[axis]:
                    product = _product(z, image.label, lag=lag, axis=axis)
                    products[axis, k] += np.nansum(product)
                    pairs[axis, k] += np.isfinite(product).sum()
    known = pairs > 0
    seen = products[known] / pairs[known] / max(variance / max(count, 1), 1e-6)
    weight = np.sqrt(pairs[known])
    fields = np.stack([_correlation(width) for width in WIDTHS], axis=-1)[known]
    # At no distance all fields are one with themselves: their shares sum to 1, a condition of great weight.
    design = np.concatenate([fields * weight[:, None], np.full((1, len(WIDTHS)), 1e3 * weight.sum())])
    shares, _ = nnls(design, np.append(seen * weight, 1e3 * weight.sum()))
    return Grain(tuple((shares / shares.sum()).tolist()))


def ranks_of(
    measured: Float[np.ndarray, "rows columns"], quantiles: Float[np.ndarray, "rows columns q"]
) -> Float[np.ndarray, "rows columns"]:
    """Share of each cell's distribution that lies below what was measured, linear between QUANTILES."""
    rank = np.full(measured.shape, OUTER)
    for k in range(len(QUANTILES) - 1):
        low, high = quantiles[..., k], quantiles[..., k + 1]
        part = np.clip((measured - low) / np.maximum(high - low, 1e-6), 0, 1)
        rank = np.where(measured >= low, QUANTILES[k] + (QUANTILES[k + 1] - QUANTILES[k]) * part, rank)
    return np.clip(np.where(measured > quantiles[..., -1], 1 - OUTER, rank), OUTER, 1 - OUTER)


def _product(z: np.ndarray, label: np.ndarray, *, lag: int, axis: int) -> np.ndarray:
    """z of a cell times that of the cell so far on, where both are of one class and came back."""
    one, other = (np.moveaxis(z, axis, 0)[:-lag], np.moveaxis(z, axis, 0)[lag:])
    same = np.moveaxis(label, axis, 0)[:-lag] == np.moveaxis(label, axis, 0)[lag:]
    return np.where(same, one * other, np.nan)


def _correlation(width: float) -> Float[np.ndarray, "2 lags"]:
    """Of a field's cells, so many rows and columns apart."""
    if width in (0.0, np.inf):
        return np.full((2, len(LAGS)), float(width > 0))
    one = np.zeros(2 * LAGS[-1] + 12 * int(width) + 1)
    one[len(one) // 2] = 1
    found = []
    for sigma in (ROWS_A_COLUMN * width, width):
        kernel = gaussian_filter1d(one, sigma)
        found.append([kernel[lag:] @ kernel[:-lag] / (kernel @ kernel) for lag in LAGS])
    return np.array(found)


def _field(shape: tuple[int, int], width: float, random: np.random.Generator) -> Float[np.ndarray, "rows columns"]:
    """Standard normal, as smooth as the width says. It goes on from one border to the opposite one, so that it is
    alike everywhere."""
    if width == np.inf:
        return np.full(shape, random.normal())
    field = random.normal(size=shape)
    if not width:
        return field
    sigma = (ROWS_A_COLUMN * width, width)
    smooth = gaussian_filter(field, sigma, mode="wrap")
    one = np.zeros(12 * int(width) + 1)
    one[len(one) // 2] = 1
    # White noise through a kernel has the sum of its squares for a variance, in each direction.
    return smooth / np.sqrt(np.prod([(gaussian_filter1d(one, s) ** 2).sum() for s in sigma]))
