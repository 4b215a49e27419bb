"""Names that the published programs give to layers, by the path that a layer has in our networks."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

Tree = Any
Keys = tuple[Any, ...]


def imaginaire_name(keys: Keys, parameters: Tree) -> str:
    """Imaginaire's block; blocks are numbered as they follow in a `Sequential`."""
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


def original_name(keys: Keys, parameters: Tree) -> str:
    """NVIDIA/pix2pixHD's convolution, as its `Sequential`s count paddings, norms and activations too."""
    if keys[0] == "scales":
        scale = parameters["scales"][keys[1]]
        layer = keys[3] if keys[2] == "features" else len(scale["features"])
        # There the coarsest scale is the first by name.
        return f"scale{len(parameters['scales']) - 1 - keys[1]}_layer{layer}.0"
    if keys[0] == "coarse":
        part, keys = parameters["coarse"], keys[1:]
        before = "model"
        after = "model"
        offset = 4 + 3 * len(part["down"])
    else:
        part = parameters["enhancers"][keys[1]]
        number = keys[1] + 1
        keys = keys[2:]
        before = f"model{number}_1"
        after = f"model{number}_2"
        offset = 0
    blocks, ups = len(part["blocks"]), len(part["up"])
    match keys:
        case ("stem",):
            return f"{before}.1"
        case ("down", i):
            return f"{before}.{4 + 3 * i}"
        case ("blocks", i, half):
            return f"{after}.{offset + i}.conv_block.{5 if half == 'second' else 1}"
        case ("up", i):
            return f"{after}.{offset + blocks + 3 * i}"
        case ("head",):
            return f"{after}.{offset + blocks + 3 * ups + 1}"
    raise ValueError(f"no published name for {keys}")


LAYER_NAMES: dict[str, Callable[[Keys, Tree], str]] = {"imaginaire": imaginaire_name, "original": original_name}

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
