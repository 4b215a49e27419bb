"""The few ways in which effects change rays, where formulas could break."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.effects import all_rays
from jaxsim.effects.edits import add_intensity, either, is_one_of, lose, misread, move_sensor, wrapped
from tests.effects.streets import clutter_of_everything


@pytest.fixture(scope="module")
def rays():
    return all_rays(clutter_of_everything())


def test_angles_are_brought_within_a_turn_with_a_derivative_of_one():
    angle = jnp.asarray([-9.0, -0.5, 3.0, 4.0, 12.6])
    np.testing.assert_allclose(
        jnp.exp(1j * wrapped(angle).astype(complex)), jnp.exp(1j * angle.astype(complex)), atol=1e-5
    )
    assert np.abs(wrapped(angle)).max() <= np.pi
    np.testing.assert_array_equal(jax.vmap(jax.grad(wrapped))(angle), 1)


def test_a_sensor_that_is_moved_slides_along_planes_where_their_slopes_are_told_and_is_cast_again_elsewhere(rays):
    to_m = (jnp.float32(0.1), jnp.float32(-0.2), jnp.float32(0.05))
    moved = move_sensor(rays, to_m)
    np.testing.assert_allclose(moved.moved_m, np.broadcast_to([0.1, -0.2, 0.05], moved.moved_m.shape))
    np.testing.assert_array_equal(moved.reading_m, rays.reading_m)
    slope = jnp.asarray(np.random.default_rng(0).normal(size=moved.moved_m.shape), jnp.float32)
    slid = move_sensor(replace(rays, origin_slope=slope), to_m)
    along = 0.1 * slope[..., 0] - 0.2 * slope[..., 1] + 0.05 * slope[..., 2]
    np.testing.assert_allclose(slid.reading_m - rays.reading_m, np.where(rays.hit, along, 0), atol=1e-5)
    np.testing.assert_array_equal(slid.moved_m, rays.moved_m)


def test_losses_that_follow_one_another_are_independent(rays):
    twice = lose(lose(rays, jnp.full(rays.range_m.shape, 0.2)), jnp.full(rays.range_m.shape, 0.5))
    np.testing.assert_allclose(jnp.exp(twice.log_keep - rays.log_keep), 0.4, rtol=1e-5)
    np.testing.assert_allclose(either(jnp.float32(0.2), jnp.float32(0.5)), 0.6)


def test_what_is_added_is_added_to_the_reading_and_stays_above_the_floor(rays):
    dark = replace(rays, log_intensity=jnp.full(rays.range_m.shape, -90.0))
    added = jnp.full(rays.range_m.shape, 0.05)
    for before in (rays, dark):
        _, slope = jax.jvp(lambda x, rays=before: add_intensity(rays, x, 0.01).log_intensity, [added], [added])
        assert np.isfinite(slope).all()
        reading = np.exp(np.asarray(before.log_intensity, float))
        after = add_intensity(before, added, 0.01)
        np.testing.assert_allclose(np.exp(np.asarray(after.log_intensity)), reading + 0.05, rtol=1e-5)
    after = add_intensity(rays, jnp.full(rays.range_m.shape, -2.0), 0.01)
    assert (after.log_intensity <= rays.log_intensity + 1e-6).all()
    lit = np.asarray(rays.log_intensity) > np.log(0.011)
    np.testing.assert_allclose(np.exp(np.asarray(after.log_intensity)[lit]), 0.01, rtol=1e-3)


def test_only_rays_that_hit_something_are_misread(rays):
    after = misread(rays, jnp.full(rays.range_m.shape, 0.1))
    np.testing.assert_allclose(after.reading_m - rays.reading_m, np.where(rays.hit, 0.1, 0), atol=2e-5)


def test_classes_are_told_by_their_ids(rays):
    some = tuple(np.unique(np.asarray(rays.semantic))[:2].tolist())
    np.testing.assert_array_equal(is_one_of(rays, some), np.isin(np.asarray(rays.semantic), some))
