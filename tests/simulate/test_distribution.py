"""What a network that gives quantiles says, and draws from it."""

from dataclasses import replace
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.config import QUANTILES, PrepareConfig
from jaxsim.evaluate.intensity import coverage
from jaxsim.frame import INTENSITY_STEP, Painted
from jaxsim.simulate.grain import Ranks
from jaxsim.simulate.predict import Prediction, drawn, predict_cells
from tests.evaluate.made import SHAPE, street

PREPARE = PrepareConfig(inputs=("rgb",), network_size=SHAPE)


def says(quantiles, share, shape=(200, 200)) -> Prediction:
    whole = jnp.broadcast_to(jnp.asarray(quantiles, jnp.float32), (*shape, len(QUANTILES)))
    share = jnp.full(shape, share, jnp.float32)
    return Prediction(whole[..., 2], share > 0.5, whole, share)


def painted(rgb) -> Painted:
    shape = rgb.shape[:-1]
    nothing, every = np.zeros(shape, np.int32), np.ones(shape, bool)
    flat = np.full(shape, 10, np.float32)
    return Painted(flat, flat, rgb, nothing, nothing, every, ~every)


def test_quantiles_come_in_order_and_the_median_and_the_drop_are_read_of_them():
    """A network whose quantiles fall."""

    def generate(params, inputs):
        falling = jnp.asarray([0.6, 0.4, 0.2, 0.0, -0.2])
        quantiles = jnp.broadcast_to(falling + 0.1, (*inputs.shape[:3], 5))
        return jnp.concatenate([quantiles, jnp.full((*quantiles.shape[:3], 1), 2.0)], -1)

    rgb = np.random.default_rng(0).random((*SHAPE, 3)).astype(np.float32)
    flat = np.zeros(SHAPE, np.float32)
    found = predict_cells(generate, None, painted(rgb), incidence_rad=flat, row_share=flat[:, 0], prepare=PREPARE)
    np.testing.assert_allclose(found.quantiles[0, 0], [0.45, 0.55, 0.65, 0.75, 0.85], atol=1e-6)
    assert np.ptp(found.quantiles, axis=(0, 1)).max() < 1e-6
    np.testing.assert_allclose(found.intensity, 0.65, atol=1e-6)
    assert bool(found.drops.all())
    assert not np.asarray(found.reported).any()
    np.testing.assert_allclose(found.drop_share, 1 / (1 + np.exp(-2)), rtol=1e-5)


def test_draws_have_the_quantiles_and_the_drops_that_were_said():
    quantiles = [0.1, 0.3, 0.4, 0.6, 0.9]
    draw = np.asarray(drawn(says(quantiles, 0.25), jax.random.key(0)))
    assert (draw == 0).mean() == pytest.approx(0.25, abs=0.01)
    back = draw[draw > 0]
    np.testing.assert_allclose(np.quantile(back, QUANTILES), quantiles, atol=0.02)
    np.testing.assert_allclose(back / INTENSITY_STEP, np.round(back / INTENSITY_STEP), atol=1e-3)


def test_a_draw_of_given_ranks_has_the_values_at_these_ranks():
    quantiles = [0.1, 0.3, 0.4, 0.6, 0.9]
    ranks = jnp.broadcast_to(jnp.linspace(0.05, 0.95, 200, dtype=jnp.float32), (2, 3, 200))
    two, keys = says(quantiles, 0.5, shape=(2, 3, 200)), jax.random.split(jax.random.key(0), 2)
    draw = drawn(two, keys, Ranks(ranks, 0 * ranks + 0.5))
    np.testing.assert_allclose(draw, np.interp(ranks, QUANTILES, quantiles), atol=0.006)  # steps of 1/100
    assert not np.asarray(drawn(two, keys, Ranks(ranks, 0 * ranks + 0.49))).any()


def test_draws_of_a_batch_are_those_of_its_frames():
    one, keys = says([0.1, 0.2, 0.3, 0.4, 0.5], 0.1, (4, 6)), jax.random.split(jax.random.key(1), 3)
    three = jax.tree.map(lambda x: jnp.stack([x] * 3), one)
    for k, draw in enumerate(drawn(three, keys)):
        np.testing.assert_array_equal(draw, drawn(one, keys[k]))


def test_a_network_without_a_distribution_cannot_be_drawn_from():
    plain = Prediction(jnp.zeros((2, 2)), jnp.zeros((2, 2), bool))
    with pytest.raises(ValueError, match=r"leave out --draws, or train one with --generator\.form unet"):
        drawn(plain, jax.random.key(0))


def test_coverage_counts_what_lies_between_the_levels():
    pair = street(0)
    value = pair.measured.intensity
    shares = np.array([0.0, 0.2, 0.5, 0.8, 1.0]) - 0.5
    half = np.broadcast_to(value.mean() + shares * 0.4, (*SHAPE, 5)).astype(np.float32)
    fixed = Prediction(half[..., 2], np.zeros(SHAPE, bool), half, np.full(SHAPE, 0.3, np.float32))
    found = coverage(lambda params, pair: fixed, None, [pair])
    counts = pair.painted.valid & pair.measured.valid
    within = (np.abs(value - value.mean()) <= 0.2 + INTENSITY_STEP / 2)[counts].mean()
    assert found["coverage_90"].value == pytest.approx(within, abs=0.01)
    assert 0 < found["coverage_50"].value < found["coverage_90"].value
    drops = ~pair.measured.valid[pair.painted.valid]
    assert found["drop_brier"].value == pytest.approx(((0.3 - drops) ** 2).mean(), rel=1e-4)
    unseen = replace(pair, painted=replace(pair.painted, valid=np.zeros(SHAPE, bool)))
    assert coverage(lambda params, pair: fixed, None, [unseen]) == {}
    plain = SimpleNamespace(quantiles=None, drop_share=None)
    assert coverage(lambda params, pair: plain, None, [pair]) == {}
