"""An answer in plain values: what judge scenes do not gain by is in neither verdict nor sensor model."""

from dataclasses import replace

import pytest

from jaxsim.discover.stages.conclude import result_of, verdict_of
from jaxsim.effects.chain import SensorModel

pytestmark = [pytest.mark.long, pytest.mark.usefixtures("standard_promotion")]
GIVEN = SensorModel((("random_dropout", {"probability": 0.01}),))


def told(stages, **changed):
    shown = replace(stages.shown, **changed)
    return result_of(stages.asked, stages.divided, stages.completed, shown=shown, given=GIVEN, seconds=1.5)


def test_a_confirmed_effect_is_in_verdict_and_sensor_model(stages):
    result = told(stages)
    assert [effect.name for effect in result.verdict.effects] == ["range_offset"]
    assert result.effects_model.names == ("random_dropout", "range_offset")
    assert result.verdict.seconds == 1.5
    assert not any(note.startswith("simulated surfaces are off") for note in result.verdict.notes)
    assert any(note.startswith("beside what the sensor model already had: random_dropout,")
               for note in result.verdict.notes)  # fmt: skip


def test_the_gap_of_the_effects_channel_closes(stages):
    gap = told(stages).verdict.gap["range"]
    assert gap.after < gap.before
    assert told(stages).maps_before is stages.shown.maps[0]


def test_what_judge_scenes_do_not_gain_by_is_in_neither(stages):
    judged = stages.shown.judged
    lost = {name: replace(gap, gained=replace(gap.gained, value=-1.0, low=-2.0, high=0.0))
            for name, gap in judged.gap.items()}  # fmt: skip
    result = told(stages, judged=replace(judged, gap=lost))
    assert result.verdict.verdict == "none"
    assert [effect.name for effect in result.verdict.unconfirmed] == ["range_offset"]
    assert result.effects_model.names == ("random_dropout",)


def test_before_it_is_held_against_judge_scenes_a_verdict_has_all_that_was_found(stages):
    verdict = verdict_of(stages.asked, stages.divided, stages.completed, shown=stages.shown, given=GIVEN, seconds=0.0)
    assert [effect.name for effect in verdict.effects] == ["range_offset"]
    assert (verdict.control, verdict.contrast, verdict.unrelated) == (None, None, False)
