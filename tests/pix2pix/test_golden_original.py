"""NVIDIA/pix2pixHD's own form: its weights, by its names, give its images, features and losses."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax import nnx

from jaxsim.config import DiscriminatorConfig, GeneratorConfig
from jaxsim.pix2pix.losses import (
    LAYER_WEIGHTS,
    discriminator_loss,
    generator_terms,
    least_squares,
    load_vgg,
    vgg_features,
)
from jaxsim.pix2pix.networks import Discriminator, Generator
from jaxsim.pix2pix.published import from_published
from jaxsim.pix2pix.steps import join, split
from tests.pix2pix.published_names import to_published
from tests.pix2pix.rule import draw, draw_vgg
from tests.quick import quick_jit

IN_CHANNELS = 9
GENERATORS = {
    "local_enhancer": GeneratorConfig(
        form="original", filters=16, downsamples=3, blocks=2, enhancers=1, enhancer_blocks=2, out_channels=3
    ),
    "global_generator": GeneratorConfig(
        form="original", filters=16, downsamples=3, blocks=2, enhancers=0, out_channels=3
    ),
}
DISCRIMINATOR = DiscriminatorConfig(form="original", scales=2, filters=8, layers=3)


@pytest.fixture(scope="module")
def inputs_and_image(original) -> tuple[jax.Array, jax.Array]:
    """One-hot labels and edges, and the image in [-1, 1], channels last."""
    arrays = original("input_and_edges")
    onehot = arrays["label"][:, 0, ..., None] == np.arange(IN_CHANNELS - 1)
    inputs = np.concatenate([onehot, arrays["edge"].transpose(0, 2, 3, 1)], -1).astype(np.float32)
    image = (arrays["real_u8"].astype(np.float32) / 255 - 0.5) / 0.5
    return jnp.asarray(inputs), jnp.asarray(image.transpose(0, 2, 3, 1))


def published_weights(arrays: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The state dict that the golden file was made with, drawn again by its rule and checked."""
    shapes = {
        str(name): tuple(int(n) for n in str(shape).split("x"))
        for name, shape in zip(arrays["check_name"], arrays["check_shape"], strict=True)
    }
    weights = draw(shapes, int(arrays["seed"]))
    firsts = [weights[str(name)].ravel()[0] for name in arrays["check_name"]]
    np.testing.assert_allclose(firsts, arrays["check_first"], rtol=1e-6)
    return weights


def with_weights(make, weights):
    """The network's definition, and its values from the published ones."""
    definition = nnx.graphdef(nnx.eval_shape(make))
    values = from_published(weights, jax.eval_shape(lambda: split(make())[1]), "original")
    again = to_published(values, "original")
    assert sorted(again) == sorted(weights)
    for name, array in weights.items():
        np.testing.assert_array_equal(again[name], array, err_msg=name)
    return definition, jax.tree.map(jnp.asarray, values)


def channels_first(x):
    return np.asarray(x).transpose(0, 3, 1, 2)


def agrees(ours, published, name=""):
    """To 1e-4 of the largest number."""
    np.testing.assert_allclose(ours, published, rtol=0, atol=1e-4 * np.abs(published).max(), err_msg=name)


@pytest.fixture(scope="module")
def fakes(original, inputs_and_image):
    """The image of either generator."""
    images = {}
    for name, config in GENERATORS.items():
        make = lambda c=config: Generator(c, IN_CHANNELS, nnx.Rngs(0))  # noqa: E731
        definition, values = with_weights(make, published_weights(original(name)))
        images[name] = quick_jit(lambda v, x, d=definition: join(d, v)(x))(values, inputs_and_image[0])
    return images


@pytest.fixture(scope="module")
def judgements(original, inputs_and_image, fakes):
    """What the discriminator says of the enhancer's image and of the real one."""
    make = lambda: Discriminator(DISCRIMINATOR, IN_CHANNELS + 3, nnx.Rngs(0))  # noqa: E731
    definition, values = with_weights(make, published_weights(original("discriminator_and_losses")))
    judge = quick_jit(lambda v, x, image: join(definition, v)(x, image))
    inputs, real = inputs_and_image
    return {"fake": judge(values, inputs, fakes["local_enhancer"]), "real": judge(values, inputs, real)}


def test_generated_images_equal_the_published_ones(original, fakes):
    agrees(channels_first(fakes["local_enhancer"]), original("local_enhancer")["fake"])
    arrays = original("global_generator")
    ours = channels_first(fakes["global_generator"])
    agrees(ours[:1], arrays["fake"])
    agrees(ours[1:, :, ::2, ::4], arrays["fake1_sub"])


@pytest.mark.parametrize("image", ["fake", "real"])
def test_discriminator_features_and_logits_equal_the_published_ones(original, judgements, image):
    arrays = original("discriminator_and_losses")
    for scale, (logits, features) in enumerate(judgements[image]):
        for layer, ours in enumerate([*features, logits]):
            name = f"{image}_s{scale}_l{layer}"
            ours = channels_first(ours)
            assert ours.shape == tuple(arrays[f"{name}_shape"])
            np.testing.assert_allclose(np.abs(ours).mean(), arrays[f"{name}_absmean"], rtol=1e-4, err_msg=name)
            agrees(ours if layer == 4 else ours[:, :, ::6, ::24], arrays[name], name)


def test_losses_equal_the_published_ones(original, judgements):
    arrays, fake, real = original("discriminator_and_losses"), judgements["fake"], judgements["real"]
    terms = generator_terms(fake, real, "original")
    close = partial(np.testing.assert_allclose, rtol=1e-4)
    close(terms["gan"], arrays["loss_G_GAN"])
    close(10 * terms["feature_matching"], arrays["loss_G_GAN_Feat"])
    close(least_squares(real, "real"), arrays["loss_D_real"])
    close(least_squares(fake, "fake"), arrays["loss_D_fake"])
    close(discriminator_loss(fake, real, "original"), 0.5 * (arrays["loss_D_real"] + arrays["loss_D_fake"]))


def test_perceptual_loss_equals_the_published_one(original, fakes, inputs_and_image, tmp_path):
    arrays = original("discriminator_and_losses")
    np.savez(tmp_path / "vgg19.npz", **draw_vgg(int(arrays["vgg_seed"])))
    weights = jax.tree.map(jnp.asarray, load_vgg(tmp_path / "vgg19.npz"))
    features = quick_jit(partial(vgg_features, imagenet=False))
    fake, real = features(weights, fakes["local_enhancer"]), features(weights, inputs_and_image[1])
    agrees(channels_first(real[-1])[:, ::32], arrays["vgg_relu5_1_real_sub"])
    errors = [float(jnp.abs(a - b).mean()) for a, b in zip(fake, real, strict=True)]
    np.testing.assert_allclose(errors, arrays["vgg_layer_l1"], rtol=1e-4)
    total = sum(w * e for w, e in zip(LAYER_WEIGHTS, errors, strict=True))
    np.testing.assert_allclose(10 * total, arrays["loss_G_VGG"], rtol=1e-4)


def test_running_statistics_of_old_checkpoints_are_left_alone(original):
    """PyTorch up to 0.3 saved them for instance norms that never used them."""
    weights = published_weights(original("global_generator"))
    old = weights | {f"model.{i}.running_{what}": np.ones(16, np.float32) for i in (2, 22) for what in ("mean", "var")}
    config = GENERATORS["global_generator"]
    values = jax.eval_shape(lambda: split(Generator(config, IN_CHANNELS, nnx.Rngs(0)))[1])
    plain, aged = (from_published(arrays, values, "original") for arrays in (weights, old))
    assert all(jax.tree.leaves(jax.tree.map(np.array_equal, plain, aged)))
    with pytest.raises(ValueError, match=r"model\.99\.weight has no place"):
        from_published(weights | {"model.99.weight": np.ones(1, np.float32)}, values, "original")
