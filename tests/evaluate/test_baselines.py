"""Baselines: each learns what it is for, from cells that count alone; and what intervals over scenes say of them."""

import weakref

import jax
import numpy as np
import pytest
from beartype.roar import BeartypeCallHintParamViolation
from jaxtyping import TypeCheckError

from jaxsim.evaluate.baselines import fit_baselines, fit_trees, previous_frame
from jaxsim.evaluate.intensity import baseline_sums
from jaxsim.metrics.paired import total_scores
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


def test_a_line_is_told_by_its_place_in_the_sensor_wherever_a_window_begins():
    """Of two cameras one sees the lines from the third on: row 0 of its window is another laser."""
    whole, cut = TRAIN[0], jax.tree.map(lambda leaf: leaf[2:], TRAIN[0])
    of_whole, of_both = fit_baselines([whole]), fit_baselines([whole, cut])
    for name in ("per-row mean", "per-row median", "range, incidence, row"):
        both = of_both[name](whole).intensity
        np.testing.assert_allclose(both, of_whole[name](whole).intensity, rtol=1e-6)
        np.testing.assert_array_equal(of_both[name](cut).intensity, both[2:])
    # A line that training had not: what all cells do.
    stranger = cut.replace(row_share=cut.row_share + np.float32(0.01))
    for kind in ("mean", "median"):
        of_line, of_all = of_whole[f"per-row {kind}"], of_whole[f"global {kind}"]
        np.testing.assert_array_equal(of_line(stranger).intensity, of_all(stranger).intensity)


def test_pairs_that_can_be_read_once_alone_are_refused():
    """Trees would be fitted to none of them, after the tables had read all."""
    with pytest.raises((TypeCheckError, BeartypeCallHintParamViolation)):
        baseline_sums((pair for pair in TRAIN), JUDGED, [None] * len(JUDGED))


def test_training_pairs_are_read_once_and_one_at_a_time():
    made = []

    def pairs():
        for seed in range(6):
            pair = street(seed)
            made.append(weakref.ref(pair.target))
            assert sum(target() is not None for target in made) <= 2
            yield pair

    once, held = fit_baselines(pairs()), fit_baselines(TRAIN)
    for name in held:
        np.testing.assert_array_equal(once[name](JUDGED[0]).intensity, held[name](JUDGED[0]).intensity)


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
