"""The street on which effects are tried: what its rays meet, by the plainest geometry."""

import numpy as np

from jaxsim.effects.street import ALBEDO, CAR, HEIGHT_M, HOUSE, POLE, ROAD, SIGN, TREE, small_street


def test_the_road_lies_level_under_the_sensor_and_follows_lambert():
    scan = small_street()
    road = np.asarray(scan.hit) & (np.asarray(scan.semantic) == ROAD)
    down = np.sin(np.asarray(scan.grid.elevation_rad))[None, :, None] + 0 * scan.range_m
    np.testing.assert_allclose(-(down * scan.range_m)[road], HEIGHT_M, rtol=1e-4)
    np.testing.assert_allclose(np.asarray(scan.intensity)[road], -ALBEDO[ROAD] * down[road], rtol=1e-4)


def test_every_kind_of_thing_is_met_and_the_sky_gives_nothing_back():
    scan = small_street()
    hit = np.asarray(scan.hit)
    assert {*np.unique(np.asarray(scan.semantic)[hit])} == {ROAD, HOUSE, POLE, SIGN, TREE, CAR}
    assert not hit.all()


def test_it_is_the_same_at_every_call():
    one, other = small_street(frames=2, rows=8, columns=60), small_street(frames=2, rows=8, columns=60)
    np.testing.assert_array_equal(one.range_m, other.range_m)
    assert one.range_m.shape == (2, 8, 60)
