"""The Fréchet distance of a run's images."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.config import QUANTILES, DataConfig, PrepareConfig
from jaxsim.data import open_dataset
from jaxsim.evaluate.intensity import _in_batches, frechet_line, frechet_of_run, make_images
from jaxsim.metrics.frechet import Moments, frechet_distance
from jaxsim.metrics.inception import Extractor
from jaxsim.pairs.prepared import prepared

PREPARE = PrepareConfig(inputs=("row",), columns=64, network_size=(48, 64))


class Means(Extractor):
    """Four means a picture instead of Inception: fast, and known by hand."""

    def __call__(self, images):
        b, h, w, _ = images.shape
        return jnp.asarray(images).reshape(b, 2, h // 2, 2, w // 2).mean((2, 4)).reshape(b, 4)


def generate(params, inputs):
    return jnp.tanh(params * inputs[..., :1])


@pytest.fixture(scope="module")
def pairs(tmp_path_factory):
    data = DataConfig(cache=tmp_path_factory.mktemp("cache"))
    return prepared(open_dataset(data), range(6), data, prepare=PREPARE)


@pytest.mark.long
def test_every_judged_frame_counts_once_and_the_measured_side_is_kept(pairs, tmp_path):
    extractor = Means("torchvision", {}, "ab" * 32, published=False, random=True, width=4)
    score = frechet_of_run(generate, jnp.float32(0.5), pairs, extractor=extractor, prepare=PREPARE, cache=tmp_path)
    assert score.counts == (6, 6)
    assert score.name == "frechet_random_4"
    (kept,) = tmp_path.glob("frechet-inception_torchvision-4-abababababababab-synthetic-6-*.npz")

    predicted, measured = make_images(generate, PREPARE)
    stacked = [pairs[i] for i in range(6)]
    batch = lambda i: jax.tree.map(lambda leaf: jnp.asarray(leaf)[None], stacked[i])  # noqa: E731
    images = [
        np.concatenate([np.asarray(f(batch(i))) for i in range(6)])
        for f in (lambda p: predicted(jnp.float32(0.5), p), measured)
    ]
    assert images[1].shape == (6, 48, 64, 1)
    assert images[1].min() >= -1
    assert images[1].max() <= 1
    want = frechet_distance(*(Moments.of(np.asarray(extractor(x))) for x in images))
    assert score.value == pytest.approx(want, rel=1e-4)

    before = kept.stat().st_mtime_ns
    again = frechet_of_run(generate, jnp.float32(0.5), pairs, extractor=extractor, prepare=PREPARE, cache=tmp_path)
    assert again == score
    assert kept.stat().st_mtime_ns == before
    assert "6 predicted and 6 measured images, 4 features; from half the images" in frechet_line(score)


@pytest.mark.long
def test_drives_of_several_calibrations_are_taken_window_by_window(pairs):
    _, measured = make_images(generate, PREPARE)
    whole = [pairs[i] for i in range(3)]
    cut = [jax.tree.map(lambda leaf: leaf[:-4], pair) for pair in whole]
    images = list(_in_batches([*whole[:2], *cut, whole[2]], measured))
    assert [image.shape for image in images] == [(48, 64, 1)] * 6
    alone = list(_in_batches(whole[2:], measured))
    np.testing.assert_array_equal(images[-1], alone[0])


def test_fewer_frames_than_features_stop_before_any_work(pairs, tmp_path):
    extractor = Means("torchvision", {}, "ab" * 32, published=True, width=2048)
    with pytest.raises(ValueError, match=r"fid: 6 frames to judge, 2048 features.*at least 2049 frames"):
        frechet_of_run(generate, jnp.float32(0.5), pairs, extractor=extractor, prepare=PREPARE, cache=tmp_path)
    assert not list(tmp_path.iterdir())


def test_of_a_distribution_the_median_is_the_image(pairs):
    def quantiles(params, inputs):
        return jnp.stack([jnp.full(inputs.shape[:-1], of) for of in (*QUANTILES, 7.0)], axis=-1)

    predicted, _ = make_images(quantiles, PREPARE)
    batch = jax.tree.map(lambda leaf: jnp.asarray(leaf)[None], pairs[0])
    image = predicted(None, batch)
    assert image.shape == (1, 48, 64, 1)
    assert (image == 0.5).all()
