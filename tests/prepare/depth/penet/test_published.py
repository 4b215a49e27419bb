"""PENet against the published program and against slow oracles."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax import nnx

from jaxsim.prepare.depth.penet.layers import (
    from_neighbours,
    step,
)
from jaxsim.prepare.depth.penet.network import coordinates, twice
from jaxsim.prepare.depth.penet.published import (
    CONVERTERS,
    abstract,
    create,
    definition,
    from_published,
    published_shapes,
    to_published,
)
from tests.prepare.depth.penet.made_published import inputs

UNREAD = ("encoder3", "encoder5", "encoder7")


@pytest.fixture(scope="module")
def theirs(vectors):
    """Names and shapes of the published state dict."""
    return {
        str(name): tuple(int(n) for n in str(shape).split("x") if n)
        for name, shape in zip(vectors["check_name"], vectors["check_shape"], strict=True)
    }


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
