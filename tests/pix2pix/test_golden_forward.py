"""Same weights in, same numbers out: forward passes and losses of the published program."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.pix2pix.losses import adversarial, feature_matching, hinge, perceptual, vgg_features
from jaxsim.pix2pix.steps import discriminator_definition, generator_definition, join, split
from tests.pix2pix.published_names import to_published


def channels_first(x):
    return np.asarray(x).transpose(0, 3, 1, 2)


def agrees(ours, published):
    """To 1e-4 of the largest number."""
    np.testing.assert_allclose(ours, published, rtol=0, atol=1e-4 * np.abs(published).max())


@pytest.fixture(scope="module")
def passes(networks, experiment, labels_and_image):
    """The passes of forward.npz in its order: two of G and one of D in training mode, then all in eval mode."""
    inputs, real = (jnp.asarray(x[:2]) for x in labels_and_image)
    g_def = generator_definition(experiment.generator, inputs.shape[-1])
    d_def = discriminator_definition(experiment, inputs.shape[-1])

    @jax.jit
    def run(generator, discriminator, inputs, real):
        out = {}
        g, d = join(g_def, generator), join(d_def, discriminator)
        out["fake_train_first"] = g(inputs, train=True)
        out["after.G"] = split(g)[1]
        out["train_fake"] = d(inputs, out["fake_train_first"], train=True)
        out["train_real"] = d(inputs, real, train=True)
        out["after.D"] = split(d)[1]
        out["fake_train_second"] = g(inputs, train=True)
        out["eval.G"] = split(g)[1]
        out["fake_eval"] = g(inputs)
        out["eval_fake"] = d(inputs, out["fake_eval"])
        out["eval_real"] = d(inputs, real)
        return out

    return run(*networks, inputs, real) | {"real": real}


@pytest.mark.long
@pytest.mark.parametrize("name", ["fake_train_first", "fake_train_second", "fake_eval"])
def test_generated_images_equal_the_published_ones(passes, published, name):
    agrees(channels_first(passes[name]), published("forward")[name])


@pytest.mark.long
@pytest.mark.parametrize("stage", ["after.G", "after.D", "eval.G"])
def test_singular_vectors_advance_as_published(passes, published, stage):
    """One power iteration for each pass in training mode, none in eval mode."""
    ours = to_published(passes[stage])
    vectors = {k: v for k, v in published("spectral_norm_vectors").items() if k.startswith(stage + ".")}
    assert len(vectors) == sum(name.endswith(("_u", "_v")) for name in ours)
    for name, value in vectors.items():
        np.testing.assert_allclose(ours[name.removeprefix(stage + ".")], value, rtol=0, atol=1e-6, err_msg=name)


@pytest.mark.parametrize("image", ["fake", "real"])
def test_discriminator_features_and_logits_equal_the_published_ones(passes, published, image):
    arrays = published("forward")
    for scale in range(2):
        for mode in ("train", "eval"):
            logits = channels_first(passes[f"{mode}_{image}"][scale][0])
            agrees(logits, arrays[f"{mode}_{image}_logits_s{scale}"])
        for layer, feature in enumerate(passes[f"eval_{image}"][scale][1]):
            name = f"eval_{image}_feat_s{scale}_l{layer}"
            ours, shape = channels_first(feature), tuple(arrays[name + "_shape"])
            assert ours.shape == shape
            agrees(ours if arrays[name].shape == shape else ours[:, :, ::2, ::4], arrays[name])


@pytest.mark.parametrize("mode", ["train", "eval"])
def test_loss_terms_equal_the_published_ones(passes, published, vgg, mode):
    arrays = published("forward")
    fake, real = passes[f"{mode}_fake"], passes[f"{mode}_real"]
    image = passes["fake_train_first" if mode == "train" else "fake_eval"]
    ours = {
        "D_fake": hinge(fake, "fake"),
        "D_real": hinge(real, "real"),
        "G_GAN": adversarial(fake),
        "FeatureMatching": feature_matching(fake, real),
        "Perceptual": perceptual(vgg, image, passes["real"]),
    }
    for name, value in ours.items():
        np.testing.assert_allclose(value, arrays[f"loss_{mode}_{name}"], rtol=1e-4, atol=2e-6, err_msg=name)


def test_vgg_features_equal_the_published_ones(passes, published, vgg):
    arrays = published("forward")
    fakes, reals = vgg_features(vgg, passes["fake_eval"]), vgg_features(vgg, passes["real"])
    agrees(channels_first(reals[-1]), arrays["vgg_relu5_1_real"])
    for i, (fake, real) in enumerate(zip(fakes, reals, strict=True), start=1):
        error = jnp.abs(fake - real).mean()
        np.testing.assert_allclose(error, arrays[f"loss_eval_vgg_relu_{i}_1_l1"], rtol=1e-4)
