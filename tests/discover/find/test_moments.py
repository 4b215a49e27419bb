"""Steps of all intensities in time, read off the levels of scenes."""

import numpy as np
import pytest
from scipy.stats import ttest_ind

from jaxsim.discover.find.moments import levels_by_scene, moments_of, spans_of, standard_errors, steps_in_time
from tests.discover.switched import problem_with

pytestmark = pytest.mark.usefixtures("standard_promotion")


@pytest.mark.parametrize(("first", "last", "edges"), [(5, 9, 2), (6, 15, 1)])
def test_a_gain_that_switches_steps_where_it_does(first, last, edges):
    factor = np.where((np.arange(16) >= first) & (np.arange(16) <= last), 0.7, 1.0)
    problem = problem_with(factor)
    steps = steps_in_time(problem)
    assert len(steps) == edges
    # Frames are 30 s apart, and some of them are not looked at: the first that is there is told.
    begun, _ = moments_of(problem)
    inside = begun[(begun >= 30 * first) & (begun <= 30 * last)]
    assert steps[0] == inside.min()
    assert all(step > 30 * last for step in steps[1:])


@pytest.mark.parametrize(
    "factor", [np.ones(16), np.where(np.arange(16) % 2, 0.7, 1.0), np.exp(np.linspace(0, 0.6, 16))]
)
def test_what_does_not_switch_or_drifts_has_no_step(factor):
    assert steps_in_time(problem_with(factor)) == ()


def test_scenes_that_share_their_moments_tell_no_step():
    factor = np.where(np.arange(16) >= 8, 0.7, 1.0)
    # Each scene has an early and a late frame.
    assert steps_in_time(problem_with(factor, scenes=tuple(f"{k % 8}" for k in range(16)))) == ()


def test_a_scenes_level_is_what_its_frames_are_brighter_by():
    factor = np.exp(np.where(np.arange(16) >= 8, 0.3, 0.0))
    problem = problem_with(factor)
    begun, _ = moments_of(problem)
    level = levels_by_scene(problem)
    assert level[begun >= 240].mean() - level[begun < 240].mean() == pytest.approx(0.3, abs=0.05)


def test_spans_are_contiguous_and_leave_scenes_outside():
    spans = spans_of(6)
    assert {tuple(np.flatnonzero(span)) for span in spans} == {
        (1, 2), (1, 2, 3), (1, 2, 3, 4), (2, 3), (2, 3, 4), (2, 3, 4, 5), (3, 4), (3, 4, 5), (4, 5),
    }  # fmt: skip


def test_standard_errors_are_those_of_students_test():
    level = np.random.default_rng(0).normal(size=(9, 4))
    spans = spans_of(9)
    expected = [[abs(ttest_ind(one[span], one[~span]).statistic) for one in level.T] for span in spans]
    np.testing.assert_allclose(standard_errors(spans, level), expected, rtol=1e-9)
