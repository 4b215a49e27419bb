"""Judge scenes say nothing of effects that are not there."""

import numpy as np
import pytest

from jaxsim.discover.find import find_dependences
from jaxsim.discover.read import Comparison, Division
from jaxsim.discover.show import judge
from jaxsim.discover.verdict import CurveLine
from tests.discover.toy import toy

FRAMES = 12


@pytest.fixture(scope="module")
def shown(standard_promotion):
    scan, measured = toy(FRAMES)
    names = tuple(f"frame {k}" for k in range(FRAMES))
    division = Division.of(Comparison(scan, measured, names, names))
    null = find_dependences(division).null
    return judge(division, null, [], noise=null.noise)


def test_without_an_effect_the_gap_stays_and_there_is_no_closure(shown):
    assert shown.closure is None
    for gap in shown.gap.values():
        assert gap.before == gap.after == gap.placebo
        assert gap.gained.value == 0
    assert shown.curves == ()


def test_maps_before_and_after_are_then_the_same(shown):
    for channel, before in shown.maps_before.items():
        np.testing.assert_array_equal(before, shown.maps_after[channel])


def test_frames_are_shown_ray_by_ray_with_the_residuals_that_the_maps_are_means_of(shown):
    assert 1 <= len(shown.frames) <= 4
    assert len({frame.name for frame in shown.frames}) == len(shown.frames)
    for frame in shown.frames:
        cells = frame.row * 10_000 + frame.column
        assert len(np.unique(cells)) == len(cells) > 100
        assert (frame.range_m > 0).all()
        for channel, before in frame.before.items():
            np.testing.assert_array_equal(before, frame.after[channel])
        # A lost ray has no reading to compare.
        assert np.isnan(frame.before["range"][~frame.returned]).all()
        assert abs(np.nanmean(frame.before["range"])) < 0.05


def test_rays_fall_into_the_groups_of_a_curve():
    x = np.array([0.5, 1.5, 3.0])
    curve = CurveLine("range", "row", "m", x, x, x, x, edges=np.array([0.0, 1.0, 2.0, np.inf]))
    assert curve.group_of(np.array([[0.0, 0.9], [1.0, 7.0]])).tolist() == [[0, 0], [1, 2]]
    assert CurveLine("range", "row", "m", x, x, x, x).group_of(x).tolist() == [-1, -1, -1]
