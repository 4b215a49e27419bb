"""Both stages together: the published size, finite losses and gradients, batches, bad input."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from flax import nnx

from jaxsim.config import DetectorConfig, DetectorExperiment, VoxelConfig
from jaxsim.detect.backbones import VoxelBackBone8x
from jaxsim.detect.network import VoxelRcnn, bev_channels
from jaxsim.detect.steps import create_state, make_detect, make_train_step, network_shapes
from tests.detect.tiny import EXPERIMENT, scene_batch

pytestmark = pytest.mark.usefixtures("quick_programs")


def count(tree):
    return sum(int(np.prod(leaf.shape)) for leaf in jax.tree.leaves(tree))


def test_the_published_network_has_the_published_number_of_parameters():
    parameters = network_shapes(DetectorExperiment()).parameters
    assert count(parameters) == 7_586_620
    parts = {"backbone3d": 711_872, "backbone2d": 1_219_328, "head": 5_140}
    assert {name: count(parameters[name]) for name in parts} == parts
    roi = parameters["roi"]
    assert count(roi["pools"]) == 9_056
    assert count(roi["shared"]) == 5_374_976
    assert count(roi["of_cls"]) + count(roi["cls"]) == 132_353
    assert count(roi["of_box"]) + count(roi["box"]) == 133_895


@pytest.fixture(scope="module")
def state():
    return jax.tree.map(np.asarray, create_state(EXPERIMENT, 100, seed=0))


@pytest.fixture(scope="module")
def train_step():
    return make_train_step(EXPERIMENT, 100)


@pytest.fixture(scope="module")
def detect():
    return make_detect(replace(EXPERIMENT, detector=replace(EXPERIMENT.detector, score=0.0)))


@pytest.mark.slow
def test_a_step_changes_every_parameter_and_every_statistic(state, train_step):
    after, metrics = train_step(state, scene_batch([0, 1]))
    assert bool(metrics["finite"])
    assert after.step == 1
    still = [
        jax.tree_util.keystr(path)
        for (path, old), new in zip(
            jax.tree_util.tree_flatten_with_path(state.network)[0], jax.tree.leaves(after.network), strict=True
        )
        if (np.asarray(old) == np.asarray(new)).all()
    ]
    # Without a proposal on an object no box of the second stage is learned, and 0 decays to 0.
    assert all("box']" in name for name in still), still
    left_out = {name: int(n) for name, n in metrics.items() if name.startswith("dropped/")}
    assert left_out == dict.fromkeys(left_out, 0)
    assert len(left_out) == 6


@pytest.mark.slow
def test_the_same_step_gives_the_same_state(state, train_step):
    one, two = (train_step(state, scene_batch([0, 1]))[0] for _ in range(2))
    jax.tree.map(np.testing.assert_array_equal, one, two)


@pytest.mark.slow
def test_a_batch_with_an_empty_cloud_and_without_objects_stays_finite(state, train_step):
    batch = scene_batch([0, 1])
    for name in ("valid", "is_object"):
        batch[name][1] = False
    after, metrics = train_step(state, batch)
    assert bool(metrics["finite"])
    empty = {name: np.zeros_like(array) for name, array in batch.items()}
    after, metrics = train_step(state, empty)
    assert bool(metrics["finite"])
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(after))


@pytest.mark.long
def test_a_sample_is_judged_alike_in_any_batch_and_an_empty_cloud_gives_finite_boxes(state, detect):
    batch = scene_batch([2, 3])
    together, dropped = detect(state.network, batch["points"], batch["valid"])
    alone, _ = detect(state.network, batch["points"], batch["valid"] & (np.arange(2) == 0)[:, None])
    used = np.asarray(together.valid[0])
    assert used.any()
    np.testing.assert_array_equal(used, alone.valid[0])
    np.testing.assert_allclose(together.boxes[0][used], alone.boxes[0][used], atol=1e-3)
    np.testing.assert_allclose(together.score[0][used], alone.score[0][used], atol=1e-5)
    assert np.isfinite(alone.boxes).all()
    assert not any(int(n.max()) for n in dropped.values())


class Seen(Exception):
    """What the first convolution is given."""


@pytest.mark.long
def test_intensity_counts_as_so_many_metres(monkeypatch):
    def look(self, sites, features, capacities, *, train):
        raise Seen(np.asarray(features), np.asarray(sites.valid))

    monkeypatch.setattr(VoxelBackBone8x, "__call__", look)
    batch, given = scene_batch([2]), {}
    for scale in (1.0, 30.0):
        detector = VoxelRcnn(replace(EXPERIMENT.detector, intensity_m=scale), EXPERIMENT.voxels, rngs=nnx.Rngs(0))
        with pytest.raises(Seen) as seen:
            detector.first_stage(batch["points"], batch["valid"], train=False)
        given[scale], valid = seen.value.args
    assert given[1.0][valid][:, 3].max() > 0
    np.testing.assert_allclose(given[30.0], given[1.0] * np.float32([1, 1, 1, 30]), rtol=1e-6)


def test_a_range_that_does_not_divide_is_refused():
    with pytest.raises(ValueError, match="multiples of 8"):
        bev_channels(DetectorConfig(), VoxelConfig(range_m=(0, -40, -3, 70.2, 40, 1)))
    with pytest.raises(ValueError, match="too low"):
        bev_channels(DetectorConfig(), VoxelConfig(size_m=(0.05, 0.05, 0.5)))
