import jax
import numpy as np
import pytest
from flax import nnx

from jaxsim.metrics.inception import (
    CONVERTERS,
    Extractor,
    _abstract,
    bicubic,
    bilinear,
    load_extractor,
    prepared_images,
    published_shapes,
    random_extractor,
)
from jaxsim.weights import convert
from tests.metrics.published_inception import drawn, read_golden

IMAGES = 1
CASES = {"inception_fid": ("fid", "pytorch_fid"), "inception": ("tv", "torchvision")}


@pytest.fixture(scope="module")
def features(golden):
    return read_golden(golden)


@pytest.mark.parametrize("kind", CASES)
def test_converted_weights_give_the_published_program_s_features(kind, features, tmp_path):
    prefix, form = CASES[kind]
    seed = int(features["seed_fid" if prefix == "fid" else "seed_torchvision"])
    np.savez(tmp_path / "state.npz", **drawn(features, prefix, seed))
    convert(kind, CONVERTERS[kind], tmp_path / "state.npz", out=tmp_path / "converted.npz")
    extractor = load_extractor(tmp_path / "converted.npz")
    assert extractor.form == form
    assert extractor.score == "frechet_unpublished"
    assert extractor.sha256[:16] in extractor.name

    images = (features["images_u8"][:IMAGES].transpose(0, 2, 3, 1).astype(np.float32) / 255 - 0.5) / 0.5
    prepared, maps, pooled = look(extractor, images)
    np.testing.assert_allclose(
        prepared.transpose(0, 3, 1, 2)[:, :, ::23, ::23], features[f"{prefix}_pre_sub"][:IMAGES], atol=1e-5
    )
    np.testing.assert_allclose(pooled, features[f"{prefix}_2048"][:IMAGES], rtol=1e-4, atol=1e-5)
    for width, (c, h, w) in {64: (4, 12, 12), 192: (8, 6, 6), 768: (16, 4, 4)}.items():
        if f"{prefix}_block{width}_sub" in features:
            want = features[f"{prefix}_block{width}_sub"][:IMAGES]
            got = maps[width].transpose(0, 3, 1, 2)[:, ::c, ::h, ::w]
            np.testing.assert_allclose(got, want, rtol=1e-4, atol=1e-4)


def look(extractor: Extractor, images: np.ndarray):
    """Prepared images, feature maps and pooled features, from one compiled program."""

    @jax.jit
    def run(values, images):
        prepared = prepared_images(images, extractor.form)
        maps = nnx.merge(_abstract(extractor.form)[0], values)(prepared)
        return prepared, maps, maps[2048].mean((1, 2))

    return jax.tree.map(np.asarray, run(extractor.values, images))


@pytest.mark.parametrize("prefix", ["fid", "tv"])
def test_names_and_shapes_are_those_of_the_published_state_dict(prefix, features):
    theirs = {
        str(name): tuple(int(n) for n in str(shape).split("x") if n)
        for name, shape in zip(features[f"{prefix}_check_name"], features[f"{prefix}_check_shape"], strict=True)
    }
    ours = published_shapes("pytorch_fid" if prefix == "fid" else "torchvision")
    assert ours == {name: shape for name, shape in theirs.items() if not name.endswith("num_batches_tracked")}
    assert len(ours) == 94 * 5 + 2


@pytest.mark.parametrize(("new", "old"), [(299, 64), (299, 512), (8, 5), (5, 8), (7, 1)])
def test_resizing_keeps_constants_corners_and_ramps(new, old):
    for matrix in (bilinear(new, old), bicubic(new, old)):
        np.testing.assert_allclose(matrix.sum(1), 1, atol=1e-5)
    corners = np.zeros((2, old))
    corners[0, 0] = corners[1, -1] = 1
    np.testing.assert_allclose(bicubic(new, old)[[0, -1]], corners, atol=1e-6)
    want = (np.arange(new) + 0.5) * old / new - 0.5
    ramp = bilinear(new, old) @ np.arange(old, dtype=np.float32)
    np.testing.assert_allclose(ramp, np.clip(want, 0, old - 1), atol=1e-3)


def test_random_weights_depend_on_the_seed_alone_and_are_never_called_fid():
    one, same, other = (random_extractor(64, seed=s) for s in (0, 0, 1))
    assert one.sha256 == same.sha256 != other.sha256
    assert one.score == "frechet_random_64"
    images = np.random.default_rng(0).uniform(-1, 1, (5, 12, 40, 1)).astype(np.float32)
    features = np.asarray(one(images))
    assert features.shape == (5, 64)
    assert features.std(0).mean() > 0.01 * features.mean()
    # Filled up to a whole batch and cut again.
    in_batches = np.concatenate(list(one.batches(images, 4)))
    np.testing.assert_allclose(in_batches, features, rtol=1e-4, atol=1e-5)


def test_scores_bear_the_name_of_what_they_are_over():
    make = lambda **more: Extractor("pytorch_fid", {}, "ab" * 32, **more).score  # noqa: E731
    assert make(published=True) == "fid"
    assert make(published=True, width=64) == "frechet_inception_64"
    assert make(published=False) == "frechet_unpublished"
    assert make(published=False, random=True) == "frechet_random"


def test_other_channels_and_other_widths_are_refused():
    with pytest.raises(ValueError, match="2 channels"):
        prepared_images(np.zeros((1, 8, 8, 2), np.float32), "torchvision")
    with pytest.raises(ValueError, match="no 100 features; take 64, 192, 768, 2048"):
        random_extractor(100)


def test_a_missing_file_says_what_to_fetch(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"jaxsim convert inception FILE --out inception\.npz"):
        load_extractor(tmp_path / "none.npz")
