"""The C++ form of sparse convolutions against XLA's: tables to the number, features and gradients but for rounding."""

import ctypes
import shutil
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.sharding import AxisType, NamedSharding, PartitionSpec

from jaxsim.config import RoiConfig, VoxelConfig
from jaxsim.detect import roi_head, sparse
from jaxsim.detect.roi_head import voxel_query
from jaxsim.detect.sparse import (
    CUBE,
    ConvWindow,
    Sites,
    cells,
    sparse_conv,
    strided_sites,
    strided_tables,
    submanifold_tables,
)
from jaxsim.native import build

SHAPE = (6, 21, 40)
WINDOWS = {
    "halving": ConvWindow(CUBE, (2, 2, 2), (1, 1, 1)),
    "halving, unpadded along z": ConvWindow(CUBE, (2, 2, 2), (0, 1, 1)),
    "along z": ConvWindow((3, 1, 1), (2, 1, 1), (0, 0, 0)),
    "strides beyond the kernel": ConvWindow((1, 2, 3), (2, 3, 4), (0, 1, 2)),
    "wide and unstrided": ConvWindow((3, 5, 4), (1, 1, 1), (1, 2, 2)),
    "padded beyond the kernel": ConvWindow((1, 1, 2), (1, 2, 3), (2, 1, 5)),
}
SHARES = (0.0, 0.02, 0.3, 1.0)
CHANNELS = ((4, 16), (5, 7), (1, 1), (16, 32), (33, 20), (64, 64), (3, 135))


pytestmark = pytest.mark.usefixtures("quick_programs")


@pytest.fixture(autouse=True)
def compiled():
    if not build.available():
        pytest.skip(f"no C++ form here: {build.form()}")


def both(monkeypatch, function, *arguments):
    """The C++ form as a compiled program, and XLA's; programs of one function are traced once: each has its own."""
    programs = []
    for setting in ("1", "0"):
        with monkeypatch.context() as patch:
            patch.setenv(build.SETTING, setting)
            lowered = jax.jit(lambda *given: function(*given)).lower(*arguments)
        assert ("@jaxsim_" in lowered.as_text()) == (setting == "1")
        programs.append(lowered.compile())
    return lambda *given: [jax.device_get(program(*given)) for program in programs]


def same(answers, **tolerance):
    mine, xlas = (jax.tree.leaves(answer) for answer in answers)
    assert len(mine) == len(xlas)
    for one, other in zip(mine, xlas, strict=True):
        if tolerance:
            np.testing.assert_allclose(one, other, **tolerance)
        else:
            np.testing.assert_array_equal(one, other)


def sites_of(share, seed, capacity=5050):
    """Sites of a share of the grid, and unused places."""
    keys = np.flatnonzero(np.random.default_rng(seed).random(cells(SHAPE)) < share).astype(np.int32)
    padded = np.full(capacity, cells(SHAPE), np.int32)
    padded[: len(keys)] = keys
    return Sites(jnp.asarray(padded), SHAPE)


def normal(seed, *shape):
    return jnp.asarray(np.random.default_rng(seed).standard_normal(shape), jnp.float32)


def strided(sites, window, capacity):
    out, dropped = strided_sites(sites, window, capacity)
    return out, dropped, strided_tables(sites, out, window)


@pytest.mark.parametrize("window", WINDOWS)
def test_strided_sites_and_tables_are_the_same(window, monkeypatch):
    """Where there is room for some of the outputs alone, too."""
    for capacity in (7, 6000):
        answers = both(monkeypatch, lambda sites, c=capacity: strided(sites, WINDOWS[window], c), sites_of(0, 1))
        for share in SHARES:
            same(answers(sites_of(share, 1)))


def test_submanifold_tables_are_the_same(monkeypatch):
    answers = both(monkeypatch, submanifold_tables, sites_of(0, 2))
    for share in SHARES:
        same(answers(sites_of(share, 2)))


def with_gradients(tables):
    """A convolution's values and gradients, as a function of features, weights, the values' change, and sites."""

    def train(x, weights, change, sites):
        y, back = jax.vjp(lambda x, w: sparse_conv(x, w, tables(sites)), x, weights)
        return y, back(change)

    return train


def near(answers):
    """The same but for rounding; sums over thousands of rows are as exact as their largest."""
    largest = max(float(np.abs(leaf).max()) for leaf in jax.tree.leaves(answers[1]))
    same(answers, rtol=2e-5, atol=5e-6 * max(largest, 1.0))


@pytest.mark.parametrize("channels", CHANNELS)
def test_values_and_gradients_are_the_same_for_any_channels(channels, monkeypatch):
    """Of 1500 sites, more than a task's rows, and a strided convolution's outputs, some of which have no room."""
    c, d = channels
    sites, room = sites_of(0.3, 3, 1600), 1100
    given = normal(4, 1600, c), normal(6, *CUBE, c, d), normal(5, room, d), sites
    near(both(monkeypatch, with_gradients(lambda s: strided(s, WINDOWS["halving"], room)[2]), *given)(*given))


def test_values_and_gradients_are_the_same_for_any_share_of_sites(monkeypatch):
    x, weights, change = normal(8, 5050, 16), normal(10, *CUBE, 16, 24), normal(9, 5050, 24)
    answers = both(monkeypatch, with_gradients(submanifold_tables), x, weights, change, sites_of(0, 7))
    for share in SHARES:
        near(answers(x, weights, change, sites_of(share, 7)))


def batch_of_three():
    """Sites, one sample of them without any, features, weights."""
    sites = [sites_of(share, k, 1700) for k, share in enumerate((0.3, 0.0, 0.05))]
    return jax.tree.map(lambda *keys: jnp.stack(keys), *sites), normal(11, 3, 1700, 12), normal(12, *CUBE, 12, 20)


def batch_loss(x, weights, sites):
    y = jax.vmap(sparse_conv, (0, None, 0))(x, weights, jax.vmap(submanifold_tables)(sites))
    return (jnp.sin(y) * jax.vmap(lambda s: s.valid)(sites)[..., None].astype(y.dtype)).sum(axis=(1, 2))


def test_a_batch_is_its_samples(monkeypatch):
    sites, x, weights = batch_of_three()
    train = jax.value_and_grad(lambda *given: (batch_loss(*given).sum(), batch_loss(*given)), (0, 1), has_aux=True)
    answers = both(monkeypatch, train, x, weights, sites)(x, weights, sites)
    near(answers)
    values, one = answers[0][0][1], jax.jit(batch_loss)
    alone = [one(x[k : k + 1], weights, jax.tree.map(lambda key, k=k: key[k : k + 1], sites)) for k in range(3)]
    np.testing.assert_allclose(values, np.concatenate(alone), rtol=1e-6)
    assert values[1] == 0


def test_a_batch_that_is_cut_over_devices_is_answered_on_each_for_its_part():
    if jax.device_count() < 2:
        pytest.skip("one device")
    mesh = jax.make_mesh((2,), ("data",), axis_types=(AxisType.Auto,), devices=jax.devices()[:2])
    cut, whole = (NamedSharding(mesh, PartitionSpec(*axis)) for axis in (("data",), ()))
    sites, x, weights = batch_of_three()
    x, sites = jax.tree.map(lambda a: jax.device_put(jnp.concatenate([a, a[:1]]), cut), (x, sites))
    program = jax.jit(lambda *given: batch_loss(*given)).lower(x, jax.device_put(weights, whole), sites).compile()
    calls = [line for line in program.as_text().splitlines() if 'custom_call_target="jaxsim_convolve"' in line]
    assert calls
    assert all("f32[2,1700,20]" in line for line in calls)  # two of the four samples
    one = jax.jit(lambda *given: batch_loss(*given))(*jax.device_get((x, weights, sites)))
    np.testing.assert_allclose(program(x, jax.device_put(weights, whole), sites), one, rtol=1e-6)


def test_batches_of_batches_are_their_samples():
    sites, x, weights = batch_of_three()
    twice = [jax.tree.map(lambda leaf: jnp.stack([leaf, leaf[::-1]]), given) for given in (x, sites)]
    loss = jax.jit(jax.vmap(lambda x, sites: batch_loss(x, weights, sites)))(*twice)
    one = jax.jit(batch_loss)(x, weights, sites)
    np.testing.assert_allclose(loss, np.stack([one, one[::-1]]), rtol=1e-6)


def test_an_answer_does_not_depend_on_chance():
    """Threads take their tasks as they come; sums keep their order."""
    sites, x, weights = batch_of_three()
    train = jax.jit(jax.grad(lambda x, w: batch_loss(x, w, sites).sum(), (0, 1)))
    first = jax.device_get(train(x, weights))
    for _ in range(5):
        jax.tree.map(np.testing.assert_array_equal, jax.device_get(train(x, weights)), first)


def test_a_query_finds_the_same_sites(monkeypatch):
    voxels = VoxelConfig(range_m=(0, -2.1, -1.2, 8, 2.1, 1.2), size_m=(0.1, 0.1, 0.2))
    xyz = jnp.asarray(np.random.default_rng(14).uniform([-1, -3, -2], [9, 3, 2], (700, 3)), jnp.float32)
    for samples, reach, radius in ((6, 3, 0.4), (16, 4, 0.8), (1, 1, 2.0)):
        at = {"stride": 2, "radius_m": radius, "config": RoiConfig(samples=samples, reach=reach)}
        answers = both(monkeypatch, lambda s, p, at=at: voxel_query(s, p, voxels, **at), sites_of(0, 13), xyz)
        for share in SHARES:
            found = answers(sites_of(share, 13), xyz)
            same(found)
            assert found[0][1].any() == (share > 0)


def test_float64_keeps_xlas_form(float64):
    sites = sites_of(0.3, 15)
    x, weights = jnp.ones((len(sites.key), 2)), jnp.ones((*CUBE, 2, 2))
    assert x.dtype == np.float64
    text = jax.jit(sparse_conv).lower(x, weights, submanifold_tables(sites)).as_text()
    assert "jaxsim_" not in text


@pytest.mark.long
def test_a_wrong_answer_is_found(monkeypatch, tmp_path):
    """A copy of the sources with a fault in each function is not taken for the form that it should be."""
    faults = {
        "convolve.cc": [("i < c; ++i) {\n    Vec w", "i + 1 < c; ++i) {\n    Vec w"), ("slice = 1;", "slice = 2;")],
        "tables.cc": [("std::min(x + kernel[2], shape[2])", "std::min(x + kernel[2], shape[2] - 1)")],
        "query.cc": [("right = std::min<int64_t>(cell[2] + reach,", "right = std::min<int64_t>(cell[2] + reach - 1,")],
    }  # fmt: skip
    folder = tmp_path / "native"
    shutil.copytree(build.SOURCE.parent, folder)
    for name, changes in faults.items():
        text = (folder / name).read_text()
        for right, wrong in changes:
            assert text.count(right) == 1
            text = text.replace(right, wrong)
        (folder / name).write_text(text)
    monkeypatch.setattr(build, "SOURCE", folder / "all.cc")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    functions = ctypes.CDLL(str(build.build()))
    for name in build.FUNCTIONS:
        target = jax.ffi.pycapsule(getattr(functions, f"jaxsim_{name}"))
        jax.ffi.register_ffi_target(f"jaxsim_wrong_{name}", target, platform="cpu")
    right = sparse.call
    checks = {
        "neighbours": test_submanifold_tables_are_the_same,
        "convolve": partial(test_values_and_gradients_are_the_same_for_any_channels, (4, 16)),
        "weight_gradient": partial(test_values_and_gradients_are_the_same_for_any_channels, (4, 16)),
        "query": test_a_query_finds_the_same_sites,
    }
    for faulty, check in checks.items():

        def call(name, *given, faulty=faulty, **more):
            return right(f"wrong_{name}" if name == faulty else name, *given, **more)

        for module in (sparse, roi_head):
            monkeypatch.setattr(module, "call", call)
        with pytest.raises(AssertionError, match="Mismatched elements"):
            check(monkeypatch)
