"""Sparse convolutions against spconv's outputs and against a dense convolution, gradients included."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.detect.sparse import (
    CUBE,
    ConvWindow,
    Sites,
    cells,
    key_of,
    neighbours,
    sparse_conv,
    strided_shape,
    strided_sites,
    strided_tables,
    submanifold_tables,
)

pytestmark = pytest.mark.usefixtures("quick_programs")

LAYERS = {
    "sparse_k3_s1_p1": ConvWindow(CUBE, (1, 1, 1), (1, 1, 1)),
    "sparse_k3_s2_p1": ConvWindow(CUBE, (2, 2, 2), (1, 1, 1)),
    "sparse_k3_s2_p011": ConvWindow(CUBE, (2, 2, 2), (0, 1, 1)),
    "sparse_k311_s211_p0": ConvWindow((3, 1, 1), (2, 1, 1), (0, 0, 0)),
}
HALVING = LAYERS["sparse_k3_s2_p1"]


@partial(jax.jit, static_argnames=("window", "capacity"))
def strided(x, weights, sites, window, capacity):
    """Output, its sites, and how many did not fit."""
    out, dropped = strided_sites(sites, window, capacity)
    return sparse_conv(x, weights, strided_tables(sites, out, window)), out, dropped


@jax.jit
def submanifold(x, weights, sites):
    return sparse_conv(x, weights, submanifold_tables(sites))


find = jax.jit(neighbours, static_argnames="window")
find_sites = jax.jit(strided_sites, static_argnames=("window", "capacity"))


def sites_of(zyx, shape, capacity):
    """Sites of places in any order, and the places' rows in them."""
    keys = np.asarray(key_of(jnp.asarray(zyx, jnp.int32), shape))
    order = np.argsort(keys)
    padded = np.full(capacity, cells(shape), np.int32)
    padded[: len(keys)] = keys[order]
    return Sites(jnp.asarray(padded), shape), order


def kernel_of(published_weight):
    return jnp.asarray(np.moveaxis(published_weight, 0, -1))


def random_sample(seed, shape, share):
    rng = np.random.default_rng(seed)
    zyx = np.argwhere(rng.random(shape) < share)
    return zyx, rng.standard_normal((len(zyx), 5)).astype(np.float32), rng


def dense_of(sites, features):
    volume = jnp.zeros((cells(sites.shape), features.shape[1]))
    return volume.at[sites.key].set(features, mode="drop").reshape(*sites.shape, -1)


def dense_conv(volume, kernel, stride, padding):
    return jax.lax.conv_general_dilated(
        volume[None],
        kernel,
        stride,
        [(p, p) for p in padding],
        dimension_numbers=("NDHWC", "DHWIO", "NDHWC"),
        precision="highest",
    )[0]


@pytest.mark.parametrize("layer", ["subm_k3", "subm_k3_bias"])
def test_submanifold_convolution_is_spconvs(published, layer):
    vectors = published("sparse_conv")
    coords, features = vectors["coords_bzyx"], vectors["features"]
    shape = tuple(int(s) for s in vectors["spatial_shape_zyx"])
    kernel = kernel_of(vectors[f"{layer}_weight_okzkykxi"])
    for sample in range(2):
        mine = coords[:, 0] == sample
        sites, order = sites_of(coords[mine, 1:], shape, 2000)
        x = jnp.zeros((2000, 8)).at[: mine.sum()].set(features[mine][order])
        y = submanifold(x, kernel, sites)[: mine.sum()]
        if "bias" in layer:
            y = y + vectors[f"{layer}_bias"][None]
        np.testing.assert_allclose(y, vectors[f"{layer}_out_features"][mine][order], atol=1e-5)


@pytest.mark.parametrize("layer", LAYERS)
def test_strided_convolution_is_spconvs(published, layer):
    vectors = published("sparse_conv")
    coords, features = vectors["coords_bzyx"], vectors["features"]
    shape = tuple(int(s) for s in vectors["spatial_shape_zyx"])
    kernel = kernel_of(vectors[f"{layer}_weight_okzkykxi"])
    places, outputs = [], []
    for sample in range(2):
        mine = coords[:, 0] == sample
        sites, order = sites_of(coords[mine, 1:], shape, 2000)
        x = jnp.zeros((2000, 8)).at[: mine.sum()].set(features[mine][order])
        y, out, dropped = strided(x, kernel, sites, LAYERS[layer], 16000)
        assert dropped == 0
        assert out.shape == tuple(vectors[f"{layer}_out_shape"])
        used = np.asarray(out.valid)
        places.append(np.column_stack([np.full(used.sum(), sample), np.asarray(out.zyx)[used]]))
        outputs.append(np.asarray(y)[used])
    places, outputs = np.concatenate(places), np.concatenate(outputs)
    assert len(places) == vectors[f"{layer}_n_out"]
    rows = vectors.get(f"{layer}_out_rows_of_sorted", np.arange(len(places)))
    np.testing.assert_array_equal(places[rows], vectors[f"{layer}_out_coords_bzyx_sorted"])
    np.testing.assert_allclose(outputs[rows], vectors[f"{layer}_out_features"], atol=1e-5)


@pytest.mark.parametrize("window", [*LAYERS.values(), None])
def test_values_and_gradients_are_those_of_a_dense_convolution(window):
    """Without a window, of a submanifold convolution."""
    shape, capacity = (6, 8, 7), 300
    size, stride, padding = window or ConvWindow(CUBE, (1, 1, 1), (1, 1, 1))

    def sparse(x, weights, change, sites):
        if window is None:
            return (submanifold(x, weights, sites) * change[:capacity] * sites.valid[:, None].astype(x.dtype)).sum()
        y, out, _ = strided(x, weights, sites, window, 400)
        return (y * change * out.valid[:, None].astype(x.dtype)).sum()

    def dense(x, weights, change, sites):
        volume = dense_conv(dense_of(sites, x), weights, stride, padding).reshape(-1, 4)
        out = sites if window is None else find_sites(sites, window, capacity=400)[0]
        return (volume.at[out.key].get(mode="fill", fill_value=0) * change[: len(out.key)]).sum()

    mine, theirs = (jax.jit(jax.value_and_grad(f, (0, 1))) for f in (sparse, dense))
    for share in (0.02, 0.6):
        zyx, features, rng = random_sample(3, shape, share)
        sites, _ = sites_of(zyx, shape, capacity)
        x = jnp.zeros((capacity, 5)).at[: len(zyx)].set(features)
        weights = jnp.asarray(rng.standard_normal((*size, 5, 4)), jnp.float32)
        change = jnp.asarray(rng.standard_normal((400, 4)), jnp.float32)
        got, wanted = mine(x, weights, change, sites), theirs(x, weights, change, sites)
        jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-4, atol=2e-4), got, wanted)


def test_a_table_is_what_looking_up_every_place_gives():
    shape = (4, 5, 6)
    zyx, _, _ = random_sample(5, shape, 0.4)
    sites, _ = sites_of(zyx, shape, len(zyx) + 4)
    out, _ = find_sites(sites, HALVING, capacity=60)
    table = np.asarray(find(sites, out, HALVING))
    rows = {tuple(place): row for row, place in enumerate(np.asarray(sites.zyx)[: len(zyx)].tolist())}
    for place, valid, found in zip(np.asarray(out.zyx), np.asarray(out.valid), table, strict=True):
        corner = place * 2 - 1
        wanted = [rows.get(tuple((corner + d).tolist()), len(sites.key)) for d in np.ndindex(3, 3, 3)]
        assert found.tolist() == (wanted if valid else [len(sites.key)] * 27)


def test_outputs_beyond_the_capacity_are_counted():
    zyx, _, _ = random_sample(6, (6, 8, 7), 0.5)
    sites, _ = sites_of(zyx, (6, 8, 7), len(zyx))
    whole, none = find_sites(sites, HALVING, capacity=100)
    few, dropped = find_sites(sites, HALVING, capacity=10)
    assert none == 0
    assert dropped == whole.valid.sum() - 10
    np.testing.assert_array_equal(few.key, whole.key[:10])


def test_nothing_in_gives_nothing_out():
    sites, _ = sites_of(np.zeros((0, 3), int), (6, 8, 7), 12)
    y, out, _ = strided(jnp.ones((12, 5)), jnp.ones((3, 3, 3, 5, 4)), sites, HALVING, 20)
    assert not out.valid.any()
    assert (y == 0).all()


def test_a_grid_whose_keys_do_not_fit_is_refused():
    with pytest.raises(ValueError, match="beyond 32 bits"):
        cells((2000, 2000, 2000))
    assert strided_shape((41, 1600, 1408), HALVING) == (21, 800, 704)
