"""State dicts of OpenPCDet's exact names and shapes, in the three layouts of spconv's kernels."""

import re

import jax
import numpy as np
import pytest

from jaxsim.cli.convert import CONVERTERS
from jaxsim.config import DetectorExperiment
from jaxsim.detect.published import (
    CONVERTER,
    KIND,
    SPARSE_LAYOUTS,
    from_published,
    load_published,
    published_shapes,
    sparse_layout,
)
from jaxsim.detect.steps import network_shapes
from jaxsim.weights import convert
from tests.detect.tiny import EXPERIMENT


def drawn(experiment, layout):
    rng = np.random.default_rng(0)
    return {name: rng.random(s, np.float32) for name, s in published_shapes(experiment, layout).items()}


def relaid(arrays, layout):
    """The same weights of spconv 2 as another version keeps them."""
    ours, theirs = (SPARSE_LAYOUTS[name] for name in ("spconv 2", layout))
    back = [theirs.index(k) for k in range(5)]
    return {n: a.transpose(ours).transpose(back) if a.ndim == 5 else a for n, a in arrays.items()}


def test_names_and_shapes_are_those_of_the_published_state_dict(values):
    shapes = published_shapes(DetectorExperiment(), "spconv 2")
    backbone = {f"backbone_3d.{n}": tuple(about["shape"]) for n, about in values["backbone"]["weights"].items()}
    assert {n: s for n, s in shapes.items() if n.startswith("backbone_3d.")} == backbone
    assert shapes["backbone_2d.blocks.0.1.weight"] == (64, 256, 3, 3)
    assert shapes["backbone_2d.blocks.1.16.weight"] == (128, 128, 3, 3)
    assert shapes["backbone_2d.blocks.1.17.running_var"] == (128,)
    assert shapes["backbone_2d.deblocks.0.0.weight"] == (64, 128, 1, 1)
    assert shapes["backbone_2d.deblocks.1.0.weight"] == (128, 128, 2, 2)
    assert shapes["dense_head.conv_box.weight"] == (14, 256, 1, 1)
    assert shapes["dense_head.conv_dir_cls.bias"] == (4,)
    assert shapes["roi_head.roi_grid_pool_layers.0.mlps_in.0.0.weight"] == (32, 32, 1)
    assert shapes["roi_head.roi_grid_pool_layers.2.mlps_pos.0.0.weight"] == (32, 3, 1, 1)
    assert shapes["roi_head.shared_fc_layer.0.weight"] == (256, 20736)
    assert shapes["roi_head.cls_fc_layers.5.running_mean"] == (256,)
    assert shapes["roi_head.reg_pred_layer.weight"] == (7, 256)
    learned = sum(int(np.prod(s)) for n, s in shapes.items() if "running" not in n)
    assert learned == 7_586_620
    assert published_shapes(DetectorExperiment(), "spconv 1")["backbone_3d.conv_out.0.weight"] == (3, 1, 1, 64, 128)


@pytest.mark.parametrize("layout", SPARSE_LAYOUTS)
def test_every_layout_gives_the_same_network(layout):
    arrays = drawn(EXPERIMENT, "spconv 2")
    theirs = relaid(arrays, layout)
    assert sparse_layout(theirs) == layout
    assert {n: a.shape for n, a in theirs.items()} == published_shapes(EXPERIMENT, layout)
    network, wanted = from_published(theirs, EXPERIMENT), from_published(arrays, EXPERIMENT)
    jax.tree.map(np.testing.assert_array_equal, network, wanted)
    like = network_shapes(EXPERIMENT)
    assert jax.tree.map(lambda a: a.shape, network) == jax.tree.map(lambda a: a.shape, like)


def test_kernels_land_where_the_published_program_has_them():
    arrays = drawn(EXPERIMENT, "spconv 2")
    network = from_published(arrays, EXPERIMENT).parameters
    kernel = arrays["backbone_3d.conv2.1.0.weight"]
    assert network["backbone3d"]["conv2"]["first"]["kernel"][0, 1, 2, 3, 4] == kernel[4, 0, 1, 2, 3]
    kernel = arrays["backbone_2d.blocks.1.1.weight"]
    assert network["backbone2d"]["blocks"][1][0]["kernel"][0, 2, 5, 7] == kernel[7, 5, 0, 2]
    kernel = arrays["backbone_2d.deblocks.1.0.weight"]
    assert network["backbone2d"]["ups"][1]["kernel"][0, 1, 5, 7] == kernel[5, 7, 0, 1]
    kernel = arrays["roi_head.reg_fc_layers.4.weight"]
    assert network["roi"]["of_box"]["layers"][1]["kernel"][3, 9] == kernel[9, 3]


def test_a_checkpoint_is_converted_and_loaded(tmp_path):
    arrays = drawn(DetectorExperiment(), "spconv 1")
    counters = {re.sub("running_mean", "num_batches_tracked", n): np.int64(3) for n in arrays if "running_mean" in n}
    checkpoint = {f"model_state.{n}": a for n, a in {**arrays, **counters}.items()} | {"epoch": np.int64(80)}
    np.savez(tmp_path / "checkpoint.npz", **checkpoint)
    assert CONVERTERS[KIND] is CONVERTER
    convert(KIND, CONVERTER, tmp_path / "checkpoint.npz", out=tmp_path / "car.npz")
    network = load_published(tmp_path / "car.npz")
    kernel = arrays["backbone_3d.conv4.0.0.weight"]
    np.testing.assert_array_equal(network.parameters["backbone3d"]["conv4"]["down"]["kernel"], kernel)


def test_another_networks_weights_are_refused(tmp_path):
    np.savez(tmp_path / "other.npz", a=np.zeros(3))
    with pytest.raises(ValueError, match=r"not OpenPCDet's Voxel R-CNN .* no backbone_3d"):
        convert(KIND, CONVERTER, tmp_path / "other.npz", out=tmp_path / "car.npz")
    arrays = drawn(DetectorExperiment(), "spconv 2")
    arrays["dense_head.conv_cls.weight"] = np.zeros((18, 256, 1, 1), np.float32)  # three classes
    np.savez(tmp_path / "three.npz", **arrays)
    with pytest.raises(ValueError, match=r"conv_cls.weight is \(18, 256, 1, 1\), not \(2, 256, 1, 1\)"):
        convert(KIND, CONVERTER, tmp_path / "three.npz", out=tmp_path / "car.npz")
    with pytest.raises(FileNotFoundError, match="jaxsim convert voxel_rcnn_car"):
        load_published(tmp_path / "none.npz")
