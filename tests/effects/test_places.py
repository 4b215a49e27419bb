"""Rays by their places, and what lies beside them: at borders, and where a turn closes."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from beartype.roar import BeartypeCallHintParamViolation
from jaxtyping import TypeCheckError

from jaxsim.effects import all_rays
from jaxsim.effects.places import longest_run, neighbours_m, on_turn, rays_at, within_turn
from tests.effects.streets import grid_of, road_and_walls


def test_columns_past_the_border_are_those_of_the_other_side_or_the_border_itself():
    column = jnp.arange(-2, 6, dtype=jnp.int32)
    assert on_turn(column, 4, jnp.array(True)).tolist() == [2, 3, 0, 1, 2, 3, 0, 1]
    assert on_turn(column, 4, jnp.array(False)).tolist() == [0, 0, 0, 1, 2, 3, 3, 3]


def test_a_run_goes_on_past_the_seam_of_a_closed_ring_alone():
    flags = np.array([1, 1, 0, 1, 0, 1, 1, 1], bool)
    assert longest_run(flags, closed=True).tolist() == [5, 6, 7, 8, 9]
    assert longest_run(flags, closed=False).tolist() == [5, 6, 7]
    assert longest_run(np.ones(3, bool), closed=True).tolist() == [0, 1, 2]


def test_azimuths_lie_within_half_a_turn_to_each_side():
    assert within_turn(1.5 * np.pi) == pytest.approx(-0.5 * np.pi)
    assert within_turn(-1.5 * np.pi) == pytest.approx(0.5 * np.pi)
    assert within_turn(0.3) == pytest.approx(0.3)


@pytest.mark.parametrize("turn_rad", [2 * np.pi, np.pi])
def test_neighbours_are_those_of_the_image_one_by_one(turn_rad):
    scan = road_and_walls(grid_of(turn_rad, rows=6, columns=16))
    found = np.asarray(neighbours_m(scan))
    range_m = np.where(scan.hit, scan.range_m, np.inf)
    _, rows, columns = range_m.shape
    for row in range(rows):
        for column in range(columns):
            aside = [column - 1, column + 1]
            if turn_rad == 2 * np.pi:
                aside = [one % columns for one in aside]
            aside = np.clip(aside, 0, columns - 1)
            above = np.clip([row - 1, row + 1], 0, rows - 1)
            expected = [*range_m[0, row, aside], *range_m[0, above, column]]
            np.testing.assert_array_equal(found[0, row, column], expected)


def test_rays_at_some_places_are_those_of_all():
    scan = road_and_walls(frames=2)
    places = (np.array([0, 1]), np.array([3, 20]), np.array([0, 95]))
    chosen = rays_at(scan, tuple(jnp.asarray(index, jnp.int32) for index in places))
    for some, every in zip(jax.tree.leaves(chosen), jax.tree.leaves(all_rays(scan)), strict=True):
        np.testing.assert_array_equal(some, every[places] if np.ndim(every) else every)


def test_shapes_of_places_are_checked():
    scan = road_and_walls()
    frame, row = jnp.zeros(3, jnp.int32), jnp.zeros(2, jnp.int32)
    with pytest.raises((TypeCheckError, BeartypeCallHintParamViolation)):
        rays_at(scan, (frame, row, frame))
