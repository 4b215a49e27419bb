"""LIDIA against the published program and against a slow oracle."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.prepare.denoise.lidia import Variant, apply, from_published, published_shapes
from jaxsim.prepare.denoise.lidia import denoiser as whole
from jaxsim.prepare.denoise.lidia.layers import BatchNorm
from jaxsim.prepare.denoise.lidia.patches import counts, fold, unfold
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


@pytest.mark.parametrize(
    ("variant", "parameters"), [(Variant(), 61_589), (Variant(colour=True), 94_067), (Variant(small=True), 40_226)]
)
def test_parameters_are_as_many_as_published(variant, parameters):
    shapes = published_shapes(variant)
    assert sum(int(np.prod(s)) for name, s in shapes.items() if "running" not in name) == parameters


def test_names_are_those_of_the_published_state_dict(samples):
    for name, variant in (("sigma_25_bw", Variant()), ("small_sigma_25_bw", Variant(small=True))):
        theirs = np.load(samples / f"weights_lidia/model_state_{name}.npz")
        left = {n for n in theirs.files if not n.endswith(("num_batches_tracked", "bilinear_conv.weight"))}
        assert {n: theirs[n].shape for n in left} == published_shapes(variant)


def test_chunks_are_a_matter_of_memory_alone_where_statistics_are_stored():
    variant = Variant(small=True)
    _, values = from_published(random_state(published_shapes(variant), seed=8))
    image = np.random.default_rng(2).uniform(-1, 1, (2, 13, 17, 1)).astype(np.float32)
    both = np.asarray(apply(values, image, variant=variant, chunk=10**6))
    np.testing.assert_allclose(np.asarray(apply(values, image, variant=variant, chunk=100)), both, atol=1e-4)
    turned = np.asarray(apply(values, image[::-1].copy(), variant=variant, chunk=100))
    np.testing.assert_allclose(turned[::-1], both, atol=1e-4)


def test_folding_is_the_adjoint_of_unfolding():
    rng = np.random.default_rng(0)
    image = rng.standard_normal((2, 15, 17, 3)).astype(np.float32)
    for p, d in ((7, 1), (5, 2)):
        apart = np.asarray(unfold(image, p, d))
        patches = rng.standard_normal(apart.shape).astype(np.float32)
        back = jax.jit(fold, static_argnums=(1, 2))
        assert float((image * np.asarray(back(patches, p, d))).sum()) == pytest.approx(
            (apart * patches).sum(), rel=1e-4
        )
        again = back(apart, p, d) / counts(*apart.shape[1:3], p, d=d)
        np.testing.assert_allclose(np.asarray(again), image, rtol=1e-5, atol=1e-6)


def test_training_moves_the_stored_statistics_a_tenth_of_the_way():
    x = jnp.asarray(np.random.default_rng(4).normal(3.0, 2.0, (2, 50, 6)), jnp.float32)
    counted = jnp.ones(50).at[40:].set(0.0)
    norm = BatchNorm(2)
    out = np.asarray(norm(x, counted, "training"))
    seen = np.asarray(x)[:, :40].reshape(2, -1)
    np.testing.assert_allclose(np.asarray(norm.running_mean[...]), 0.1 * seen.mean(1), rtol=1e-5)
    np.testing.assert_allclose(np.asarray(norm.running_var[...]), 0.9 + 0.1 * seen.var(1, ddof=1), rtol=1e-5)
    np.testing.assert_allclose(out[:, :40].mean((1, 2)), 0, atol=1e-5)
    np.testing.assert_allclose(out[:, :40].std((1, 2)), 1, rtol=1e-4)
