"""What was named, fitted together, with laws for what no effect describes."""

import numpy as np
import pytest

from tests.discover.toy import FAR_M

pytestmark = [pytest.mark.long, pytest.mark.usefixtures("standard_promotion")]


def test_what_was_named_is_fitted_on_top_of_what_is_known(stages):
    added = stages.completed.added
    assert [name for name, _ in added.effects_model.effects] == ["random_dropout", "range_offset"]
    [offset] = added.parameters
    [interval] = offset.values()
    assert interval.low < FAR_M < interval.high


def test_where_nothing_repeats_and_no_curve_is_left_the_answer_stays(stages):
    assert stages.completed.repeats == ()
    assert stages.completed.added.learned is None
    assert stages.completed.answer.verdict == stages.asked.answer.verdict == "named"


def test_the_answers_problem_has_what_was_added_in_place(stages):
    before = np.asarray(stages.placed.found.null_model.problem.ev.rays.reading_m)
    after = np.asarray(stages.completed.answer.choice.problem.ev.rays.reading_m)
    hit = np.asarray(stages.placed.found.null_model.problem.ev.rays.hit)
    np.testing.assert_allclose((after - before)[hit], FAR_M, atol=0.005)
