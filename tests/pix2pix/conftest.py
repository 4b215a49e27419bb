"""The published golden vectors' small network, and weights drawn by their rule."""

from pathlib import Path

import jax
import numpy as np
import pytest
from flax import nnx

from jaxsim.config import DiscriminatorConfig, Experiment, GeneratorConfig, LossConfig, OptimConfig
from jaxsim.pix2pix.losses import load_vgg
from jaxsim.pix2pix.networks import Discriminator, Generator
from jaxsim.pix2pix.published import from_published
from jaxsim.pix2pix.steps import Network, split
from tests.pix2pix.rule import draw_vgg

IN_CHANNELS, OUT_CHANNELS = 8, 3


@pytest.fixture(scope="module", autouse=True)
def programs(quick_programs):
    """Networks and steps run a few times on small arrays here, and LLVM works on them far longer than they run."""


def reader(golden: Path, name: str):
    """Reads one file of a folder of the golden vectors as a dict; skips where there is no such folder."""
    folder = golden / name
    if not folder.is_dir():
        pytest.skip(f"no golden vectors at {folder}")

    def read(name: str) -> dict[str, np.ndarray]:
        with np.load(folder / f"{name}.npz") as arrays:
            return dict(arrays)

    return read


@pytest.fixture(scope="session")
def published(golden: Path):
    return reader(golden, "pix2pixhd_imaginaire")


@pytest.fixture(scope="session")
def original(golden: Path):
    return reader(golden, "pix2pixhd_original")


@pytest.fixture(scope="session")
def experiment() -> Experiment:
    return Experiment(
        generator=GeneratorConfig(
            filters=8, downsamples=2, blocks=2, enhancers=1, enhancer_blocks=1, out_channels=OUT_CHANNELS
        ),
        discriminator=DiscriminatorConfig(scales=2, filters=8, max_filters=32, layers=3),
        loss=LossConfig(gan=1.0, feature_matching=10.0, perceptual=10.0),
        optim=OptimConfig(lr=2e-4, betas=(0.5, 0.999), ema_decay=0.999, ema_start=1),
    )


def abstract(make) -> Network:
    return jax.eval_shape(lambda: split(make())[1])


def adopt(arrays: dict[str, np.ndarray], letter: str, like: Network) -> Network:
    chosen = {name[2:]: array for name, array in arrays.items() if name.startswith(letter + ".")}
    return jax.tree.map(jax.numpy.asarray, from_published(chosen, like))


@pytest.fixture(scope="session")
def networks(published, experiment) -> tuple[Network, Network]:
    """Generator and discriminator with the golden weights."""
    arrays = published("state_dicts")
    generator = abstract(lambda: Generator(experiment.generator, IN_CHANNELS, nnx.Rngs(0)))
    channels = IN_CHANNELS + OUT_CHANNELS
    discriminator = abstract(lambda: Discriminator(experiment.discriminator, channels, nnx.Rngs(0)))
    return adopt(arrays, "G", generator), adopt(arrays, "D", discriminator)


@pytest.fixture(scope="session")
def labels_and_image(published) -> tuple[np.ndarray, np.ndarray]:
    """Network inputs (one-hot and edges) and image in [-1, 1] of all three items, channels last."""
    arrays = published("input_label_edges")
    ids, instances = arrays["seg_ids"].astype(int), arrays["instance_ids"]
    onehot = ids[..., None] == np.arange(IN_CHANNELS - 1)
    edges = np.zeros(ids.shape, bool)
    for axis in (1, 2):
        low = [slice(None)] * 3
        high = [slice(None)] * 3
        low[axis], high[axis] = slice(None, -1), slice(1, None)
        differs = instances[tuple(low)] != instances[tuple(high)]
        edges[tuple(low)] |= differs
        edges[tuple(high)] |= differs
    inputs = np.concatenate([onehot, edges[..., None]], -1).astype(np.float32)
    np.testing.assert_array_equal(inputs[:2].transpose(0, 3, 1, 2), arrays["label"])
    image = ((arrays["image_u8"].astype(np.float32) / 255 - 0.5) / 0.5).transpose(0, 2, 3, 1)
    return inputs, image


@pytest.fixture(scope="session")
def vgg(tmp_path_factory):
    path = tmp_path_factory.mktemp("vgg") / "vgg19.npz"
    np.savez(path, **draw_vgg(903))
    return jax.tree.map(jax.numpy.asarray, load_vgg(path))
