"""Names and layouts of published checkpoints, there and back."""

from dataclasses import replace
from functools import cache

import jax
import numpy as np
import pytest
from flax import nnx

from jaxsim import devices
from jaxsim.config import DiscriminatorConfig, Experiment, GeneratorConfig, LossConfig
from jaxsim.pix2pix.networks import Discriminator, Generator
from jaxsim.pix2pix.published import (
    CONVERTERS,
    discriminator_sizes,
    from_published,
    generator_sizes,
    part,
    published_generator,
    start_from,
)
from jaxsim.pix2pix.steps import Network, TrainState, create_state, make_train_step, split, state_shapes
from jaxsim.weights import convert
from tests.pix2pix.published_names import to_published
from tests.quick import quick_jit


def small_generator(enhancers=1):
    config = GeneratorConfig(filters=8, downsamples=2, blocks=2, enhancers=enhancers, enhancer_blocks=1)
    return quick_jit(lambda: split(Generator(config, 3, nnx.Rngs(0)))[1])()


@pytest.mark.parametrize("network", ["generator", "discriminator"])
def test_weights_come_back_as_they_went(network):
    config = DiscriminatorConfig(filters=4, scales=2)
    judge = quick_jit(lambda: split(Discriminator(config, 5, nnx.Rngs(0)))[1])
    values = judge() if network == "discriminator" else small_generator()
    again = from_published(to_published(values), jax.eval_shape(lambda: values))
    assert all(jax.tree.leaves(jax.tree.map(np.array_equal, values, again)))


def test_names_are_those_of_the_published_state_dict(published, networks):
    arrays = published("state_dicts")
    for letter, network in zip("GD", networks, strict=True):
        ours = to_published(network)
        theirs = {name[2:]: array for name, array in arrays.items() if name.startswith(letter + ".")}
        assert sorted(ours) == sorted(theirs)
        for name, array in theirs.items():
            np.testing.assert_array_equal(ours[name], array, err_msg=name)


def test_a_global_generator_alone_stands_one_level_deeper():
    """As Imaginaire's `load_pretrained_network` expects it."""
    names = {name.rsplit(".layers", 1)[0] for name in to_published(small_generator(enhancers=0))}
    blocks = {f"global_model.model.{i}.conv_block_{j}" for i in (3, 4) for j in (0, 1)}
    assert names == blocks | {f"global_model.model.{i}" for i in (0, 1, 2, 6, 8, 9)}


def test_weights_of_another_size_are_refused_by_name():
    values = small_generator()
    arrays = to_published(values)
    del arrays["global_model.0.layers.norm.bias"]
    arrays["global_model.1.layers.norm.bias"] = np.zeros(7, np.float32)
    message = r"global_model\.0\.layers\.norm\.bias is missing, not \(8,\)"
    with pytest.raises(ValueError, match=message) as raised:
        from_published(arrays, values)
    assert "global_model.1.layers.norm.bias is (7,), not (16,)" in str(raised.value)


CHANNELS = 5
GENERATORS = [
    GeneratorConfig(filters=8, downsamples=2, blocks=2, enhancers=0, enhancer_blocks=0, out_channels=3),
    GeneratorConfig(filters=8, downsamples=1, blocks=1, enhancers=1, enhancer_blocks=2, out_channels=1),
    GeneratorConfig(filters=8, downsamples=2, blocks=1, enhancers=2, enhancer_blocks=1, out_channels=1, max_filters=16),
]
FORMS = ["imaginaire", "original"]


def drawn(like, seed=0) -> Network:
    """Values of these shapes."""
    random = np.random.default_rng(seed)
    return jax.tree.map(lambda x: random.standard_normal(x.shape).astype(np.float32), like)


def generator(config, *, spectral=True, seed=0) -> Network:
    make = lambda: split(Generator(config, CHANNELS, nnx.Rngs(0), spectral=spectral))[1]  # noqa: E731
    return drawn(jax.eval_shape(make), seed)


def discriminator(config, channels=CHANNELS + 1, seed=1) -> Network:
    return drawn(jax.eval_shape(lambda: split(Discriminator(config, channels, nnx.Rngs(0)))[1]), seed)


def imaginaire_checkpoint(config: GeneratorConfig, judge: DiscriminatorConfig) -> dict[str, np.ndarray]:
    """As its trainer saves it, data parallelism and moving average around the networks, nested dicts joined."""
    whole = to_published(generator(config))
    averaged = to_published(generator(config, spectral=False, seed=2))
    return {
        **{f"net_G.module.module.{name}": array for name, array in whole.items()},
        **{f"net_G.module.averaged_model.{name}": array for name, array in averaged.items()},
        "net_G.module.num_updates_tracked": np.array(700),
        **{f"net_D.module.{name}": array for name, array in to_published(discriminator(judge)).items()},
        "opt_G.state.0.exp_avg": np.zeros(3, np.float32),
    }


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("config", GENERATORS)
def test_sizes_of_a_generator_are_read_off_its_names_and_shapes(config, form):
    config = replace(config, form=form)
    values = generator(config)
    assert generator_sizes(to_published(values, form), form) == (config, CHANNELS)
    again = published_generator(to_published(values, form), form)[2]
    assert all(jax.tree.leaves(jax.tree.map(np.array_equal, values, again)))


@pytest.mark.parametrize("form", FORMS)
def test_sizes_of_a_discriminator_are_read_off_its_names_and_shapes(form):
    for config in (DiscriminatorConfig(form=form, scales=3, filters=4), DiscriminatorConfig(form, 1, 8, 16, 2)):
        arrays = to_published(discriminator(config), form)
        assert discriminator_sizes(arrays, form) == (config, CHANNELS + 1)


def test_the_published_2k_generators_sizes_are_read():
    """`latest_net_G.pth` of label2city_1024p: 36 channels in, 64 and 32 filters, 4 halvings, 9 and 3 blocks."""
    config = GeneratorConfig(form="original", out_channels=3)
    like = jax.eval_shape(lambda: split(Generator(config, 36, nnx.Rngs(0)))[1])
    empty = jax.tree.map(lambda x: np.broadcast_to(np.float32(0), x.shape), like)
    arrays = to_published(empty, "original")
    assert arrays["model.1.weight"].shape == (64, 36, 7, 7)
    assert arrays["model1_2.7.weight"].shape == (3, 32, 7, 7)
    assert generator_sizes(arrays, "original") == (config, 36)


def test_a_checkpoint_of_imaginaire_is_unwrapped():
    config, judge = GENERATORS[1], DiscriminatorConfig(scales=2, filters=4)
    kept = CONVERTERS["pix2pixhd_imaginaire"].convert(imaginaire_checkpoint(config, judge))
    assert {name.split(".")[0] for name in kept} == {"generator", "averaged", "discriminator"}
    assert set(part(kept, "generator.")) == set(to_published(generator(config)))
    again = CONVERTERS["pix2pixhd_imaginaire"].convert(kept)
    assert {name: array.tobytes() for name, array in again.items()} == {n: a.tobytes() for n, a in kept.items()}


def test_weights_of_another_form_are_refused():
    arrays = {f"net_G.module.{n}": a for n, a in to_published(generator(GENERATORS[1])).items()}
    with pytest.raises(ValueError, match="no pix2pixHD generator in the original form"):
        CONVERTERS["pix2pixhd_generator"].convert(arrays)
    with pytest.raises(ValueError, match="no pix2pixHD discriminator in the original form"):
        CONVERTERS["pix2pixhd_discriminator"].convert(arrays)
    with pytest.raises(ValueError, match="no pix2pixHD generator in the imaginaire form"):
        CONVERTERS["pix2pixhd_imaginaire"].convert({"features.0.weight": np.zeros((64, 3, 3, 3), np.float32)})


def test_a_cut_checkpoint_names_what_is_missing():
    arrays = imaginaire_checkpoint(GENERATORS[1], DiscriminatorConfig(scales=2, filters=4))
    del arrays["net_G.module.module.global_model.1.layers.norm.bias"]
    with pytest.raises(ValueError, match=r"global_model\.1\.layers\.norm\.bias is missing, not \(16,\)"):
        CONVERTERS["pix2pixhd_imaginaire"].convert(arrays)


def untrained(experiment: Experiment) -> TrainState:
    return jax.tree.map(lambda x: np.zeros(x.shape, x.dtype), state_shapes(experiment, CHANNELS))


def test_training_starts_from_a_converted_checkpoint(tmp_path):
    experiment = Experiment(generator=GENERATORS[1], discriminator=DiscriminatorConfig(scales=2, filters=4))
    arrays = imaginaire_checkpoint(experiment.generator, experiment.discriminator)
    np.savez(tmp_path / "published.npz", **arrays)
    file = tmp_path / "start.npz"
    convert("pix2pixhd_imaginaire", CONVERTERS["pix2pixhd_imaginaire"], tmp_path / "published.npz", out=file)
    state = start_from(untrained(experiment), [file], experiment)
    for network, name in ((state.generator, "net_G.module.module."), (state.discriminator, "net_D.module.")):
        for key, array in to_published(network).items():
            np.testing.assert_array_equal(array, arrays[name + key], err_msg=key)
    for key, array in to_published(Network(state.ema, {})).items():
        np.testing.assert_array_equal(array, arrays[f"net_G.module.averaged_model.{key}"], err_msg=key)
    other = replace(experiment, generator=replace(experiment.generator, form="original"))
    with pytest.raises(ValueError, match=r"is of the imaginaire form; pass --generator\.form imaginaire"):
        start_from(state, [file], other)
    smaller = replace(experiment, generator=replace(experiment.generator, enhancer_blocks=1))
    with pytest.raises(ValueError, match=r"enhancer_0\.model_upsample\.3\.layers\.conv\.weight is missing"):
        start_from(untrained(smaller), [file], smaller)
    with pytest.raises(FileNotFoundError, match="jaxsim convert pix2pixhd_imaginaire"):
        start_from(state, [tmp_path / "nowhere.npz"], experiment)


def converted(folder, kind, arrays):
    """The file that `jaxsim convert` makes of these arrays."""
    np.savez(folder / "published.npz", **arrays)
    file = folder / f"{kind}.npz"
    convert(kind, CONVERTERS[kind], folder / "published.npz", out=file)
    return file


def imaginaire_start(folder, experiment, *, averaged):
    arrays = imaginaire_checkpoint(experiment.generator, experiment.discriminator)
    kept = {name: array for name, array in arrays.items() if averaged or "averaged_model" not in name}
    return [converted(folder, "pix2pixhd_imaginaire", kept)]


def original_start(folder, experiment):
    whole = to_published(generator(experiment.generator), "original")
    judge = to_published(discriminator(experiment.discriminator), "original")
    return [
        converted(folder, "pix2pixhd_generator", whole),
        converted(folder, "pix2pixhd_discriminator", judge),
    ]


def test_a_discriminator_that_nothing_would_use_is_refused(tmp_path):
    form = {"form": "original", "filters": 4}
    experiment = Experiment(
        generator=GeneratorConfig(**form, downsamples=1, blocks=1, enhancers=0, enhancer_blocks=0),
        discriminator=DiscriminatorConfig(**form, scales=1, layers=1),
        loss=LossConfig(gan=0.0, reconstruction=1.0),
    )
    generator_file, judge_file = original_start(tmp_path, experiment)
    start_from(untrained(experiment), [generator_file], experiment)
    with pytest.raises(ValueError, match=r"is a discriminator's, and --loss\.gan 0 trains without one; leave it out"):
        start_from(untrained(experiment), [generator_file, judge_file], experiment)


STARTS = {
    "imaginaire": lambda folder, e: imaginaire_start(folder, e, averaged=True),
    "imaginaire, not averaged": lambda folder, e: imaginaire_start(folder, e, averaged=False),
    "original": original_start,
    "original, generator alone": lambda folder, e: original_start(folder, e)[:1],
}


@cache
def compiled(experiment, count):
    """The step of an experiment on so many devices, compiled once for both of its starts."""
    return make_train_step(experiment, CHANNELS, mesh=devices.data_mesh(count))


@pytest.mark.long
@pytest.mark.parametrize("count", [1, 2])
@pytest.mark.parametrize("start", STARTS)
def test_a_step_follows_every_form_of_start_on_one_device_and_on_two(tmp_path, start, count):
    form = start.split(",")[0]
    experiment = Experiment(
        generator=GeneratorConfig(form=form, filters=4, downsamples=1, blocks=1, enhancers=0, enhancer_blocks=0),
        discriminator=DiscriminatorConfig(form=form, scales=1, filters=4, layers=1),
    )
    mesh = devices.data_mesh(count)
    assert (mesh is None) == (count == 1)
    begun = start_from(create_state(experiment, CHANNELS, seed=0), STARTS[start](tmp_path, experiment), experiment)
    before = jax.tree.map(np.array, begun)
    random = np.random.default_rng(0)
    draw = lambda n: random.uniform(-1, 1, (count, 8, 16, n)).astype(np.float32)  # noqa: E731
    batch = {"inputs": draw(CHANNELS), "target": draw(1), "weight": np.ones((count, 8, 16), np.float32)}
    with jax.numpy_dtype_promotion("standard"):  # optax raises floats to integers
        step = compiled(experiment, count)
        state, metrics = step(devices.everywhere(mesh, begun), devices.cut(mesh, batch))
    assert bool(metrics["finite"])
    assert int(state.step) == 1
    moved = jax.tree.map(lambda a, b: np.abs(np.asarray(a) - b).max(), state.ema, before.ema)
    assert max(jax.tree.leaves(moved)) > 0
