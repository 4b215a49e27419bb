import dataclasses

import jax
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from jaxsim.frame import Painted
from jaxsim.prepare import INPUT_CHANNELS, edge_map, input_channels, network_inputs
from jaxsim.prepare.channels import ROW_OCTAVES
from tests.prepare.made_config import SHAPE, config

ALL = ("rgb", "depth", "semantic", "edges", "incidence", "range", "row")


def scene(rng=None):
    rng = rng or np.random.default_rng(0)
    painted = Painted(
        range_m=rng.uniform(0, 150, SHAPE).astype(np.float32),
        depth_m=rng.uniform(0, 150, SHAPE).astype(np.float32),
        rgb=rng.uniform(0, 1, (*SHAPE, 3)).astype(np.float32),
        semantic=rng.integers(0, 34, SHAPE).astype(np.int32),
        instance=rng.integers(0, 3, SHAPE).astype(np.int32),
        valid=rng.random(SHAPE) < 0.8,
        occluded=rng.random(SHAPE) < 0.2,
    )
    angle = rng.uniform(0, np.pi / 2, SHAPE).astype(np.float32)
    row = np.broadcast_to(np.linspace(0, 0.7, 4, dtype=np.float32)[:, None], SHAPE)
    return painted, angle, row


def test_every_channel_equals_its_definition():
    painted, angle, row = scene()
    found = np.asarray(network_inputs(painted, angle, row, prepare=config(*ALL)))
    assert found.shape == (*SHAPE, input_channels(config(*ALL)))
    v = painted.valid
    expected = [
        np.where(v[..., None], 2 * painted.rgb - 1, -1),
        np.where(v, 2 * np.clip(painted.depth_m / 120, 0, 1) - 1, -1)[..., None],
        ((painted.semantic[..., None] == np.arange(34)) & (v & ~painted.occluded)[..., None]),
        np.asarray(edge_map(painted.semantic, painted.instance))[..., None],
        (angle / (np.pi / 4) - 1)[..., None],
        np.where(v, 2 * np.clip(painted.range_m / 120, 0, 1) - 1, -1)[..., None],
        (2 * row - 1)[..., None],
        *([f(2 * np.pi * row * 2**k)[..., None] for f in (np.sin, np.cos) for k in range(ROW_OCTAVES)]),
    ]
    np.testing.assert_allclose(found, np.concatenate(expected, axis=-1), atol=2e-5)


def test_channels_come_in_the_order_of_the_config():
    painted, angle, row = scene()
    one = [network_inputs(painted, angle, row, prepare=config(name)) for name in ("row", "rgb")]
    both = network_inputs(painted, angle, row, prepare=config("row", "rgb"))
    np.testing.assert_array_equal(both, np.concatenate(one, axis=-1))


def test_the_window_is_scaled_by_cell_centres_and_edges_are_found_afterwards():
    painted, angle, row = scene()
    found = np.asarray(network_inputs(painted, angle, row, prepare=config("depth", "edges", size=(8, 12))))
    depth = np.where(painted.valid, 2 * np.clip(painted.depth_m / 120, 0, 1) - 1, -1)
    np.testing.assert_allclose(found[..., 0], depth.repeat(2, axis=1).repeat(2, axis=2), atol=1e-6)
    semantic, instance = (a.repeat(2, axis=1).repeat(2, axis=2) for a in (painted.semantic, painted.instance))
    np.testing.assert_array_equal(found[..., 1], edge_map(semantic, instance))


def test_occluded_cells_lose_their_class_and_keep_the_rest():
    painted, angle, row = scene()
    hidden = painted.replace(valid=np.ones(SHAPE, bool), occluded=np.ones(SHAPE, bool))
    found = np.asarray(network_inputs(hidden, angle, row, prepare=config("semantic", "rgb", "range")))
    assert not found[..., :34].any()
    np.testing.assert_allclose(found[..., 34:37], 2 * painted.rgb - 1, atol=1e-6)
    assert (found[..., 37] > -1).mean() > 0.9


def test_only_the_classes_asked_for_have_a_channel():
    painted, angle, row = scene()
    chosen = dataclasses.replace(config("semantic"), classes=(26, 7))
    everything = np.asarray(network_inputs(painted, angle, row, prepare=config("semantic")))
    assert input_channels(chosen) == 2
    np.testing.assert_array_equal(network_inputs(painted, angle, row, prepare=chosen), everything[..., [26, 7]])


def test_values_that_mean_nothing_are_not_passed_on():
    painted, angle, row = scene()
    garbage = jax.tree.map(
        lambda a: (
            np.where(painted.valid.reshape(*SHAPE, *[1] * (a.ndim - 3)), a, a.dtype.type(7)) if a.dtype != bool else a
        ),
        painted,
    )
    inputs = ("rgb", "depth", "semantic", "range")
    np.testing.assert_array_equal(
        network_inputs(painted, angle, row, prepare=config(*inputs)),
        network_inputs(garbage, angle, row, prepare=config(*inputs)),
    )


def test_neighbouring_lines_of_a_sensor_have_clearly_different_codes():
    painted, _, _ = scene()
    line = np.arange(64, dtype=np.float32)[:, None] / 63 * np.ones((64, 6), np.float32)
    one = jax.tree.map(lambda a: np.zeros((64, 6, *a.shape[3:]), a.dtype), painted)
    code = np.asarray(network_inputs(one, 0 * line, line, prepare=config("row", size=(64, 6))))
    assert np.abs(np.diff(code, axis=0)).max(axis=-1).min() > 1
    assert np.abs(code).max() <= 1


def test_one_hot_equals_the_published_program(golden):
    published = np.load(golden / "pix2pixhd_imaginaire/input_label_edges.npz")
    ids = published["seg_ids"][:2].astype(np.int32)  # 7 classes; 255 is outside
    painted, *_ = scene()
    shape = ids.shape
    empty = np.zeros(shape, np.float32)
    painted = Painted(
        range_m=empty,
        depth_m=empty,
        rgb=np.zeros((*shape, 3), np.float32),
        semantic=ids,
        instance=published["instance_ids"][:2],
        valid=np.ones(shape, bool),
        occluded=np.zeros(shape, bool),
    )
    found = network_inputs(painted, empty, empty, prepare=config("semantic", size=shape[1:]))
    np.testing.assert_array_equal(np.moveaxis(np.asarray(found)[..., :7], -1, 1), published["label"][:, :7])
    assert not np.asarray(found)[..., 7:].any()


def test_channel_counts_and_unknown_names():
    assert {name: input_channels(config(name)) for name in INPUT_CHANNELS} == {**INPUT_CHANNELS, "semantic": 34}
    assert input_channels(config("rgb", "depth", "semantic", "edges")) == 39  # the paper's
    with pytest.raises(ValueError, match="must be one of rgb, depth, semantic"):
        config("rgb", "speed")
    with pytest.raises(ValueError, match="name at least one, each once"):
        input_channels(config())
    with pytest.raises(ValueError, match="rgb rgb; name at least one, each once"):
        input_channels(config("rgb", "rgb"))


def borders_of(ids):
    h, w = ids.shape
    marked = np.zeros((h, w), bool)
    for r in range(h):
        for c in range(w):
            for dr, dc in ((0, 1), (1, 0), (0, -1), (-1, 0)):
                if 0 <= r + dr < h and 0 <= c + dc < w and ids[r, c] != ids[r + dr, c + dc]:
                    marked[r, c] = True
    return marked


LABELS = hnp.arrays(np.int32, (7, 9), elements=st.integers(0, 3))


@given(LABELS, LABELS)
@settings(max_examples=50, deadline=None)
def test_edges_are_the_differences_of_semantic_times_1000_plus_instance(semantic, instance):
    np.testing.assert_array_equal(edge_map(semantic, instance), borders_of(semantic * 1000 + instance))


def test_both_sides_of_a_border_are_marked_and_the_rasters_own_border_is_none():
    semantic = np.zeros((4, 6), np.int32)
    semantic[:, 3:] = 7
    expected = np.zeros((4, 6), bool)
    expected[:, 2:4] = True
    np.testing.assert_array_equal(edge_map(semantic, np.zeros_like(semantic)), expected)


def test_a_thousandth_instance_is_not_the_next_class():
    semantic = np.array([[7, 8]], np.int32)
    assert edge_map(semantic, np.array([[1000, 0]], np.int32)).all()


def test_edges_of_a_batch_are_those_of_its_images():
    ids = np.random.default_rng(0).integers(0, 3, (2, 3, 5, 8)).astype(np.int32)
    both = edge_map(ids, ids)
    for i in range(2):
        for j in range(3):
            np.testing.assert_array_equal(both[i, j], borders_of(ids[i, j]))


def test_edges_equal_those_of_both_published_programs(golden):
    imaginaire = np.load(golden / "pix2pixhd_imaginaire/input_label_edges.npz")
    ids = imaginaire["instance_ids"][:2]
    np.testing.assert_array_equal(edge_map(np.zeros_like(ids), ids), imaginaire["label"][:, -1])
    original = np.load(golden / "pix2pixhd_original/input_and_edges.npz")
    ids = original["inst"][:, 0]
    np.testing.assert_array_equal(edge_map(np.zeros_like(ids), ids), original["edge"][:, 0])


def test_one_column_of_rows_stands_for_all():
    painted, angle, row = scene()
    for size in (SHAPE[1:], (8, 12)):
        prepare = config("row", "beam", "depth", size=size)
        whole = np.asarray(network_inputs(painted, angle, row, prepare=prepare))
        np.testing.assert_array_equal(network_inputs(painted, angle, row[..., :1], prepare=prepare), whole)
