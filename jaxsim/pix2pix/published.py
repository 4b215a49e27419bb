"""Our weights from those under the names and layouts of published checkpoints.

Kernels are (out, in, kh, kw) there, those of transposed convolutions (in, out, kh, kw) and turned by half a circle;
the right singular vectors run over (in, kh, kw).
"""

from __future__ import annotations

import re
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import PyTree

from jaxsim.config import Pix2PixForm
from jaxsim.files import placed
from jaxsim.pix2pix.steps import Network
from jaxsim.weights import Arrays, checked_arrays, kernel_of, published_shape

Keys = tuple[Any, ...]

UNUSED = re.compile(r"\.(running_mean|running_var|num_batches_tracked)$")
"""Statistics that old versions of PyTorch saved for instance norms, which take each image's own."""
LEAF_NAMES: dict[str, dict[tuple[str, str], str]] = {
    "imaginaire": {
        ("conv", "kernel"): "layers.conv.weight",
        ("conv", "bias"): "layers.conv.bias",
        ("conv", "left"): "layers.conv.weight_u",
        ("conv", "right"): "layers.conv.weight_v",
        ("norm", "scale"): "layers.norm.weight",
        ("norm", "shift"): "layers.norm.bias",
    },
    "original": {("conv", "kernel"): "weight", ("conv", "bias"): "bias"},
}
"""What the published programs call our arrays of a layer."""


class Place(NamedTuple):
    """Where a published program keeps one of our arrays."""

    name: str
    kernel_shape: tuple[int, ...]
    """Ours, of the kernel that the array belongs to; () for a norm's arrays."""
    transposed: bool
    """The kernel is a transposed convolution's."""


def from_published(arrays: Arrays, like: Network, form: Pix2PixForm = "imaginaire") -> Network:
    """Our values from published ones; `like` gives the structure and may be abstract (`jax.eval_shape`).

    Raises ValueError naming the arrays that are missing, have another shape, or have no place in the network; but
    running statistics that instance norms do not use are left alone.
    """
    places = places_of(like, form)
    leaves = jax.tree.leaves_with_path((like.parameters, like.vectors))
    # The first step of a path says which of the two trees.
    slots = [(places[keys_of(path[1:])], leaf.shape) for path, leaf in leaves]
    shapes = {slot.name: published_shape(shape, transposed=slot.transposed) for slot, shape in slots}
    then = "set generator.* or discriminator.* to the checkpoint's form and sizes"
    with placed(f"published weights do not fit the configured network ({form} form)", then=then):
        values = checked_arrays(arrays, shapes)
        if strange := [name for name in arrays if name not in shapes and not UNUSED.search(name)]:
            raise ValueError(f"{', '.join(strange[:5])} has no place there")
    structure = jax.tree.structure((like.parameters, like.vectors))
    return Network(*jax.tree.unflatten(structure, [_ours(values[slot.name], slot) for slot, _ in slots]))


def _ours(array: np.ndarray, slot: Place) -> np.ndarray:
    if array.ndim == 4:
        return kernel_of(array, transposed=slot.transposed)
    if slot.name.endswith("weight_v"):
        kh, kw, channels = slot.kernel_shape[:3]
        return array.reshape(channels, kh, kw).transpose(1, 2, 0).reshape(-1)
    return array


def keys_of(path: Any) -> Keys:
    """The names along a path that `jax.tree` gives."""
    return tuple(step.key for step in path)


def places_of(network: Network, form: Pix2PixForm) -> dict[Keys, Place]:
    """The published place of every leaf by its path."""
    spectral = {keys_of(path)[:-1] for path, _ in jax.tree.leaves_with_path(network.vectors)}
    kernels = {
        keys_of(path)[:-1]: leaf.shape
        for path, leaf in jax.tree.leaves_with_path(network.parameters)
        if keys_of(path)[-1] == "kernel"
    }
    places = {}
    for path, _ in jax.tree.leaves_with_path((network.parameters, network.vectors)):
        # The first step says which of the two trees.
        keys = keys_of(path[1:])
        name = f"{_layer_name(keys[:-2], network.parameters, form)}.{LEAF_NAMES[form][keys[-2:]]}"
        if keys[-1] == "kernel" and keys[:-1] in spectral:
            # PyTorch keeps the trained kernel so; its `weight` is what the norm makes of it.
            name += "_orig"
        places[keys] = Place(name, kernels.get(keys[:-1], ()), form == "original" and "up" in keys)
    return places


def _layer_name(keys: Keys, parameters: PyTree, form: Pix2PixForm) -> str:
    """The published name of the layer that has this path in our network."""
    original = form == "original"
    if keys[0] == "scales":
        _, scale, *layer = keys
        number = layer[1] if layer[0] == "features" else len(parameters["scales"][scale]["features"])
        if original:  # there the coarsest scale is the first by name
            return f"scale{len(parameters['scales']) - 1 - scale}_layer{number}.0"
        return f"model.discriminators.{scale}.layer{number}.0"
    # Places in a `Sequential`. The original counts paddings, norms and activations too, three places a convolution;
    # Imaginaire counts blocks, and an up-sampling layer without weights before each of `up`.
    stem, apart, up_apart = (1, 3, 3) if original else (0, 1, 2)
    if keys[0] == "coarse":
        part, keys = parameters["coarse"], keys[1:]
        # Imaginaire's global generator on its own keeps its head and stands one level deeper.
        before = "model" if original else "global_model.model" if "head" in part else "global_model"
        after, first_block = before, stem + apart * (1 + len(part["down"]))
    else:
        _, k, *layer = keys
        part, keys = parameters["enhancers"][k], tuple(layer)
        first_block = 0
        before, after = (
            (f"model{k + 1}_1", f"model{k + 1}_2")
            if original
            else (f"enhancer_{k}.model_downsample", f"enhancer_{k}.model_upsample")
        )
    first_up = first_block + len(part["blocks"])
    match keys:
        case ("stem",):
            return f"{before}.{stem}"
        case ("down", i):
            return f"{before}.{stem + apart * (1 + i)}"
        case ("blocks", i, half):
            second = half == "second"
            inner = f"conv_block.{5 if second else 1}" if original else f"conv_block_{int(second)}"
            return f"{after}.{first_block + i}.{inner}"
        case ("up", i):
            return f"{after}.{first_up + up_apart * i + 1 - stem}"
        case ("head",):
            return f"{after}.{first_up + up_apart * len(part['up']) + stem}"
    raise ValueError(f"no published name for {keys}")
