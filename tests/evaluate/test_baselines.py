"""Baselines: each learns what it is for, from cells that count alone; and what intervals over scenes say of them."""

import numpy as np
import pytest

from jaxsim.evaluate.baselines import fit_baselines, fit_trees, previous_frame
from jaxsim.evaluate.intensity import baseline_sums
from jaxsim.metrics.paired import group_medians, total_scores
from tests.evaluate.made import SHAPE, street

pytestmark = pytest.mark.long

TRAIN = [street(seed) for seed in range(6)]
JUDGED = [street(seed) for seed in range(10, 14)]


@pytest.fixture(scope="module")
def errors():
    sums = baseline_sums(TRAIN, JUDGED, [None] * len(JUDGED), trees=True)
    return {name: total_scores(frames)["mae"].value for name, frames in sums.items()}, sums


def test_what_sees_more_errs_less(errors):
    of, _ = errors
    assert of["per-row median"] < of["global median"]
    assert of["trees, a cell"] < 0.5 * of["per-row median"]
    assert of["trees, context"] < 0.5 * of["per-row median"]


def test_trees_know_which_lines_are_lost(errors):
    _, sums = errors
    assert total_scores(sums["trees, a cell"])["drop_f1"].value > 0.8


def test_the_table_takes_the_line_where_it_has_seen_too_few_cells():
    near = [p.replace(painted=p.painted.replace(range_m=np.full(SHAPE, 5, np.float32))) for p in TRAIN]
    fitted = fit_baselines(near)
    far = JUDGED[0].replace(painted=JUDGED[0].painted.replace(range_m=np.full(SHAPE, 50, np.float32)))
    np.testing.assert_array_equal(
        fitted["range, incidence, row"](far).intensity, fitted["per-row median"](far).intensity
    )


def test_cells_that_do_not_count_are_never_read():
    broken = []
    for pair in TRAIN:
        counts = pair.painted.valid & pair.measured.valid
        measured = pair.measured.replace(intensity=np.where(counts, pair.measured.intensity, np.float32(np.nan)))
        broken.append(pair.replace(measured=measured))
    clean, other = fit_baselines(TRAIN), fit_baselines(broken)
    for name in clean:
        np.testing.assert_array_equal(clean[name](JUDGED[0]).intensity, other[name](JUDGED[0]).intensity)


def test_group_medians_are_numpys():
    random = np.random.default_rng(0)
    value, group = random.random((7, 9)), random.integers(0, 4, (7, 9))
    every = np.ones((7, 9), bool)
    found = group_medians([(value, every, every, group), (1 - value, every, every, group)], 6)
    for k in range(4):
        both = np.concatenate([value[group == k], 1 - value[group == k]])
        assert found.intensity[k] == pytest.approx(np.median(both))
        assert found.count[k] == len(both)
    assert found.intensity[5] == pytest.approx(0.5)
    with pytest.raises(ValueError, match="no training cell"):
        group_medians([(value, ~every, every, group)], 4)


def test_the_previous_frame_is_copied_and_filled():
    before = JUDGED[0]
    guess = previous_frame(before, 0.3)
    back = before.measured.valid
    np.testing.assert_array_equal(guess.intensity[back], before.measured.intensity[back])
    np.testing.assert_array_equal(guess.intensity[~back], np.float32(0.3))
    assert guess.drops[~back].all()


def test_trees_without_scikit_learn_say_what_to_install(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "sklearn.ensemble", None)
    with pytest.raises(ModuleNotFoundError, match=r"jaxsim-lidar\[trees\]"):
        fit_trees(TRAIN, context=False)
