"""Published PENet checkpoints: names, shapes and layouts, to and from ours."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any

import jax
import numpy as np
from flax import nnx

from jaxsim.prepare.depth.penet.network import PUBLISHED_WIDTH, Convention, PENet
from jaxsim.weights import Arrays, Converter, Values, checked_arrays, kernel_of, published_shape

STEM = "backbone.rgb_conv_init.0.weight"
_PLACES = {"conv": "0", "deconv": "0", "norm": "1", "kernel": "weight"}


@cache
def definition(width: int, convention: Convention) -> Any:
    """The network without values."""
    return nnx.graphdef(nnx.eval_shape(lambda: PENet(width, convention, nnx.Rngs(0))))


@cache
def abstract(width: int) -> Values:
    """Shapes of a network's values."""
    return nnx.to_pure_dict(nnx.state(nnx.eval_shape(lambda: PENet(width, "exact", nnx.Rngs(0)))))


def create(width: int, seed: int) -> Values:
    """Values to begin a training with, as published (He et al. 2015); the same for the same seed."""
    rng = np.random.default_rng(seed)

    def drawn(path: Any, leaf: Any) -> np.ndarray:
        if path[-1].key != "kernel":
            return np.full(leaf.shape, float(path[-1].key in ("weight", "running_var")), np.float32)
        rows, columns, inputs, outputs = leaf.shape
        # As the published program counts: a convolution's outputs, and a transposed one's inputs.
        fan = rows * columns * (inputs if _transposed(path) else outputs)
        return (rng.standard_normal(leaf.shape) * np.sqrt(2 / fan)).astype(np.float32)

    return jax.tree.map_with_path(drawn, abstract(width))


def _name(path: Any) -> str:
    return ".".join(_PLACES.get(str(step.key), str(step.key)) for step in path)


def _transposed(path: Any) -> bool:
    return any(step.key == "deconv" for step in path)


def published_shapes(width: int = PUBLISHED_WIDTH) -> dict[str, tuple[int, ...]]:
    """Names and shapes of the arrays that are read. The constant `encoder3`, `encoder5`, `encoder7` are not."""
    leaves = jax.tree.leaves_with_path(abstract(width))
    return {_name(path): published_shape(leaf.shape, transposed=_transposed(path)) for path, leaf in leaves}


def from_published(arrays: Mapping[str, np.ndarray]) -> tuple[int, Values]:
    """Width and values of a network. Raises ValueError where names or shapes are not PENet's."""
    stem = arrays.get(STEM)
    if stem is None or stem.ndim != 4:
        raise ValueError(f"it is no PENet: {STEM} is missing.")
    width = stem.shape[0]
    fitting = checked_arrays(dict(arrays), published_shapes(width))

    def ours(path: Any, leaf: Any) -> np.ndarray:
        array = fitting[_name(path)]
        return kernel_of(array, transposed=_transposed(path)) if array.ndim == 4 else array

    return width, jax.tree.map_with_path(ours, abstract(width))


def to_published(values: Values) -> Arrays:
    """A network's values under the published names and layouts."""

    def theirs(path: Any, leaf: Any) -> np.ndarray:
        array = np.asarray(leaf)
        if array.ndim != 4:
            return array
        return array[::-1, ::-1].transpose(2, 3, 0, 1) if _transposed(path) else array.transpose(3, 2, 0, 1)

    return {_name(path): theirs(path, leaf) for path, leaf in jax.tree.leaves_with_path(values)}


def _published(arrays: Arrays) -> Arrays:
    # A checkpoint holds the network under `model`; data parallelism wraps it once more.
    bare = {name.removeprefix("model.").removeprefix("module."): array for name, array in arrays.items()}
    backbone = STEM in bare or STEM.removeprefix("backbone.") in bare  # ENet alone lacks the prefix
    if backbone and not any(name.startswith("iter_guide_layer3_s2.") for name in bare):
        raise ValueError("it has no half-size guides: it is ENet or PENet_C1; take PENet_C2 (pe.pth.tar).")
    return checked_arrays(bare, published_shapes())


CONVERTERS = {
    "penet": Converter(
        "PENet (C2, dilation 2)",
        "pe.pth.tar, linked in the README of github.com/JUGGHM/PENet_ICRA2021. It also holds objects of its training "
        "(argparse.Namespace, metrics.Result), which weights_only=True refuses: once, in a clone of that repository "
        "(for its metrics.py), and only if you trust the file, since loading it so can run any code in it, save the "
        "state dict alone: python -c \"import torch; torch.save(torch.load('pe.pth.tar', map_location='cpu', "
        "weights_only=False)['model'], 'penet.pt')\"; penet.pt is then the FILE to convert",
        _published,
    )
}
"""What `jaxsim convert` makes of the published checkpoint."""
TRAINED = Converter(
    "a PENet that jaxsim trained",
    "nothing: train one, `jaxsim train penet_synthetic`",
    lambda arrays: checked_arrays(arrays, published_shapes(from_published(arrays)[0])),
)
TRAINED_KIND = "penet_trained"
