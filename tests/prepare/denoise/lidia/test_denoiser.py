"""LIDIA against the published program and against a slow oracle."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.prepare.denoise.lidia import Variant, apply, from_published, published_shapes
from jaxsim.prepare.denoise.lidia import denoiser as whole
from jaxsim.prepare.denoise.lidia.patches import unfold
from tests.prepare.lidia_oracle import Oracle, look_around, random_state

MODES = {"stored": "bneval", "image": "bntrain"}
IMAGES = ("synthetic", "kitti")
RADIUS = 14


@pytest.fixture(scope="module")
def vectors(golden):
    return np.load(golden / "lidia/denoise.npz")


@pytest.fixture(scope="module")
def network(samples):
    """Variant and values of a published network by name."""
    return lambda name: from_published(dict(np.load(samples / f"weights_lidia/model_state_{name}.npz")))


def image_of(vectors, name):
    if name == "synthetic":
        return vectors["synthetic_noisy"][None, ..., None]
    return ((vectors["kitti_intensity_x100"] / 100 - 0.5) / 0.5).astype(np.float32)[None, ..., None]


SMALL = "small_sigma_25_bw"


@pytest.mark.parametrize(
    ("name", "image", "statistics"),
    [
        *((name, image, mode) for name in ("sigma_25_bw", "sigma_blind_bw") for image in IMAGES for mode in MODES),
        (SMALL, "synthetic", "stored"),
        pytest.param(SMALL, "synthetic", "image", marks=pytest.mark.slow),
        pytest.param(SMALL, "kitti", "stored", marks=pytest.mark.slow),
        pytest.param(SMALL, "kitti", "image", marks=pytest.mark.slow),
    ],
)
def test_equals_the_published_program(vectors, network, name, image, statistics):
    variant, values = network(name)
    clean = np.asarray(apply(values, image_of(vectors, image), variant=variant, statistics=statistics))
    off = np.abs(clean[0, ..., 0] - vectors[f"{name}__{image}__{MODES[statistics]}"])
    # Ties among neighbours fall either way: single cells move, as they do between float32 and float64 there.
    assert off.mean() < 5e-4
    assert np.quantile(off, 0.999) < 1e-2


@pytest.fixture(scope="module")
def neighbours(golden):
    return np.load(golden / "lidia/neighbours_synthetic.npz")


def offsets(neighbours, d):
    """Row and column offsets, in cells, that the published search found at a scale."""
    if d == 1:
        return neighbours["scale0_dy"].astype(int), neighbours["scale0_dx"].astype(int)
    found = np.zeros((2, 70, 70, 14), int)
    for r in range(2):
        for c in range(2):
            for k, axis in enumerate(("dy", "dx")):
                found[k, r::2, c::2] = neighbours[f"scale1_{r}{c}_{axis}"]
    return found


def test_with_the_published_neighbours_every_cell_is_the_published_one(vectors, network, neighbours, monkeypatch):
    def published(image, measured, *, p, d):
        assert measured is None
        dy, dx = offsets(neighbours, d)
        row = jnp.arange(70)[:, None, None] + RADIUS * d + dy
        column = jnp.arange(70)[None, :, None] + RADIUS * d + dx
        patches = unfold(image[None, ..., None], p, d)[0]
        own = patches[RADIUS * d : RADIUS * d + 70, RADIUS * d : RADIUS * d + 70, None]
        index = row * patches.shape[1] + column
        return ((patches[row, column] - own) ** 2).sum(-1), index.astype(jnp.int32)

    monkeypatch.setattr(whole, "nearest_patches", published)
    variant, values = network("sigma_25_bw")
    program = jax.jit(
        lambda v, x: whole._apply(
            whole.nnx.merge(whole.definition(variant), v), x, None, statistics="stored", chunk=None
        )
    )
    clean = np.asarray(program(values, image_of(vectors, "synthetic")))[0, ..., 0]
    np.testing.assert_allclose(clean, vectors["sigma_25_bw__synthetic__bneval"], atol=1e-5, rtol=0)


def test_the_search_finds_the_published_distances(vectors, neighbours):
    image = image_of(vectors, "synthetic")
    image = jnp.asarray(image - image.mean())
    fine = whole._scale(whole._bordered(image, None, 6)[0], None, 7, d=1)
    coarse = whole._scale(whole._blurred(whole._bordered(image, None, 10)[0], None)[0], None, 7, d=2)
    at0, at1 = (np.asarray(s.distance).T.reshape(70, 70, 14) for s in (fine, coarse))
    # Ours hold the patch's own variance last; theirs the distance to itself first.
    np.testing.assert_allclose(at0[::7, ::7, :13], neighbours["scale0_dist"][..., 1:], rtol=1e-5)
    for r in range(2):
        for c in range(2):
            theirs = neighbours[f"scale1_{r}{c}_dist"]
            np.testing.assert_allclose(at1[r::2, c::2][::7, ::7, :13], theirs[..., 1:], rtol=1e-5, atol=1e-6)
    for ours, theirs in ((fine, "net_dist0_sub"), (coarse, "net_dist1_sub")):
        np.testing.assert_allclose(np.asarray(ours.distance).T[::97], neighbours[theirs], rtol=1e-5, atol=1e-6)


@pytest.mark.long
def test_the_colour_network_equals_the_oracle():
    variant = Variant(colour=True)
    arrays = random_state(published_shapes(variant), seed=3)
    image = np.random.default_rng(1).uniform(-1, 1, (12, 13, variant.channels)).astype(np.float32)
    _, values = from_published(arrays)
    clean = np.asarray(apply(values, image[None], variant=variant))[0]
    centred, p = jnp.asarray(image[None] - image.mean((0, 1))), variant.p
    fine = whole._scale(whole._bordered(centred, None, p - 1)[0], None, p, d=1)
    blurred, _ = whole._blurred(*whole._bordered(centred, None, whole.coarse_margin(variant)))
    chosen = [np.asarray(scale.index).T for scale in (fine, whole._scale(blurred, None, p, d=2))]
    expected = Oracle(arrays, variant)(image.astype(np.float64), chosen)
    np.testing.assert_allclose(clean, expected, atol=2e-4 * np.abs(expected).max(), rtol=0)


@pytest.mark.parametrize(("channels", "p"), [(1, 7), (3, 5)])
def test_the_oracle_s_neighbours_are_ours(channels, p):
    wide = np.random.default_rng(5).uniform(-1, 1, (16, 15, channels)).astype(np.float32)
    near, distances, shape = look_around(wide.astype(np.float64), p, 2)
    ours = whole._scale(jnp.asarray(wide[None]), None, p, d=2)
    np.testing.assert_allclose(np.asarray(ours.distance).T, distances, rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(np.asarray(ours.table[ours.index]).transpose(1, 0, 2), near, atol=1e-6)
    assert len(near) == shape[0] * shape[1]


@pytest.mark.long
def test_chunks_are_a_matter_of_memory_alone_where_statistics_are_stored():
    variant = Variant(small=True)
    _, values = from_published(random_state(published_shapes(variant), seed=8))
    image = np.random.default_rng(2).uniform(-1, 1, (2, 13, 17, 1)).astype(np.float32)
    both = np.asarray(apply(values, image, variant=variant, chunk=10**6))
    np.testing.assert_allclose(np.asarray(apply(values, image, variant=variant, chunk=100)), both, atol=1e-4)
    turned = np.asarray(apply(values, image[::-1].copy(), variant=variant, chunk=100))
    np.testing.assert_allclose(turned[::-1], both, atol=1e-4)
