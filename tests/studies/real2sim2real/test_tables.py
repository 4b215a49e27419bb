"""The loop's tables, from scores and clouds that were made up."""

from dataclasses import replace

from jaxsim.effects.chain import SensorModel
from jaxsim.studies.real2sim2real.tables import answer, loop_tables
from tests.studies.real2sim2real.made import COUNTS, clouds


def test_the_answer_says_what_intensity_was_worth_and_the_spread(scored):
    said = answer(scored)
    assert "56.0 after training on simulated intensity, 41.0 without it (+15.0" in said
    assert "standard deviation over seeds 1.4 and 1.4; over 2 seeds" in said
    one = replace(scored, config=replace(scored.config, seeds=(0,)))
    assert "one seed, so the spread is not known" in answer(one)
    assert answer(replace(scored, config=replace(scored.config, seeds=(7,)))) == "Not all detectors are scored yet."


def test_the_papers_numbers_stand_beside_ours(scored):
    SensorModel((("random_dropout", {"probability": 0.1}),)).save(scored.effects)
    text = loop_tables(scored, {kind: clouds(value) for kind, value in COUNTS.items()})
    assert "found to lack: random_dropout." in text
    assert "| simulated_64 | moderate | 9 | 56.00 ± 1.41 (51.74)" in text
    assert "| raw_64 | easy | - | - (63.78)" in text
    assert "| raw_64 | moderate | 9 | 81.00 ± 1.41 (88.78)" in text  # trained on real, scored on it
    assert "| raw_64 | 1 | 90 |" in text  # one car, 90 points on it; no car at any other distance
