"""The recast that effects of geometry share gives what each gives on its own."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.discover.model.gradients import DIFFERENTIATED, effect_with_gradient, gradient_in_z, with_effect
from jaxsim.discover.model.parameters import to_values, to_z
from jaxsim.effects import EFFECTS, all_rays
from jaxsim.effects.chain import apply_law
from tests.discover.toy import device, toy
from tests.quick import quick_jit

pytestmark = pytest.mark.usefixtures("standard_promotion")
ROWS = 16
GEOMETRY = {
    "extrinsic_rotation": {"yaw_rad": 0.02, "pitch_rad": -0.01, "roll_rad": 0.01},
    "extrinsic_translation": {"x_m": 0.1, "y_m": -0.05, "z_m": 0.1},
    "beam_elevation_error": {"error_rad": 0.004 * np.sin(np.arange(ROWS))},
    "beam_azimuth_error": {"error_rad": 0.004 * np.cos(np.arange(ROWS))},
    "motion_distortion": {"share": 0.7},
}


@pytest.fixture(scope="module")
def street(standard_promotion):
    (scan,) = device(toy(frames=2, rows=ROWS)[0])
    return scan, jax.jit(all_rays)(scan)


@pytest.mark.long
@pytest.mark.parametrize("name", [*GEOMETRY, "beam_gain"])
def test_rays_and_slopes_are_the_effects_own(name, street):
    scan, rays = street
    effect = EFFECTS[name]
    z = to_z(effect, GEOMETRY.get(name, {"gain": 0.1 * np.cos(np.arange(ROWS))}), ROWS)

    def alone(z):
        after = apply_law(effect, to_values(effect, z), rays, scan=scan)
        seen = {field: jnp.asarray(getattr(after, field), jnp.float32) for field in DIFFERENTIATED}
        return seen, after

    def both(z, slopes):
        seen, back, after = jax.vjp(alone, z, has_aux=True)
        return seen, after, back(slopes)[0]

    rng = np.random.default_rng(0)
    shapes = jax.eval_shape(alone, z)[0]
    slopes = {field: jnp.asarray(rng.normal(0, 1, leaf.shape), jnp.float32) for field, leaf in shapes.items()}
    seen, after, expected = quick_jit(both)(z, slopes)

    got, taken, back = effect_with_gradient(effect, z, rays, scan=scan)
    for field in DIFFERENTIATED:
        np.testing.assert_allclose(got[field], seen[field], rtol=1e-4, atol=1e-4, err_msg=field)
    for field, value in taken.items():
        np.testing.assert_allclose(value, getattr(after, field), rtol=1e-4, atol=1e-4, err_msg=field)
    moved = with_effect(effect, z, rays, scan=scan)
    np.testing.assert_allclose(moved.range_m, after.range_m, rtol=1e-5, atol=1e-4)
    np.testing.assert_allclose(moved.turned_rad, after.turned_rad, atol=1e-6)
    by_z = gradient_in_z(back, slopes)
    for key, slope in expected.items():
        np.testing.assert_allclose(by_z[key], slope, rtol=2e-3, atol=2e-3 * np.abs(slope).max(), err_msg=key)
        assert np.abs(slope).max() > 0
