"""Whether intensities of two sides are related: of made surfaces, of strangers, of a simulator without any."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.discover.find.correlation import correlations, of_one_material, of_ranges, unrelated
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


def lit(evidence, law):
    """The evidence with rays at random ranges and angles, and what a law makes of them."""
    rng = np.random.default_rng(3)
    shape = np.asarray(evidence.compared).shape
    range_m, incidence_rad = rng.uniform(2, 80, shape), rng.uniform(0, 1.55, shape)
    log_intensity = jnp.asarray(np.log(np.maximum(law(range_m, incidence_rad, rng), 1e-3)).astype(np.float32))
    rays = {"range_m": range_m, "incidence_rad": incidence_rad, "log_intensity": log_intensity}
    return replace(evidence, compared=np.ones(shape, bool), rays=replace(evidence.rays, **rays))


@pytest.mark.parametrize(
    ("law", "told"),
    [
        (lambda r, a, rng: 0.3 * np.cos(a), True),
        (lambda r, a, rng: np.exp(-0.02 * r), True),
        (lambda r, a, rng: 0.9 * np.cos(a) * np.minimum(1, (10 / r) ** 2), True),
        (lambda r, a, rng: rng.choice([0.2, 0.5], r.shape) * np.cos(a), False),
        (lambda r, a, rng: 0.3 * np.cos(a) * np.exp(rng.normal(0, 0.3, r.shape)), False),
        (lambda r, a, rng: np.full(r.shape, 0.4), False),
    ],
)
def test_a_law_of_range_and_angle_alone_has_no_materials(evidence, law, told):
    assert bool(of_one_material(lit(evidence, law))) == told


def test_of_one_material_surfaces_need_no_relation_but_must_not_speak_against_it():
    chance = np.random.default_rng(1).normal(0.02, 0.2, 12)
    assert unrelated(chance) is not None
    assert unrelated(chance, one_material=True) is None
    assert unrelated(chance - 0.8, one_material=True) is not None


def test_few_scenes_say_nothing():
    assert unrelated(np.array([-0.2, 0.1, np.nan, 0.0])) is None


def test_effects_that_intensities_alone_show():
    left_out = {name for name, effect in EFFECTS.items() if not of_ranges(effect)}
    assert {"saturation", "gamma_response", "specular_lobe", "window_contamination", "blooming"} <= left_out
    assert not {"extrinsic_rotation", "fog_backscatter", "range_noise", "random_dropout"} & left_out
