"""PENet against the published program and against slow oracles."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax import nnx

from jaxsim.prepare.depth.penet.cspn import Guide, from_neighbours, propagate, step
from jaxsim.prepare.depth.penet.geometry import coordinates, nearest_of_four, twice
from jaxsim.prepare.depth.penet.layers import MOST_SCALE, MOST_SHIFT, BatchNorm, TransposedConv
from jaxsim.prepare.depth.penet.published import (
    CONVERTERS,
    abstract,
    create,
    definition,
    from_published,
    published_shapes,
    to_published,
)

UNREAD = ("encoder3", "encoder5", "encoder7")


@pytest.fixture(scope="module")
def vectors(golden):
    return np.load(golden / "penet/penet_c2.npz")


@pytest.fixture(scope="module")
def theirs(vectors):
    """Names and shapes of the published state dict."""
    return {
        str(name): tuple(int(n) for n in str(shape).split("x") if n)
        for name, shape in zip(vectors["check_name"], vectors["check_shape"], strict=True)
    }


def inputs(vectors):
    sparse = (vectors["sparse_depth_u16_div256"] / 256).astype(np.float32)[None]
    arrays = vectors["rgb_u8"][None].astype(np.float32), sparse, sparse > 0, vectors["K"][None]
    return tuple(jnp.asarray(array) for array in arrays)


def drawn(shapes, seed):
    """Weights by the golden README's rule."""
    rng, arrays = np.random.default_rng(seed), {}
    for name in sorted(shapes):
        if name.endswith("num_batches_tracked") or name in UNREAD:
            continue
        x = rng.standard_normal(shapes[name])
        if len(shapes[name]) > 1:
            x /= np.sqrt(np.prod(shapes[name][1:]))
        elif name.endswith("running_var"):
            x = 0.5 + np.abs(x)
        else:
            x = 0.1 * x + name.endswith("weight")
        arrays[name] = x.astype(np.float32)
    return arrays


def test_names_and_shapes_are_those_of_the_published_state_dict(theirs):
    ours = published_shapes()
    assert ours == {n: s for n, s in theirs.items() if not n.endswith("num_batches_tracked") and n not in UNREAD}
    assert sum(int(np.prod(s)) for n, s in ours.items() if "running" not in n) == 131_908_376


@pytest.mark.slow
def test_published_weights_give_the_published_depth(vectors, theirs):
    width, values = from_published(drawn(theirs, int(vectors["seed"])))
    rgb, sparse, given, intrinsics = inputs(vectors)

    @jax.jit
    def run(values):
        network = nnx.merge(definition(width, "published"), values)
        seen = network.coarse(rgb, sparse, given, intrinsics=intrinsics, train=False)
        guides = {
            "guide3_sub": network.iter_guide_layer3(seen.fine, train=False)[:, ::8, ::16],
            "guide5_s2_sub": network.iter_guide_layer5_s2(seen.coarse, train=False)[:, ::4, ::8],
        }
        geo, b = coordinates(sparse, given, intrinsics, scales=6, convention="published"), network.backbone
        x = b.rgb_conv_init(jnp.concatenate([rgb, sparse[..., None]], -1), train=False)
        for k in range(5):
            x = getattr(b, f"rgb_encoder_layer{2 * k + 1}")(x, geo[k], geo[k + 1], train=False)
            x = getattr(b, f"rgb_encoder_layer{2 * k + 2}")(x, geo[k + 1], geo[k + 1], train=False)
        half = twice(from_neighbours(network.iter_guide_layer3_s2(seen.coarse, train=False)))
        first = step(jnp.unstack(half, axis=-1), seen.fused, seen.fused, dilation=2)
        return seen, guides, first, network.refine(seen, sparse, given, train=False), x

    seen, guides, first, final, encoded = jax.tree.map(np.asarray, run(values))

    def close(ours, name):
        expected = vectors[name]
        np.testing.assert_allclose(ours, expected, atol=1e-4 * np.abs(expected).max(), rtol=0, err_msg=name)

    close(np.stack([seen.colour, seen.logits[..., 0]], 1), "colour_branch_out")
    close(np.stack([seen.depth, seen.logits[..., 1]], 1), "depth_branch_out")
    close(encoded[..., ::8].transpose(0, 3, 1, 2), "colour_encoder10")
    close(seen.fused[:, None], "coarse")
    close(final[:, None], "final")
    close(seen.fine[:, ::8, ::16, ::4].transpose(0, 3, 1, 2), "feature_s1_sub")
    close(seen.coarse[:, ::8, ::16, ::4].transpose(0, 3, 1, 2), "feature_s2_sub")
    close(first[:, None], "cspn3_s2_step1")
    for name, guide in guides.items():
        close(guide.transpose(0, 3, 1, 2), name)


def test_published_coordinates_are_the_published_ones(vectors):
    _, sparse, given, intrinsics = inputs(vectors)
    geo = coordinates(sparse, given, intrinsics, scales=6, convention="published")
    for k, name in ((1, "geo_s2"), (3, "geo_s4")):
        np.testing.assert_allclose(np.asarray(geo[k]).transpose(0, 3, 1, 2), vectors[name], rtol=1e-5, atol=1e-5)


def test_exact_coordinates_are_where_the_points_are():
    rng = np.random.default_rng(0)
    intrinsics = np.array([[700.0, 0, 31.0], [0, 710, 12.5], [0, 0, 1]], np.float32)
    depth = rng.uniform(5, 50, (1, 32, 64)).astype(np.float32)
    given = rng.random(depth.shape) < 0.3
    fine, half, *_ = coordinates(depth, given, intrinsics[None], scales=3, convention="exact")
    v, u = np.mgrid[:32, :64]
    ray = np.stack([u, v, np.ones_like(u)], -1) @ np.linalg.inv(intrinsics).T
    expected = np.where(given[0][..., None], ray * depth[0][..., None], 0)[..., [1, 0, 2]]
    np.testing.assert_allclose(np.asarray(fine)[0], expected, rtol=1e-4, atol=1e-4)
    # At half the size a cell's place is the middle of its four pixels, seen with the same camera.
    nearest, known = (np.asarray(x)[0] for x in nearest_of_four(jnp.asarray(depth), jnp.asarray(given)))
    np.testing.assert_allclose(
        np.asarray(half)[0, ..., 1], nearest * (2 * np.arange(32) + 0.5 - 31.0) / 700.0, rtol=1e-4, atol=1e-4
    )
    assert (nearest[~known] == 0).all()
    blocks = np.where(given, depth, np.inf)[0].reshape(16, 2, 32, 2).min((1, 3))
    np.testing.assert_array_equal(nearest[known], blocks[np.isfinite(blocks)])


@pytest.mark.parametrize(("k", "dilation"), [(3, 2), (5, 1)])
def test_depth_spreads_as_the_formula_says(k, dilation):
    rng = np.random.default_rng(k)
    h, w, c = 9, 11, k // 2
    guide = rng.standard_normal((1, h, w, k * k)).astype(np.float32)
    depth, start = rng.uniform(1, 9, (2, 1, h, w)).astype(np.float32)
    moved = np.asarray(jax.jit(from_neighbours)(guide))
    taps = [moved[..., o] for o in range(k * k)]
    out = np.asarray(jax.jit(step, static_argnames="dilation")(taps, depth, start, dilation=dilation))
    for row in range(h):
        for column in range(w):
            total = 0.0
            for o in range(k * k):
                i, j = o // k - c, o % k - c
                beside = 0 <= row + i < h and 0 <= column + j < w
                weight = guide[0, row + i, column + j, k * k - 1 - o] if beside else 0.0
                assert moved[0, row, column, o] == pytest.approx(weight)
                r, s = row + dilation * i, column + dilation * j
                if o == k * k // 2:
                    total += weight * start[0, row, column]
                elif 0 <= r < h and 0 <= s < w:
                    total += weight * depth[0, r, s]
            assert out[0, row, column] == pytest.approx(total, rel=1e-4, abs=1e-4)


def test_trusted_points_are_kept_and_affinities_sum_to_one():
    guide = Guide(4, 3, rngs=nnx.Rngs(0))(
        jnp.asarray(np.random.default_rng(0).random((1, 8, 8, 4)), jnp.float32), train=False
    )
    np.testing.assert_allclose(np.asarray(guide.sum(-1)), 1, atol=1e-5)
    neighbours = jnp.abs(guide).sum(-1) - jnp.abs(guide[..., 4])
    np.testing.assert_allclose(np.asarray(neighbours), 1, atol=1e-5)
    start = jnp.full((1, 8, 8), 5.0)
    sparse = jnp.zeros((1, 8, 8)).at[0, 3, 3].set(20.0)
    trust = (sparse > 0).astype(jnp.float32)
    confidence = jnp.full((1, 8, 8, 3), 0.25)
    out = propagate([from_neighbours(guide)] * 3, confidence, start, sparse=sparse, trust=trust, dilation=1)
    assert float(out[0, 3, 3]) == 15  # three kernels hold the point's 20


@pytest.mark.parametrize(("size", "stride"), [(5, 2), (3, 1)])
def test_a_transposed_convolution_spreads_every_cell_over_its_taps(size, stride):
    layer = TransposedConv(2, 3, size, stride=stride, rngs=nnx.Rngs(1))
    x = np.random.default_rng(0).standard_normal((1, 4, 5, 2)).astype(np.float32)
    published = np.asarray(layer.kernel[...])[::-1, ::-1]
    full = np.zeros((4 * stride + 2 * size, 5 * stride + 2 * size, 3))
    for i in range(4):
        for j in range(5):
            full[stride * i : stride * i + size, stride * j : stride * j + size] += np.einsum(
                "c,abco->abo", x[0, i, j], published
            )
    half = size // 2
    expected = full[half : half + 4 * stride, half : half + 5 * stride]
    np.testing.assert_allclose(np.asarray(layer(jnp.asarray(x)))[0], expected, atol=1e-5)


def test_renormalised_batches_give_what_the_stored_statistics_give_and_move_them():
    rng = np.random.default_rng(0)
    x = jnp.asarray(rng.normal([3.0, -1.0], [2.0, 0.5], (2, 8, 8, 2)), jnp.float32)
    norm = BatchNorm(2)
    norm.running_mean[...], norm.running_var[...] = jnp.array([2.0, -1.5]), jnp.array([3.0, 0.5])
    norm.weight[...], norm.bias[...] = jnp.array([2.0, 0.5]), jnp.array([10.0, 1.0])
    stored = np.asarray(norm(x, train=False))
    np.testing.assert_allclose(np.asarray(norm(x, train="renorm")), stored, rtol=1e-4, atol=1e-4)
    assert 2 < norm.running_mean[...][0] < 2.1
    # A batch's own statistics take away how far its values are; these do not.
    far = np.asarray(norm(x + 4, train="renorm")) - np.asarray(norm(x, train="renorm"))
    assert far[..., 0].mean() > 3
    assert abs(np.asarray(norm(x + 4, train=True) - norm(x, train=True))).max() < 1e-4


def test_a_batch_far_from_the_stored_statistics_is_held():
    norm = BatchNorm(1)
    x = jnp.asarray(np.random.default_rng(0).normal(500.0, 100.0, (1, 8, 8, 1)), jnp.float32)
    out = np.asarray(norm(x, train="renorm"))
    assert out.mean() == pytest.approx(MOST_SHIFT, abs=1e-3)
    assert out.std() == pytest.approx(MOST_SCALE, abs=1e-3)


def test_weights_go_to_the_published_form_and_back():
    values = create(2, seed=0)
    arrays = to_published(values)
    assert {name: a.shape for name, a in arrays.items()} == published_shapes(2)
    width, again = from_published(arrays)
    assert width == 2
    jax.tree.map(np.testing.assert_array_equal, jax.tree.map(np.asarray, values), again)


def test_convert_takes_the_published_network_alone():
    blank = {f"model.module.{n}": np.broadcast_to(np.float32(0), s) for n, s in published_shapes().items()}
    kept = CONVERTERS["penet"].convert({**blank, "epoch": np.array(3)})
    assert len(kept) == len(published_shapes())
    with pytest.raises(ValueError, match="it is ENet or PENet_C1; take PENet_C2"):
        CONVERTERS["penet"].convert({n: a for n, a in blank.items() if "_s2." not in n})
    bare = {n.removeprefix("model.module."): a for n, a in blank.items()}
    enet = {n.removeprefix("backbone."): a for n, a in bare.items() if n.startswith("backbone.")}
    with pytest.raises(ValueError, match="it is ENet or PENet_C1; take PENet_C2"):
        CONVERTERS["penet"].convert({f"model.{n}": a for n, a in enet.items()})
    with pytest.raises(ValueError, match=r"decoder_layer1\.0\.weight is \(64, 32, 5, 5\), not \(1024, 512, 5, 5\)"):
        CONVERTERS["penet"].convert({n: np.zeros(s, np.float32) for n, s in published_shapes(2).items()})
    with pytest.raises(ValueError, match="it is no PENet"):
        from_published({"conv1.weight": np.zeros((3, 3))})
    assert len(jax.tree.leaves(abstract(32))) == len(kept)
