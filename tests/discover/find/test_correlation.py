"""Whether intensities of two sides are related: of made surfaces, of strangers, of a simulator without any."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.discover.find.correlation import correlations, of_ranges, unrelated
from jaxsim.effects import EFFECTS

pytestmark = pytest.mark.usefixtures("standard_promotion")


def told(evidence, simulated, measured, surfaces: int = 20):
    """The evidence with made intensities of made surfaces."""
    shape = np.asarray(evidence.compared).shape
    strip = np.arange(np.prod(shape)).reshape(shape) % (len(shape) * surfaces)
    block = np.arange(shape[0])[:, None, None] * surfaces + strip % surfaces
    return replace(
        evidence,
        compared=np.ones(shape, bool),
        strip=block,
        surface=np.arange(shape[0] * surfaces),
        log_intensity=measured[block],
        rays=replace(evidence.rays, log_intensity=jnp.asarray(simulated[block])),
    )


@pytest.fixture
def levels():
    return np.random.default_rng(0).normal(0, 0.5, (2, 6 * 20))


def test_sides_of_one_street_are_related(evidence, levels):
    by_scene = correlations(told(evidence, levels[0], 2 * levels[0] + 0.3 * levels[1]))
    assert by_scene.min() > 0.8
    assert unrelated(by_scene) is None


def test_strangers_are_told(evidence, levels):
    by_scene = correlations(told(evidence, levels[0], levels[1]))
    assert np.abs(by_scene).max() < 0.6
    assert "no relation beyond chance" in (unrelated(by_scene) or "")


def test_a_simulator_without_intensities_is_no_stranger(evidence, levels):
    by_scene = correlations(told(evidence, 0 * levels[0], levels[1]))
    assert np.isnan(by_scene).all()
    assert unrelated(by_scene) is None


def test_few_scenes_say_nothing():
    assert unrelated(np.array([-0.2, 0.1, np.nan, 0.0])) is None


def test_effects_that_intensities_alone_show():
    left_out = {name for name, effect in EFFECTS.items() if not of_ranges(effect)}
    assert {"saturation", "gamma_response", "specular_lobe", "window_contamination", "blooming"} <= left_out
    assert not {"extrinsic_rotation", "fog_backscatter", "range_noise", "random_dropout"} & left_out
