"""Averages of what was scored and the loop's tables, beside the paper's."""

import json
from dataclasses import replace

import numpy as np
import pytest

from jaxsim.effects.chain import SensorModel
from jaxsim.metrics.detection import PRINTED_COLUMNS, Curve
from jaxsim.studies.real2sim2real import CLOUD_KINDS, claim_loop
from jaxsim.studies.real2sim2real.scores import (
    PAPER_OF_REAL,
    PAPER_ON_REAL,
    answer,
    loop_tables,
    read_average,
    write_score,
)
from jaxsim.train.experiments import load_loop
from tests.studies.real2sim2real.made import COUNTS, clouds


def curve(ap: float, *, difficulty="moderate", metric="3d", overlap_set="0.7", truths=10):
    precision = np.zeros(41)
    precision[1:] = ap / 100
    return Curve("Car", difficulty, overlap_set, metric, 0.7, precision, np.zeros(0), np.zeros(0), truths, 12)


@pytest.fixture
def loop(tmp_path):
    config, _ = load_loop("real2sim2real")
    return claim_loop(replace(config, out=tmp_path / "loop", seeds=(0, 1)))


def test_the_papers_tables_are_whole():
    for table in (PAPER_ON_REAL, PAPER_OF_REAL):
        assert all(len(row) == len(PRINTED_COLUMNS) for kind in table.values() for row in kind.values())
    assert PAPER_ON_REAL["simulated_64"]["moderate"][0] == 51.74
    assert {*PAPER_OF_REAL} < {*CLOUD_KINDS}


def test_an_average_is_over_epochs_and_its_spread_over_seeds(loop):
    for seed, aps in ((0, (40.0, 50.0)), (1, (60.0, 70.0))):
        write_score(loop.score("raw_64", "real", seed), [[curve(ap)] for ap in aps], steps=(5, 6), frames=3)
    found = read_average(loop, "raw_64", "real", column=("3d", "0.7"), difficulty="moderate")
    assert found is not None
    assert (found.mean, found.seeds, found.labels) == (pytest.approx(55), 2, 10)
    assert found.spread == pytest.approx(np.std([45, 65], ddof=1))
    one = replace(loop, config=replace(loop.config, seeds=(1,)))
    alone = read_average(one, "raw_64", "real", column=("3d", "0.7"), difficulty="moderate")
    assert alone is not None
    assert (alone.mean, alone.spread) == (pytest.approx(65), None)
    assert read_average(loop, "raw_32", "real", column=("3d", "0.7"), difficulty="moderate") is None


def test_a_difficulty_without_labels_has_no_average(loop):
    nothing = curve(0, difficulty="easy", truths=0)
    write_score(loop.score("raw_64", "real", 0), [[nothing]], steps=(5,), frames=3)
    assert read_average(loop, "raw_64", "real", column=("3d", "0.7"), difficulty="easy") is None


def test_the_answer_says_what_intensity_was_worth_and_the_spread(scored):
    said = answer(scored)
    assert "56.0 after training on simulated intensity, 41.0 without it (+15.0" in said
    assert "standard deviation over seeds 1.4 and 1.4; over 2 seeds" in said
    one = replace(scored, config=replace(scored.config, seeds=(0,)))
    assert "one seed, so the spread is not known" in answer(one)
    assert answer(replace(scored, config=replace(scored.config, seeds=(7,)))) == "Not all detectors are scored yet."


def test_the_answer_compares_the_seeds_that_both_have_of_kinds_that_are_asked(scored):
    scored.score("simulated_64", "real", 0).unlink()
    assert "one seed" in (said := answer(scored))
    # Seed 1 alone, of both.
    assert "57.0 after training on simulated intensity, 42.0 without it (+15.0; one seed" in said
    without = replace(scored, config=replace(scored.config, kinds=("raw_64", "raw_32")))
    assert answer(without).endswith("of simulated_64 and raw_64, no simulated_64.")


def test_where_no_label_counts_the_answer_says_so(loop):
    for kind in ("raw_64", "simulated_64"):
        nothing = curve(0, truths=0)
        write_score(loop.score(kind, "real", 0), [[nothing]], steps=(5,), frames=3)
    assert answer(loop).startswith("No label of Car in the real clouds counts as moderate")


def test_the_papers_numbers_stand_beside_ours(scored):
    SensorModel((("random_dropout", {"probability": 0.1}),)).save(scored.effects)
    text = loop_tables(scored, {kind: clouds(value) for kind, value in COUNTS.items()})
    assert "found to lack: random_dropout." in text
    assert "| simulated_64 | moderate | 9 | 56.00 ± 1.41 (51.74)" in text
    assert "| raw_64 | easy | - | - (63.78)" in text
    assert "| raw_64 | moderate | 9 | 81.00 ± 1.41 (88.78)" in text  # trained on real, scored on it
    assert "| raw_64 | 1 | 90 |" in text  # one car, 90 points on it; no car at any other distance


@pytest.mark.parametrize(
    "changed", [{"ap_r40": {"3d 0.7 easy": 130.0}}, {"ap_r40": [1]}, {"labels": {"easy": "7"}}, {"steps": 3}]
)
def test_scores_that_cannot_be_are_refused(scored, changed):
    path = scored.score("raw_64", "real", 0)
    content = json.loads(path.read_text())
    content["checkpoints"][0] |= changed
    path.write_text(json.dumps(content))
    with pytest.raises(ValueError, match=r"raw_64_on_real\.json must hold 'checkpoints'"):
        answer(scored)
