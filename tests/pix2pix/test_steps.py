"""The training step as a whole: what it moves, what it leaves out, and that it repeats itself."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.config import DiscriminatorConfig, Experiment, GeneratorConfig, LossConfig, OptimConfig
from jaxsim.pix2pix.losses import discriminator_loss, generator_terms
from jaxsim.pix2pix.steps import (
    LOOKS,
    create_state,
    discriminator_definition,
    generator_definition,
    join,
    learning_rate,
    make_generate,
    make_train_step,
)
from tests.quick import quick_jit

CHANNELS = 3
GAN = Experiment(
    generator=GeneratorConfig(filters=4, downsamples=1, blocks=1, enhancer_blocks=1),
    discriminator=DiscriminatorConfig(scales=1, filters=4, max_filters=8, layers=1),
    loss=LossConfig(gan=1.0, feature_matching=10.0, reconstruction=5.0),
    optim=OptimConfig(ema_start=2),
)
ONE_NETWORK = replace(GAN.generator, enhancers=0)
"""A generator that compiles in half the time, where its enhancers have no part in what is tested."""
ERROR_ALONE = replace(GAN, generator=ONE_NETWORK, loss=LossConfig(gan=0.0, feature_matching=10.0, reconstruction=1.0))


@pytest.fixture(autouse=True)
def standard_promotion():
    """optax raises floats to integers, which strict promotion forbids."""
    with jax.numpy_dtype_promotion("standard"):
        yield


@pytest.fixture(scope="module")
def batch():
    random = np.random.default_rng(0)
    draw = lambda channels: random.uniform(-1, 1, (2, 8, 16, channels)).astype(np.float32)  # noqa: E731
    weight = random.uniform(0, 1, (2, 8, 16)).astype(np.float32)
    return {"inputs": draw(CHANNELS), "target": draw(1), "weight": weight}


@pytest.fixture(scope="module")
def steps():
    """Compiled once for the file."""
    with jax.numpy_dtype_promotion("standard"):
        return {e: make_train_step(e, CHANNELS) for e in (GAN, ERROR_ALONE)}


def run(step, experiment, batch, *, seed=0, count=3):
    state, history = create_state(experiment, CHANNELS, seed=seed), []
    for _ in range(count):
        state, metrics = step(state, batch)
        history.append((jax.tree.map(np.asarray, state), jax.tree.map(np.asarray, metrics)))
    return history


def equal(a, b) -> bool:
    return all(jax.tree.leaves(jax.tree.map(np.array_equal, a, b)))


@pytest.mark.long
def test_same_seed_gives_the_same_numbers_and_another_seed_others(steps, batch):
    first, again, other = (run(steps[GAN], GAN, batch, seed=seed)[-1] for seed in (0, 0, 1))
    assert equal(first, again)
    assert not equal(first[0].generator, other[0].generator)


@pytest.mark.long
def test_a_step_in_bfloat16_is_nearly_that_in_float32_and_keeps_float32_parameters(steps, batch):
    halved = replace(GAN, optim=replace(GAN.optim, precision="bfloat16"))
    step = make_train_step(halved, CHANNELS)
    (state, metrics), (_, exact) = (run(s, e, batch, count=1)[0] for s, e in ((step, halved), (steps[GAN], GAN)))
    assert {leaf.dtype for leaf in jax.tree.leaves(state)} <= {np.dtype(t) for t in ("float32", "int32", "uint32")}
    assert metrics["finite"]
    differences = [abs(metrics[name] / exact[name] - 1) for name in exact if name.startswith("loss/")]
    assert 0 < max(differences) < 0.05


@pytest.mark.long
def test_every_term_in_use_is_reported(steps, batch):
    _, metrics = run(steps[GAN], GAN, batch, count=1)[0]
    terms = {"gan", "feature_matching", "reconstruction", "generator", "discriminator"}
    assert set(metrics) == {f"loss/{term}" for term in terms} | {
        "lr",
        "grad_norm/generator",
        "grad_norm/discriminator",
        "finite",
    }
    weighted = metrics["loss/gan"] + 10 * metrics["loss/feature_matching"] + 5 * metrics["loss/reconstruction"]
    np.testing.assert_allclose(metrics["loss/generator"], weighted, rtol=1e-5)
    assert metrics["finite"]


def test_without_the_gan_there_is_no_discriminator_at_all(steps, batch):
    state, metrics = run(steps[ERROR_ALONE], ERROR_ALONE, batch)[-1]
    assert state.discriminator is None
    assert state.discriminator_optim is None
    assert {name for name in metrics if name.startswith("loss/")} == {"loss/reconstruction", "loss/generator"}


def test_error_alone_falls(steps, batch):
    history = run(steps[ERROR_ALONE], ERROR_ALONE, batch, count=15)
    assert history[-1][1]["loss/reconstruction"] < history[0][1]["loss/reconstruction"]


def test_cells_without_weight_do_not_count(steps, batch):
    changed = batch["target"].copy()
    changed[:, :4] = 0.9
    weight = batch["weight"].copy()
    weight[:, :4] = 0
    one, other = (
        run(steps[ERROR_ALONE], ERROR_ALONE, batch | {"weight": weight, "target": target})[-1]
        for target in (batch["target"], changed)
    )
    assert equal(one, other)


def test_a_value_that_is_not_finite_is_told(steps, batch):
    broken = batch | {"inputs": np.full_like(batch["inputs"], np.nan)}
    assert not run(steps[ERROR_ALONE], ERROR_ALONE, broken, count=1)[0][1]["finite"]


@pytest.mark.long
def test_both_networks_learn_from_the_same_image_and_each_other_as_they_were(batch):
    """NVIDIA/pix2pixHD's order: no update is seen before the next step."""
    together = replace(
        GAN,
        generator=replace(ONE_NETWORK, form="original"),
        discriminator=replace(GAN.discriminator, form="original"),
        loss=LossConfig(form="original", gan=1.0, feature_matching=10.0),
        optim=OptimConfig(updates="together", ema_decay=0.0),
    )
    state = create_state(together, CHANNELS, seed=0)

    @quick_jit
    def losses(state, inputs, target):
        generator = join(generator_definition(together.generator, CHANNELS), state.generator)
        judge = join(discriminator_definition(together, CHANNELS), state.discriminator)
        on_fake, on_real = judge(inputs, generator(inputs)), judge(inputs, target)
        terms = generator_terms(on_fake, on_real, "original")
        return terms | {"discriminator": discriminator_loss(on_fake, on_real, "original")}

    expected = {name: float(value) for name, value in losses(state, batch["inputs"], batch["target"]).items()}
    after, metrics = run(make_train_step(together, CHANNELS), together, batch, count=1)[0]
    for name, value in expected.items():
        np.testing.assert_allclose(metrics[f"loss/{name}"], value, rtol=1e-4, err_msg=name)
    assert metrics["finite"]
    assert not equal(after.discriminator.parameters, create_state(together, CHANNELS, seed=0).discriminator.parameters)


def test_average_copies_up_to_its_start_and_lags_from_then_on(steps, batch):
    history = run(steps[GAN], GAN, batch)
    head = lambda tree: tree["enhancers"][0]["head"]["conv"]["kernel"]  # noqa: E731
    for k in (0, 1):
        state = history[k][0]
        np.testing.assert_array_equal(head(state.ema), head(state.generator.parameters))
    before, after = (history[k][0] for k in (1, 2))
    expected = 0.999 * head(before.ema) + 0.001 * head(after.generator.parameters)
    np.testing.assert_allclose(head(after.ema), expected, rtol=1e-6, atol=1e-9)


def test_generate_gives_an_image_of_the_averaged_generator(batch):
    generate = make_generate(GAN, CHANNELS)
    parameters = create_state(GAN, CHANNELS, seed=0).ema
    image = generate(parameters, batch["inputs"])
    assert image.shape == (2, 8, 16, 1)
    inside = quick_jit(lambda p, x: generate(p, x))(parameters, batch["inputs"])
    np.testing.assert_allclose(inside, image, atol=1e-6)


@pytest.mark.parametrize(("step", "rate"), [(0, 2e-4), (49, 2e-4), (50, 2e-4), (75, 1e-4), (100, 0.0)])
def test_learning_rate_is_constant_then_falls_linearly(step, rate):
    config = OptimConfig(lr=2e-4, steps=100, decay_from=0.5)
    np.testing.assert_allclose(learning_rate(config, jnp.int32(step)), rate, rtol=1e-5, atol=1e-12)
    assert learning_rate(OptimConfig(lr=2e-4, steps=100), jnp.int32(step)) == np.float32(2e-4)


def test_missing_weights_say_what_to_fetch_and_where_it_goes(tmp_path):
    experiment = replace(GAN, loss=LossConfig(perceptual=10.0, vgg_weights=tmp_path / "vgg19.npz"))
    with pytest.raises(FileNotFoundError, match=r"vgg19-dcbb9e9d\.pth.*--loss\.vgg-weights"):
        make_train_step(experiment, CHANNELS)
    np.savez(tmp_path / "vgg19.npz", **{"features.0.weight": np.zeros((64, 1, 3, 3), np.float32)})
    with pytest.raises(ValueError, match=r"features\.0\.weight is \(64, 1, 3, 3\), not \(64, 3, 3, 3\)"):
        make_train_step(experiment, CHANNELS)


def test_no_loss_at_all_is_refused():
    with pytest.raises(ValueError, match="every loss term has weight 0"):
        make_train_step(replace(GAN, loss=LossConfig(gan=0.0)), CHANNELS)


WINDOW = np.random.default_rng(0).random((2, 14, 9, 3)).astype(np.float32)
"""What is looked at in several ways."""


def mean_of(answer):
    """A made network's answers to all looks, averaged as `make_generate` does."""
    rows = WINDOW.shape[1]
    return np.mean([np.asarray(look.back(answer(look.at(jnp.asarray(WINDOW))), rows)) for look in LOOKS], axis=0)


def test_what_each_cell_says_of_itself_comes_back_to_it():
    for look in LOOKS:
        seen = look.at(jnp.asarray(WINDOW))
        assert seen.shape == (2, 14 + look.above + look.below, 9, 3)
        np.testing.assert_array_equal(look.back(seen, 14), WINDOW)


def test_no_two_looks_are_alike():
    assert len(set(LOOKS)) == len(LOOKS)


def test_a_step_from_left_to_right_has_no_part_in_the_mean_with_the_mirror():
    def answer(seen):
        place = jnp.arange(seen.shape[2], dtype=jnp.float32)[None, None, :, None]
        return seen[..., :1] + 0.2 * jnp.broadcast_to(place, seen[..., :1].shape)

    np.testing.assert_allclose(mean_of(answer), WINDOW[..., :1] + 0.2 * 4, rtol=1e-6)


def test_lifted_rows_are_not_told_by_their_place():
    """A network that says something else of every other row, whatever it sees there: one look of four contradicts."""

    def answer(seen):
        every_other = (jnp.arange(seen.shape[1]) % 2).astype(jnp.float32)[None, :, None, None]
        return jnp.broadcast_to(every_other, (*seen.shape[:3], 1))

    found = mean_of(answer)
    np.testing.assert_allclose(found[:, ::2], 1 / 4)
    np.testing.assert_allclose(found[:, 1::2], 3 / 4)


@pytest.mark.parametrize("ways", [1, 2, 4])
def test_a_unet_gives_the_mean_of_as_many_looks_as_it_is_told(ways):
    config = GeneratorConfig(form="unet", filters=4, max_filters=8, downsamples=1, blocks=1, enhancers=0, looks=ways)
    experiment = Experiment(generator=config)
    parameters = create_state(experiment, 3, seed=0).ema
    once = make_generate(replace(experiment, generator=replace(config, looks=1)), 3)
    window = jnp.asarray(WINDOW)
    expected = np.mean([look.back(once(parameters, look.at(window)), 14) for look in LOOKS[:ways]], axis=0)
    assert np.ptp(expected) > 0
    np.testing.assert_allclose(make_generate(experiment, 3)(parameters, window), expected, atol=1e-5)
