import numpy as np
import pytest
from scipy.stats import wasserstein_distance

from jaxsim.metrics.conditional import conditional_intensity, intensity_table

SHAPE = (40, 90)


def frame(seed: int, *, gain: bool = True):
    """Intensity that falls with range and incidence and differs by class."""
    rng = np.random.default_rng(seed)
    range_m = rng.uniform(4, 60, SHAPE)
    angle = rng.uniform(0, 1.5, SHAPE)
    label = rng.choice([7, 11, 26], SHAPE)
    base = {7: 0.3, 11: 0.5, 26: 0.8}
    mean = np.vectorize(base.get)(label) * np.cos(angle) * (1 - range_m / 100)
    intensity = np.round(np.clip(mean + rng.normal(0, 0.02, SHAPE), 0, 1), 2)
    return intensity.astype(np.float32), range_m.astype(np.float32), angle.astype(np.float32), label


def table(intensity, range_m, angle, label, valid=None):
    everywhere = np.ones(intensity.shape, bool)
    valid = everywhere if valid is None else valid
    return np.asarray(
        intensity_table(intensity, range_m, angle, incidence_known=everywhere, semantic=label, valid=valid)
    )


def test_conditions_show_what_the_histogram_hides():
    measured = frame(0)
    shuffled = np.random.default_rng(1).permutation(measured[0].ravel()).reshape(SHAPE)
    scores = conditional_intensity(table(shuffled, *measured[1:]), table(*measured))
    assert scores["intensity"].distance == 0
    for given in ("class", "range", "incidence", "all"):
        score = scores[f"intensity_given_{given}"]
        assert score.distance > 3 * score.floor
        assert score.distance > 0.02
    assert scores["intensity_given_all"].distance > scores["intensity_given_range"].distance


def test_two_draws_of_one_law_score_the_floor():
    scores = conditional_intensity(table(*frame(2)), table(*frame(3)))
    for name, score in scores.items():
        assert 0.4 * score.floor < score.distance < 2.5 * score.floor, name


def test_the_distance_of_all_rays_is_scipy_s():
    a, b = frame(4), frame(5)
    dimmed = np.round(a[0] * 0.8, 2)
    scores = conditional_intensity(table(dimmed, *a[1:]), table(*b))
    want = wasserstein_distance(dimmed.ravel(), b[0].ravel())
    assert scores["intensity"].distance == pytest.approx(want, rel=1e-4)
    assert scores["intensity"].rays == b[0].size


def test_rays_that_did_not_come_back_and_thin_bins_do_not_count():
    a = frame(6)
    valid = np.zeros(SHAPE, bool)
    valid[0, :60] = True
    few = table(*a, valid)
    assert few.sum() == 60
    scores = conditional_intensity(few, few)
    assert scores["intensity"].share == 1
    assert scores["intensity_given_all"].share == 0
    assert np.isnan(scores["intensity_given_all"].distance)
    assert "intensity_given_class" not in conditional_intensity(few, few, classes=False)
    with pytest.raises(ValueError, match="no returns"):
        conditional_intensity(0 * few, few)


def test_unknown_incidence_has_a_bin_of_its_own():
    intensity, range_m, angle, label = frame(7)
    known = np.zeros(SHAPE, bool)
    got = np.asarray(intensity_table(intensity, range_m, angle, incidence_known=known, semantic=label, valid=~known))
    assert got[:, :, -1].sum() == got.sum() == intensity.size


def test_classes_of_one_side_alone_change_nothing():
    measured, simulated = frame(0), frame(2)
    unlabelled = np.zeros(SHAPE, int)
    both = conditional_intensity(table(*simulated[:3], unlabelled), table(*measured[:3], unlabelled), classes=False)
    one = conditional_intensity(table(*simulated), table(*measured[:3], unlabelled), classes=False)
    assert one == both
