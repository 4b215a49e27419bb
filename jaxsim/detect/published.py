"""OpenPCDet's Voxel R-CNN checkpoints: names and layouts of a state dict, and the network's values from it.

Kernels of sparse convolutions come in three layouts: (z, y, x, in, out) of spconv 1, (out, z, y, x, in) of spconv 2,
and (z, y, x, out, in) of spconv 2's *native* algorithm. The first layer, whose 4 inputs no other axis has, tells which.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxsim.config import DetectorConfig, DetectorExperiment
from jaxsim.detect.network import FEATURES
from jaxsim.detect.steps import Network, network_shapes
from jaxsim.weights import Arrays, Converter, checked_arrays, load_weights

SPARSE_LAYOUTS: dict[str, tuple[int, ...]] = {
    "spconv 2": (1, 2, 3, 4, 0),
    "spconv 1": (0, 1, 2, 3, 4),
    "spconv 2, native": (0, 1, 2, 4, 3),
}
"""Where our axes (z, y, x, in, out) stand in each layout."""
DENSE_LAYOUTS = {"conv": (2, 3, 1, 0), "up": (2, 3, 0, 1)}
"""Where our axes (row, column, in, out) stand in PyTorch's kernels of convolutions and transposed convolutions."""
FIRST_KERNEL = "backbone_3d.conv_input.0.weight"
BATCH_NORM = {"weight": "scale", "bias": "shift", "running_mean": "mean", "running_var": "variance"}


class Tensor(NamedTuple):
    """One array of a state dict and where it goes."""

    name: str
    path: tuple[str | int, ...]
    layout: str
    """`sparse`, `conv`, `up`, `linear` or `vector`."""


def _norm(name: str, *path: str | int) -> Iterator[Tensor]:
    for theirs, ours in BATCH_NORM.items():
        yield Tensor(f"{name}.{theirs}", (*path, ours), "vector")


def tensors(config: DetectorConfig) -> Iterator[Tensor]:
    """Every array of the state dict but the batch norms' counters."""
    sparse = {"conv_input": ("conv_input",), "conv1.0": ("conv1",), "conv_out": ("out",)}
    for stage in ("conv2", "conv3", "conv4"):
        sparse |= {f"{stage}.{k}": (stage, part) for k, part in enumerate(("down", "first", "second"))}
    for name, path in sparse.items():
        yield Tensor(f"backbone_3d.{name}.0.weight", ("backbone3d", *path, "kernel"), "sparse")
        yield from _norm(f"backbone_3d.{name}.1", "backbone3d", *path, "norm")

    for i, layers in enumerate(config.backbone.bev_layers):
        for k in range(layers + 1):  # padding, then convolution, norm and ReLU again and again
            path = ("backbone2d", "blocks", i, k)
            yield Tensor(f"backbone_2d.blocks.{i}.{3 * k + 1}.weight", (*path, "kernel"), "conv")
            yield from _norm(f"backbone_2d.blocks.{i}.{3 * k + 2}", *path, "norm")
        yield Tensor(f"backbone_2d.deblocks.{i}.0.weight", ("backbone2d", "ups", i, "kernel"), "up")
        yield from _norm(f"backbone_2d.deblocks.{i}.1", "backbone2d", "ups", i, "norm")

    for theirs, ours in (("conv_cls", "cls"), ("conv_box", "box"), ("conv_dir_cls", "direction")):
        yield Tensor(f"dense_head.{theirs}.weight", ("head", ours, "kernel"), "linear")
        yield Tensor(f"dense_head.{theirs}.bias", ("head", ours, "bias"), "vector")

    pools = {"mlps_in": ("of_features", "features_norm"), "mlps_pos": ("of_offset", "offset_norm")}
    pools |= {"mlps_out": ("out", "out_norm")}
    for i in range(len(config.roi.radii_m)):
        for theirs, (layer, norm) in pools.items():
            name = f"roi_head.roi_grid_pool_layers.{i}.{theirs}.0"
            yield Tensor(f"{name}.0.weight", ("roi", "pools", i, layer, "kernel"), "linear")
            yield from _norm(f"{name}.1", "roi", "pools", i, norm)
    for theirs, ours in (("shared_fc_layer", "shared"), ("cls_fc_layers", "of_cls"), ("reg_fc_layers", "of_box")):
        for k in range(len(config.roi.layers)):  # linear map, norm, ReLU, dropout
            yield Tensor(f"roi_head.{theirs}.{4 * k}.weight", ("roi", ours, "layers", k, "kernel"), "linear")
            yield from _norm(f"roi_head.{theirs}.{4 * k + 1}", "roi", ours, "norms", k)
    for theirs, ours in (("cls_pred_layer", "cls"), ("reg_pred_layer", "box")):
        yield Tensor(f"roi_head.{theirs}.weight", ("roi", ours, "kernel"), "linear")
        yield Tensor(f"roi_head.{theirs}.bias", ("roi", ours, "bias"), "vector")


def _holder(network: Network, tensor: Tensor) -> Any:
    """The dict or list of our network that holds a tensor's values, under the last step of its path."""
    tree = network.statistics if tensor.path[-1] in ("mean", "variance") else network.parameters
    for step in tensor.path[:-1]:
        tree = tree[step]
    return tree


def _published_shape(tensor: Tensor, shape: tuple[int, ...], sparse: tuple[int, ...]) -> tuple[int, ...]:
    if tensor.layout == "vector":
        return shape
    if tensor.layout == "linear":  # some are published as convolutions with kernels of one cell, in one or two axes
        ones = 2 if "dense_head" in tensor.name or "mlps_pos" in tensor.name else 1 if "mlps" in tensor.name else 0
        return (shape[1], shape[0], *(1,) * ones)
    axes = sparse if tensor.layout == "sparse" else DENSE_LAYOUTS[tensor.layout]
    return tuple(shape[axes.index(k)] for k in range(len(axes)))


def _ours(tensor: Tensor, array: np.ndarray, sparse: tuple[int, ...]) -> np.ndarray:
    if tensor.layout == "vector":
        return array
    if tensor.layout == "linear":
        return array.reshape(array.shape[:2]).T
    return array.transpose(sparse if tensor.layout == "sparse" else DENSE_LAYOUTS[tensor.layout])


def sparse_layout(arrays: Arrays) -> str:
    """Which layout the kernels of sparse convolutions have. Raises ValueError where the first layer fits none."""
    kernel = next((a for name, a in arrays.items() if name.endswith(FIRST_KERNEL)), None)
    if kernel is None:
        raise ValueError(f"it has no {FIRST_KERNEL}.")
    for name, axes in SPARSE_LAYOUTS.items():
        if kernel.ndim == 5 and kernel.transpose(axes).shape[:4] == (3, 3, 3, FEATURES):
            return name
    raise ValueError(f"{FIRST_KERNEL} is {kernel.shape}; it takes 3 x 3 x 3 cells of {FEATURES} features.")


def published_shapes(experiment: DetectorExperiment, layout: str) -> dict[str, tuple[int, ...]]:
    """Names and shapes of the state dict of an experiment's network."""
    network, axes = network_shapes(experiment), SPARSE_LAYOUTS[layout]
    return {
        tensor.name: _published_shape(tensor, _holder(network, tensor)[tensor.path[-1]].shape, axes)
        for tensor in tensors(experiment.detector)
    }


def from_published(arrays: Arrays, experiment: DetectorExperiment) -> Network:
    """The network's values from a state dict. Raises ValueError where it is another network's."""
    layout = sparse_layout(arrays)
    arrays = checked_arrays(dict(arrays), published_shapes(experiment, layout))
    network = network_shapes(experiment)
    for tensor in tensors(experiment.detector):
        values = _ours(tensor, arrays[tensor.name], SPARSE_LAYOUTS[layout])
        _holder(network, tensor)[tensor.path[-1]] = values
    return network


def load_published(path: Path) -> Network:
    """OpenPCDet's network for cars from a file that `jaxsim convert` wrote; its settings are `DetectorExperiment()`.

    Raises FileNotFoundError or ValueError, which say how to get the right file.
    """
    return jax.tree.map(jnp.asarray, from_published(load_weights(path, KIND, CONVERTER).arrays, DetectorExperiment()))


KIND = "voxel_rcnn_car"
CONVERTER = Converter(
    title="OpenPCDet's Voxel R-CNN for cars on KITTI",
    fetch="voxel_rcnn_car_84.54.pth, linked in the model zoo of github.com/open-mmlab/OpenPCDet (README.md)",
    convert=lambda arrays: checked_arrays(arrays, published_shapes(DetectorExperiment(), sparse_layout(arrays))),
)
