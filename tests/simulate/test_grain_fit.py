"""What is learned of fields that are known: draws must be as alike as what they were learned from."""

import jax
import numpy as np
import pytest
from scipy.stats import multivariate_normal, norm

from jaxsim.config import QUANTILES
from jaxsim.frame import Pair, PolarImage
from jaxsim.simulate import grain_fit
from jaxsim.simulate.grain import Field, Ranks, ranks_of_fields
from jaxsim.simulate.grain_fit import fit_drop, fit_intensity, learn_grain, ranks_of
from jaxsim.simulate.predict import Prediction, drawn
from tests.simulate.made_grain import (
    SHAPE,
    beside,
    by_loops,
    drop_shares,
    in_blocks,
    painted,
    quantiles,
    ranges,
    scan,
)


def mixed(random: np.random.Generator, *, wall: int | None = None) -> np.ndarray:
    """Three tenths each cell's own, the rest a field that goes on for 12 columns and 3 rows."""
    return np.sqrt(0.7) * by_loops(random, columns=12, rows=3, wall=wall) + np.sqrt(0.3) * random.normal(size=SHAPE)


def drawn_z(fields: tuple[Field, ...], on, count: int = 12) -> np.ndarray:
    return norm.ppf([ranks_of_fields(fields, on, key) for key in jax.random.split(jax.random.key(9), count)])


def alike(z: np.ndarray, lag: int, axis: int) -> float:
    return float(np.mean([beside(one, lag, axis) for one in z]))


def test_intensities_drawn_are_as_alike_as_those_of_a_known_field():
    made = [mixed(np.random.default_rng(k)) for k in range(10)]
    scans = [scan(z, np.full(SHAPE, 9.0)) for z in made]
    fields = fit_intensity(scans)
    ours = drawn_z(fields, scans[0].on)
    for lag, axis in ((1, 1), (4, 1), (16, 1), (1, 0), (4, 0)):
        assert alike(ours, lag, axis) == pytest.approx(alike(made, lag, axis), abs=0.08)
    assert sum(field.share for field in fields) == pytest.approx(1, abs=1e-3)


def test_a_field_without_the_form_of_ours_is_met_between_its_distances():
    made = [in_blocks(np.random.default_rng(k), share=0.7) for k in range(10)]
    scans = [scan(z, np.full(SHAPE, 9.0)) for z in made]
    ours = drawn_z(fit_intensity(scans), scans[0].on)
    # Blocks end and fields of first order fade.
    for lag, axis in ((1, 1), (2, 1), (4, 1), (16, 1), (1, 0)):
        assert alike(ours, lag, axis) == pytest.approx(alike(made, lag, axis), abs=0.15)


def test_cells_that_scatter_each_for_itself_stay_so():
    random = np.random.default_rng(0)
    scans = [scan(random.normal(size=SHAPE), random.normal(size=SHAPE)) for _ in range(6)]
    for fields in (fit_intensity(scans), fit_drop(scans)):
        assert sum(field.share for field in fields if field.single) > 0.93


def test_what_ends_at_an_edge_is_learned_to_heed_edges():
    made = [mixed(np.random.default_rng(k), wall=60) for k in range(16)]
    scans = [scan(z, np.full(SHAPE, 9.0), wall=60) for z in made]
    ours = drawn_z(fit_intensity(scans), scans[0].on, 100)
    across = np.corrcoef(ours[:, :, 59].ravel(), ours[:, :, 60].ravel())[0, 1]
    assert across < 0.25
    assert alike(ours[:, :, :59], 1, 1) == pytest.approx(alike([z[:, :59] for z in made], 1, 1), abs=0.1)


def test_drops_drawn_are_as_alike_as_those_of_a_known_field():
    made = [mixed(np.random.default_rng(k)) for k in range(16)]
    scans = [scan(np.zeros(SHAPE), z) for z in made]
    fields = fit_drop(scans)
    keys = jax.random.split(jax.random.key(2), 40)
    ours = [np.asarray(ranks_of_fields(fields, scans[0].on, key)) < drop_shares() for key in keys]
    theirs = [~scan(np.zeros(SHAPE), mixed(np.random.default_rng(k))).back for k in range(100, 140)]
    # Beside what the share alone makes alike.
    missed = [[lost - drop_shares() for lost in side] for side in (ours, theirs)]
    for lag, axis in ((1, 1), (4, 1), (16, 1), (1, 0), (4, 0)):
        assert alike(missed[0], lag, axis) == pytest.approx(alike(missed[1], lag, axis), abs=0.06)


@pytest.mark.parametrize("rho", [0.2, 0.6, 0.9])
def test_the_series_is_the_probability_of_two_drops(rho):
    a, b = -0.8, 0.3
    both = multivariate_normal([0, 0], [[1, rho], [rho, 1]]).cdf([a, b]) - norm.cdf(a) * norm.cdf(b)
    terms = grain_fit._terms(np.array([[a, b]]))[:, 0]
    series = (rho ** np.arange(1, grain_fit.ORDERS + 1) * terms[:, 0] * terms[:, 1]).sum()
    assert series == pytest.approx(both, abs=2e-3)


def test_ranks_are_those_whose_draw_is_what_was_measured():
    told = np.broadcast_to(np.array([0.1, 0.2, 0.4, 0.5, 0.7], np.float32), (1, 400, len(QUANTILES)))
    value = np.linspace(0.08, 0.73, 400, dtype=np.float32)[None]
    rank = ranks_of(value, told)
    says = Prediction(told[..., 2], np.zeros((1, 400), bool), told, np.zeros((1, 400), np.float32))
    again = drawn(says, jax.random.key(0), Ranks(rank.astype(np.float32), rank.astype(np.float32)))
    np.testing.assert_allclose(np.asarray(again), value, atol=0.0051)
    assert (np.diff(rank) >= 0).all()
    outer = ranks_of(np.array([[0.4, -9, 9]]), told[:, :3])
    assert outer[0].tolist() == pytest.approx([0.5, grain_fit.OUTER, 1 - grain_fit.OUTER])


def pairs(count: int) -> list[Pair]:
    found = []
    for k in range(count):
        one = scan(mixed(np.random.default_rng(k)), by_loops(np.random.default_rng(99 + k), columns=9, rows=9))
        nothing = np.zeros(SHAPE, np.float32)
        measured = PolarImage(ranges(), one.intensity, one.back)
        found.append(Pair(painted(ranges()), nothing, nothing, one.intensity * one.back, measured))
    return found


def says(params, pair) -> Prediction:
    told = quantiles()
    return Prediction(told[..., 2], drop_shares() > 0.5, told, drop_shares())


def test_a_grain_is_learned_from_pairs_and_says_of_which_drives(monkeypatch):
    monkeypatch.setattr(grain_fit, "FRAMES", 4)
    grain = learn_grain(says, None, pairs(9), scenes=[f"drive_{k}" for k in range(9)])
    assert grain.scenes == ("drive_0", "drive_2", "drive_5", "drive_8")
    own = [sum(field.share for field in fields if field.single) for fields in (grain.intensity, grain.drop)]
    assert own[0] == pytest.approx(0.3, abs=0.12)
    assert own[1] < 0.2


def test_a_network_without_a_distribution_and_too_few_cells_are_refused():
    plain = lambda params, pair: Prediction(np.zeros(SHAPE), np.zeros(SHAPE, bool))  # noqa: E731
    with pytest.raises(ValueError, match=r"no distribution to draw from; train one with --generator\.form unet"):
        learn_grain(plain, None, pairs(1), scenes=["drive"])
    with pytest.raises(ValueError, match="fewer than 50 pairs of cells of any distance; learn from more frames"):
        learn_grain(says, None, [], scenes=[])
