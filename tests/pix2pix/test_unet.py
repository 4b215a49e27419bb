"""The U-Net and its losses: what it gives, what it learns, what it does not look at."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax import nnx

from jaxsim.config import QUANTILES, Experiment, GeneratorConfig, LossConfig, OptimConfig
from jaxsim.pix2pix import create_state, make_generate, make_train_step
from jaxsim.pix2pix.losses import drop_loss, quantile_loss
from jaxsim.pix2pix.unet import UNet, cells_alone

CONFIG = GeneratorConfig(form="unet", filters=4, downsamples=2, blocks=1, enhancers=0, looks=1)
EXPERIMENT = Experiment(
    generator=CONFIG,
    loss=LossConfig(gan=0.0, feature_matching=0.0, reconstruction=1.0, drops=0.3),
    optim=OptimConfig(lr=1e-2, betas=(0.9, 0.99), steps=200, warm_up=5, clip=1.0, ema_start=200),
)


@pytest.fixture(autouse=True)
def standard_promotion():
    """optax raises floats to integers, which strict promotion forbids."""
    with jax.numpy_dtype_promotion("standard"):
        yield


def test_any_number_of_rows_and_columns_comes_out_as_it_went_in():
    make = lambda x: UNet(CONFIG, 3, nnx.Rngs(0))(x)  # noqa: E731
    assert jax.eval_shape(make, jnp.ones((2, 11, 13, 3))).shape == (2, 11, 13, len(QUANTILES) + 1)


def test_a_far_part_of_the_frame_changes_nothing_here():
    """Its surroundings reach 4 x (2 + 2) cells and some: no statistic of the whole frame enters."""
    network = jax.jit(lambda x: UNet(CONFIG, 3, nnx.Rngs(0))(x))
    x = jax.random.normal(jax.random.key(0), (1, 8, 128, 3))
    y = x.at[:, :, 96:].set(5.0)
    of_x, of_y = network(x), network(y)
    np.testing.assert_array_equal(of_x[:, :, :32], of_y[:, :, :32])
    assert np.abs(of_x - of_y)[:, :, 96:].max() > 0


def test_without_halvings_each_cell_answers_for_itself():
    network = UNet(replace(CONFIG, downsamples=0), 3, nnx.Rngs(0))
    x = jax.random.normal(jax.random.key(0), (1, 3, 5, 3))
    changed = np.argwhere(np.abs(network(x) - network(x.at[0, 1, 2].set(5.0)))[0].max(-1) > 0)
    assert changed.tolist() == [[1, 2]]


@pytest.mark.parametrize("members", [1, 2])
def test_without_its_surroundings_each_cell_answers_for_itself(members):
    experiment = replace(EXPERIMENT, generator=replace(CONFIG, members=members))
    parameters, generate = create_state(experiment, 3, seed=0).ema, make_generate(experiment, 3)
    x = jax.random.normal(jax.random.key(0), (1, 8, 16, 3))
    changed = x.at[0, 4, 9].set(5.0)
    away = lambda p: np.abs(generate(p, x) - generate(p, changed))[0].max(-1) > 0  # noqa: E731
    assert np.argwhere(away(cells_alone(parameters))).tolist() == [[4, 9]]
    assert away(parameters).sum() > 9


def test_the_quantile_loss_is_least_at_the_quantiles():
    draws = np.random.default_rng(0).uniform(0, 1, 4001).astype(np.float32)
    cells, weight = jnp.asarray(draws)[None, None], jnp.ones((1, 1, 4001))

    def loss(quantiles):
        outputs = jnp.broadcast_to(2 * jnp.asarray([*quantiles, 0.0]) - 1, (1, 1, 4001, len(QUANTILES) + 1))
        return float(quantile_loss(outputs, cells, weight))

    best = np.quantile(draws, QUANTILES).astype(np.float32)
    for k in range(len(QUANTILES)):
        for step in (-0.02, 0.02):
            moved = best.copy()
            moved[k] += step
            assert loss(moved) > loss(best)


def test_the_medians_part_is_the_absolute_error():
    outputs = jnp.full((1, 1, 2, len(QUANTILES) + 1), -0.4)  # all quantiles 0.3
    cells = jnp.asarray([[[0.5, 0.1]]])
    # Beside |0.2| of the median, each pair of quantiles (a, 1 - a) has 0.5 (a + 1 - a) |0.2|.
    assert float(quantile_loss(outputs, cells, jnp.ones((1, 1, 2)))) == pytest.approx(0.2 * (1 + 0.5 + 0.5), rel=1e-5)
    assert float(quantile_loss(outputs, cells, jnp.asarray([[[1.0, 0.0]]]))) == pytest.approx(0.4, rel=1e-5)


def test_the_drop_loss_is_least_at_the_share_of_drops():
    dropped = (jnp.arange(10) < 3)[None, None]
    loss = lambda z: float(drop_loss(jnp.full((1, 1, 10, 6), z), dropped, jnp.ones((1, 1, 10))))  # noqa: E731
    best = np.log(0.3 / 0.7)
    assert loss(best) == pytest.approx(-(0.3 * np.log(0.3) + 0.7 * np.log(0.7)), rel=1e-5)
    assert loss(best) < min(loss(best - 0.2), loss(best + 0.2))


def test_it_learns_each_lasers_gain_its_spread_and_its_drops():
    random = np.random.default_rng(0)
    row = np.broadcast_to(np.arange(4)[:, None], (4, 24))
    inputs = np.broadcast_to(np.eye(4, dtype=np.float32)[row], (2, 4, 24, 4))
    step, state = make_train_step(EXPERIMENT, 4), create_state(EXPERIMENT, 4, seed=0)
    for _ in range(EXPERIMENT.optim.steps):
        intensity = (0.2 * row + random.uniform(0, 0.2, (2, 4, 24))).astype(np.float32)
        returned = random.uniform(size=(2, 4, 24)) > np.where(row == 2, 0.9, 0.0)
        batch = {"inputs": inputs, "target": 2 * intensity[..., None] - 1, "weight": np.ones((2, 4, 24), np.float32)}
        state, metrics = step(state, batch | {"returned": returned, "dropped": ~returned})
    assert set(metrics) >= {"loss/reconstruction", "loss/drops"}
    outputs = np.asarray(make_generate(EXPERIMENT, 4)(state.ema, inputs))[0]
    median = ((outputs[..., 2] + 1) / 2).mean(1)
    np.testing.assert_allclose(median, [0.1, 0.3, 0.5, 0.7], atol=0.05)
    wide = ((outputs[..., 4] - outputs[..., 0]) / 2).mean(1)
    assert ((wide > 0.1) & (wide < 0.3)).all()
    share = 1 / (1 + np.exp(-outputs[..., 5].mean(1)))
    assert share[2] > 0.7
    assert max(share[[0, 1, 3]]) < 0.3


def test_a_gan_is_refused():
    with pytest.raises(ValueError, match=r"a unet gives quantiles.*--loss\.gan 0"):
        make_train_step(replace(EXPERIMENT, loss=LossConfig(gan=1.0, reconstruction=1.0)), 4)


def test_levels_are_as_much_wider_as_the_settings_say():
    parameters = create_state(EXPERIMENT, 3, seed=0).ema
    x = jax.random.normal(jax.random.key(0), (1, 8, 12, 3))
    as_learned = np.asarray(make_generate(EXPERIMENT, 3)(parameters, x))
    wider = np.asarray(make_generate(replace(EXPERIMENT, generator=replace(CONFIG, widen=1.5)), 3)(parameters, x))
    middle = QUANTILES.index(0.5)
    for k in range(len(QUANTILES)):
        np.testing.assert_allclose(
            wider[..., k] - wider[..., middle], 1.5 * (as_learned[..., k] - as_learned[..., middle]), atol=1e-6
        )
    np.testing.assert_array_equal(wider[..., [middle, -1]], as_learned[..., [middle, -1]])


def test_a_network_without_levels_has_none_to_widen():
    with pytest.raises(ValueError, match=r"generator\.widen is 1\.5; imaginaire gives no quantiles"):
        make_generate(Experiment(generator=GeneratorConfig(filters=4, widen=1.5)), 3)
