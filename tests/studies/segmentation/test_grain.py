"""Draws that scatter together as measured rays do, against ranks that were made with known correlations."""

import numpy as np
import pytest
from scipy.stats import norm

from jaxsim.config import QUANTILES
from jaxsim.data.range_images import RangeImage
from jaxsim.studies.segmentation.grain import WIDTHS, Grain, fit_grain, ranks_of

SHAPE = (32, 256)


def an_image(intensity: np.ndarray, label: np.ndarray) -> RangeImage:
    away = np.full(SHAPE, 5, np.float32)
    return RangeImage("x", np.zeros((*SHAPE, 3), np.float32), away, intensity, label, np.ones(SHAPE, bool))


def quantiles() -> np.ndarray:
    """Those of ln I about ln 0.3, which differ from cell to cell in width."""
    width = np.linspace(0.05, 0.2, SHAPE[1])[None, :, None]
    return np.broadcast_to(0.3 * np.exp(width * norm.ppf(QUANTILES)), (*SHAPE, len(QUANTILES))).astype(np.float32)


def in_blocks(random: np.random.Generator, *, share: float) -> np.ndarray:
    """z of which a share belongs to blocks of 4 x 8 cells and the rest to each cell: made without a kernel."""
    blocks = random.normal(size=(SHAPE[0] // 4, SHAPE[1] // 8)).repeat(4, 0).repeat(8, 1)
    return np.sqrt(share) * blocks + np.sqrt(1 - share) * random.normal(size=SHAPE)


def beside(z: np.ndarray, lag: int) -> float:
    """Correlation of cells so many columns apart."""
    return float(np.corrcoef(z[:, :-lag].ravel(), z[:, lag:].ravel())[0, 1])


def scattered(share: float, seeds: range) -> Grain:
    label, q = np.ones(SHAPE, np.int32), quantiles()
    scans = []
    for seed in seeds:
        u = norm.cdf(in_blocks(np.random.default_rng(seed), share=share))
        cells = zip(u.ravel(), q.reshape(-1, len(QUANTILES)), strict=True)
        value = np.array([np.interp(rank, QUANTILES, of_cell) for rank, of_cell in cells])
        scans.append((an_image(value.reshape(SHAPE).astype(np.float32), label), q))
    return fit_grain(scans)


def test_draws_have_the_correlation_of_what_they_were_fitted_to():
    grain = scattered(0.7, range(12))
    label = np.ones(SHAPE, np.int32)
    drawn = norm.ppf(np.clip([grain.ranks(label, np.random.default_rng(100 + k)) for k in range(12)], 0.01, 0.99))
    made = [in_blocks(np.random.default_rng(200 + k), share=0.7) for k in range(12)]
    # Blocks have edges and the fitted fields have none: in between they differ.
    for lag, within in ((1, 0.08), (2, 0.08), (4, 0.13), (16, 0.08)):
        assert np.mean([beside(z, lag) for z in drawn]) == pytest.approx(
            np.mean([beside(z, lag) for z in made]), abs=within
        )
    assert np.std(drawn) == pytest.approx(1, abs=0.06)


def test_cells_that_scatter_each_for_itself_stay_so():
    grain = scattered(0.0, range(6))
    assert dict(zip(WIDTHS, grain.shares, strict=True))[0.0] > 0.95


def test_what_a_whole_class_shares_is_shared_by_the_class_alone():
    label = np.ones(SHAPE, np.int32)
    label[:, 100:] = 2
    ranks = Grain((0.0,) * (len(WIDTHS) - 1) + (1.0,)).ranks(label, np.random.default_rng(0))
    assert len(np.unique(ranks[:, :100])) == len(np.unique(ranks[:, 100:])) == 1
    assert ranks[0, 0] != ranks[0, -1]


def test_ranks_are_shares_of_the_distribution():
    q = np.broadcast_to(np.linspace(0.1, 0.5, len(QUANTILES)), (1, 4, len(QUANTILES)))
    measured = np.array([[0.0, 0.1, 0.3, 0.9]])
    middle = float(np.interp(0.3, q[0, 0], QUANTILES))
    assert ranks_of(measured, q)[0] == pytest.approx([0.01, max(QUANTILES[0], 0.01), middle, 0.99])
