"""Weights under the names and layouts that Imaginaire's checkpoints use, to and from ours.

Kernels are (out, in, kh, kw) there, and the right singular vectors run over (in, kh, kw).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import jax
import numpy as np

from jaxsim.pix2pix.state import Network

Tree = Any
Arrays = Mapping[str, np.ndarray]

LEAVES = {
    ("conv", "kernel"): "layers.conv.weight",
    ("conv", "bias"): "layers.conv.bias",
    ("conv", "left"): "layers.conv.weight_u",
    ("conv", "right"): "layers.conv.weight_v",
    ("norm", "scale"): "layers.norm.weight",
    ("norm", "shift"): "layers.norm.bias",
}


def to_published(network: Network) -> dict[str, np.ndarray]:
    """Published name -> array, of a generator's or a discriminator's values.

    A network without singular vectors (the averaged generator) gives plain `weight` names.
    """
    arrays = {}
    places = _places(network)
    for tree in (network.parameters, network.vectors):
        for path, value in jax.tree.leaves_with_path(tree):
            name, kernel_shape = places[_keys(path)]
            array = np.asarray(value)
            if array.ndim == 4:
                array = array.transpose(3, 2, 0, 1)
            elif name.endswith("weight_v"):
                array = array.reshape(kernel_shape[:3]).transpose(2, 0, 1).reshape(-1)
            arrays[name] = array
    return arrays


def from_published(arrays: Arrays, like: Network) -> Network:
    """Our values from published ones; `like` gives the structure and may be abstract (`jax.eval_shape`).

    Raises ValueError naming every array that is missing or has another shape. Arrays that the network has
    no place for are left alone.
    """
    places = _places(like)
    faults = []

    def adopt(path: Any, value: Any) -> np.ndarray:
        name, kernel_shape = places[_keys(path)]
        shape = _published_shape(value.shape)
        if name not in arrays or arrays[name].shape != shape:
            found = arrays[name].shape if name in arrays else "missing"
            faults.append(f"{name} is {found}, not {shape}")
            return np.zeros(value.shape, np.float32)
        array = np.asarray(arrays[name], np.float32)
        if array.ndim == 4:
            return array.transpose(2, 3, 1, 0)
        if name.endswith("weight_v"):
            kh, kw, channels = kernel_shape[:3]
            return array.reshape(channels, kh, kw).transpose(1, 2, 0).reshape(-1)
        return array

    network = Network(jax.tree.map_with_path(adopt, like.parameters), jax.tree.map_with_path(adopt, like.vectors))
    if faults:
        raise ValueError(
            "published weights do not fit the configured network: "
            + "; ".join(faults)
            + ". Set generator.* or discriminator.* to the checkpoint's sizes"
        )
    return network


def _published_shape(shape: tuple[int, ...]) -> tuple[int, ...]:
    return (shape[3], shape[2], shape[0], shape[1]) if len(shape) == 4 else shape


def _keys(path: Any) -> tuple[Any, ...]:
    return tuple(step.key for step in path)


def _places(network: Network) -> dict[tuple[Any, ...], tuple[str, tuple[int, ...]]]:
    """Published name of every leaf by its path, and the shape of the kernel beside it."""
    spectral = {_keys(path)[:-1] for path, _ in jax.tree.leaves_with_path(network.vectors)}
    kernels = {
        _keys(path)[:-1]: leaf.shape
        for path, leaf in jax.tree.leaves_with_path(network.parameters)
        if _keys(path)[-1] == "kernel"
    }
    places = {}
    for path, _ in jax.tree.leaves_with_path((network.parameters, network.vectors)):
        keys = _keys(path[1:])
        name = f"{_block(keys[:-2], network.parameters)}.{LEAVES[keys[-2:]]}"
        if keys[-1] == "kernel" and keys[:-1] in spectral:
            name += "_orig"
        places[keys] = (name, kernels.get(keys[:-1], ()))
    return places


def _block(keys: tuple[Any, ...], parameters: Tree) -> str:
    """Published name of the block at a path; blocks are numbered as they follow in a `Sequential`."""
    if keys[0] == "scales":
        scale = parameters["scales"][keys[1]]
        layer = keys[3] if keys[2] == "features" else len(scale["features"])
        return f"model.discriminators.{keys[1]}.layer{layer}.0"
    if keys[0] == "coarse":
        part, keys = parameters["coarse"], keys[1:]
        # A global generator on its own keeps its head and stands one level deeper.
        before, after = ("global_model.model",) * 2 if "head" in part else ("global_model",) * 2
        offset = 1 + len(part["down"])
    else:
        part, before = parameters["enhancers"][keys[1]], f"enhancer_{keys[1]}.model_downsample"
        after, offset = f"enhancer_{keys[1]}.model_upsample", 0
        keys = keys[2:]
    blocks, ups = len(part["blocks"]), len(part["up"])
    match keys:
        case ("stem",):
            return f"{before}.0"
        case ("down", i):
            return f"{before}.{1 + i}"
        case ("blocks", i, half):
            return f"{after}.{offset + i}.conv_block_{int(half == 'second')}"
        case ("up", i):  # each is preceded by an up-sampling layer without weights
            return f"{after}.{offset + blocks + 2 * i + 1}"
        case ("head",):
            return f"{after}.{offset + blocks + 2 * ups}"
    raise ValueError(f"no published name for {keys}")
