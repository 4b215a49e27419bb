import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from skimage.metrics import peak_signal_noise_ratio, structural_similarity

from jaxsim.metrics import paired_scores, paired_sums
from jaxsim.metrics.paired import difference_of, frame_sums, group_levels, scene_intervals, ssim_map

SHAPE = (24, 40)


def frames(seed: int):
    rng = np.random.default_rng(seed)
    y = np.round(rng.beta(2, 5, SHAPE), 2).astype(np.float32)
    x = np.clip(y + rng.normal(0, 0.1, SHAPE), 0, 0.99).astype(np.float32)
    return x, y, rng


def scores(x, y, returned, m):
    return paired_scores(paired_sums(x, x < 0.005, y, returned=returned, m=m))


def test_scores_equal_scikit_image_where_every_cell_counts():
    x, y, _ = frames(1)
    everywhere = np.ones(SHAPE, bool)
    got = scores(x, y, everywhere, everywhere)
    assert got["mae"].value == pytest.approx(np.abs(x - y).mean(), rel=1e-5)
    assert got["psnr"].value == pytest.approx(peak_signal_noise_ratio(y, x, data_range=1.0), rel=1e-5)
    assert got["mae"].count == x.size
    _, want = structural_similarity(
        y, x, data_range=1.0, gaussian_weights=True, sigma=1.5, use_sample_covariance=False, full=True
    )
    inner = (
        slice(5, -5),
        slice(5, -5),
    )  # at the border scikit-image reflects, we leave out what is not there
    np.testing.assert_allclose(np.asarray(ssim_map(x, y, everywhere))[inner], want[inner], atol=2e-4)


@pytest.mark.parametrize("level", [0.01, 0.3, 0.99])
def test_an_image_is_never_more_like_itself_than_1(level):
    x = np.full(SHAPE, level, np.float32)
    similarity = np.asarray(ssim_map(x, x, np.ones(SHAPE, bool)))
    assert 1 - 1e-4 < similarity.min() <= similarity.max() < 1 + 1e-6


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**31))
def test_what_lies_in_masked_cells_changes_no_score(seed):
    x, y, rng = frames(seed)
    m = rng.random(SHAPE) < 0.7
    returned = rng.random(SHAPE) < 0.8
    m[0, 0] = returned[0, 0] = True
    garbage = np.where(m & returned, y, rng.random(SHAPE)).astype(np.float32)
    noise = np.where(m, x, rng.random(SHAPE)).astype(np.float32)
    first, second = scores(x, y, returned, m), scores(noise, garbage, returned, m)
    for name in first:
        assert first[name].value == pytest.approx(second[name].value, rel=1e-4, nan_ok=True), name


def test_sums_add_up_over_frames():
    x, y, rng = frames(3)
    m = rng.random(SHAPE) < 0.6
    returned = rng.random(SHAPE) < 0.8
    both = paired_sums(
        *(np.stack([a, b]) for a, b in ((x, y), (x < 0.005, y < 0.005), (y, x))),
        returned=np.stack([returned, m]),
        m=np.stack([m, returned]),
    )
    one = paired_sums(x, x < 0.005, y, returned=returned, m=m)
    two = paired_sums(y, y < 0.005, x, returned=m, m=returned)
    for name in both:
        assert float(both[name]) == pytest.approx(float(one[name]) + float(two[name]), rel=1e-5)


def test_drops_are_scored_by_hand_counted_cells():
    y = np.array([[0.0, 0.3, 0.4, 0.0]], np.float32)
    returned = np.array([[True, True, False, False]])
    x = np.array([[0.0, 0.0, 0.2, 0.0]], np.float32)
    got = scores(x, y, returned, np.ones((1, 4), bool))
    # Dropped: 0 (reported 0), 2, 3. Guessed: 0, 1, 3. Hits: 0 and 3.
    assert got["drop_iou"].value == pytest.approx(2 / 4)
    assert got["drop_f1"].value == pytest.approx(2 * 2 / (3 + 3))
    assert got["mae"].value == pytest.approx((0.0 + 0.3) / 2)


def test_no_cell_to_score_is_an_error_and_not_a_number():
    x, y, _ = frames(4)
    nowhere = np.zeros(SHAPE, bool)
    with pytest.raises(ValueError, match="no cell"):
        scores(x, y, nowhere, nowhere)


def test_levels_are_those_of_returned_cells_and_the_majority_decides_the_drop():
    intensity = np.array([0.2, 0.4, 0.9, 0.5], np.float32)
    returned = np.array([True, True, False, False])
    levels = group_levels(intensity, returned, np.array([0, 0, 1, 1]), groups=3)
    np.testing.assert_allclose(levels.mean, [0.3, 0.3, 0.3], rtol=1e-6)
    np.testing.assert_allclose(levels.median, [0.3, 0.3, 0.3], rtol=1e-6)
    assert levels.drops.tolist() == [False, True, False]
    assert levels.count.tolist() == [2, 0, 0]
    with pytest.raises(ValueError, match="no training cell"):
        group_levels(intensity, np.zeros(4, bool), np.zeros(4, int), groups=1)


def test_levels_of_groups_are_numpys():
    random = np.random.default_rng(0)
    value, group = random.random(126), random.integers(0, 4, 126)
    found = group_levels(value, np.ones(126, bool), group, groups=6)
    for k in range(4):
        assert found.median[k] == pytest.approx(np.median(value[group == k]))
        assert found.mean[k] == pytest.approx(value[group == k].mean())
        assert found.count[k] == (group == k).sum()
    assert (found.mean[5], found.median[5]) == pytest.approx((value.mean(), np.median(value)))


def test_scenes_in_which_nothing_is_scored_make_no_interval_narrower():
    x, y, _ = frames(5)
    every = np.ones(SHAPE, bool)
    scored = [frame_sums(x, x < 0.005, y=y, returned=every, m=rows) for rows in (every, np.triu(every))]
    lost = frame_sums(x, x < 0.005, y=y, returned=~every, m=every)
    alone, with_lost = (scored, ["a", "b"]), ([*scored, lost, lost], ["a", "b", "c", "d"])
    assert scene_intervals(*with_lost)["mae"] == scene_intervals(*alone)["mae"]
    better = [frame_sums(y, y < 0.005, y=y, returned=every, m=every)] * 2
    assert difference_of(with_lost[0], [*better, lost, lost], with_lost[1]) == difference_of(scored, better, "ab")
    assert scene_intervals([scored[0], lost], ["a", "b"]) == {}
    assert np.isnan(difference_of([scored[0], lost], [better[0], lost], ["a", "b"])[1:]).all()
