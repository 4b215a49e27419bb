"""PENet's stages, its frames, and the weights that preparation then uses."""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim import devices
from jaxsim.config import PenetConfig, PrepareConfig, Stage
from jaxsim.config.depth import PUBLISHED_STAGES
from jaxsim.frame import Camera, CameraFrame, Cloud, DepthFrame, Frame
from jaxsim.metrics.depth import depth_errors
from jaxsim.prepare import dense_view, depth
from jaxsim.prepare.depth import complete_depth, penet
from jaxsim.prepare.depth.penet.network import Backbone
from jaxsim.prepare.depth.penet.training import (
    Batches,
    augment_frame,
    branch_weight,
    branches_error,
    create_state,
    depth_frame,
    masked_error,
    predict,
    rate,
    train_step,
    where_backed,
)
from tests.prepare.depth.penet.made_training import plane, view

CROP = (32, 64)
STAGES = tuple(Stage(part, 1, 2, CROP, ()) for part in ("branches", "refinement", "joint"))
CONFIG = PenetConfig(width=2, stages=STAGES)
INTRINSICS = np.array([[60.0, 0, 40], [0, 60, 20], [0, 0, 1]], np.float32)


def batch(number=0):
    config = replace(CONFIG, stages=(replace(STAGES[0], epochs=100),))
    return Batches([plane(0), plane(1), plane(2)], config, seed=0)[number]


def test_the_stages_are_the_published_ones():
    assert [(s.part, s.epochs, s.batch, s.crop) for s in PUBLISHED_STAGES] == [
        ("branches", 30, 6, (320, 1216)),
        ("refinement", 30, 6, (320, 1216)),
        ("joint", 60, 10, (160, 576)),
    ]
    rates = [rate(PenetConfig(), PUBLISHED_STAGES[0], epoch) for epoch in (0, 9, 10, 14, 15, 24, 25)]
    np.testing.assert_allclose(rates, [1e-3, 1e-3, 5e-4, 5e-4, 1e-4, 1e-4, 1e-5])
    assert rate(PenetConfig(), PUBLISHED_STAGES[2], 55) == pytest.approx(1e-8)
    assert [branch_weight(epoch) for epoch in range(5)] == [0.2, 0.2, 0.05, 0.05, 0.0]


@pytest.mark.slow
def test_the_refinement_leaves_the_branches_parameters_alone():
    state = create_state(CONFIG, seed=0)
    before = jax.tree.map(np.asarray, state.values)
    rates = {"lr": jnp.float32(1e-3), "weight": jnp.float32(0.0)}
    state, metrics = train_step(state, batch(), **rates, config=CONFIG, part="refinement")
    after = jax.tree.map(np.asarray, state.values)
    assert bool(metrics["finite"])
    assert int(state.step) == 1
    for path, old in jax.tree.leaves_with_path(before):
        new = after
        for key in path:
            new = new[key.key]
        stored = path[-1].key.startswith("running")
        if path[0].key == "backbone" and not stored:
            np.testing.assert_array_equal(new, old)
        elif path[-1].key == "kernel":
            assert (new != old).any()


@pytest.mark.slow
def test_the_joint_stage_moves_the_branches_by_a_tenth_and_leaves_stored_statistics_alone():
    """Adam's first update is the rate itself wherever a gradient is; so the largest move of a part is its share."""
    state = create_state(replace(CONFIG, start_m=10.0), seed=0)
    before = jax.tree.map(np.asarray, state.values)
    rates = {"lr": jnp.float32(1e-2), "weight": jnp.float32(0.0)}
    state, metrics = train_step(state, batch(), **rates, config=CONFIG, part="joint", norms="stored")
    assert bool(metrics["finite"])
    moved = jax.tree.map(lambda new, old: float(np.abs(np.asarray(new) - old).max()), state.values, before)
    most = {"branches": 0.0, "refinement": 0.0}
    for path, change in jax.tree.leaves_with_path(moved):
        if path[-1].key.startswith("running"):
            assert change == 0, path
        else:
            part = "branches" if path[0].key == "backbone" else "refinement"
            most[part] = max(most[part], change)
    assert most == pytest.approx({"branches": 1e-3, "refinement": 1e-2}, rel=1e-3)


def test_the_branches_loss_weighs_each_branch_and_what_both_leave_the_fused_depth():
    frame = jax.tree.map(lambda x: jnp.asarray(x)[None], replace(plane(0), known=np.indices((48, 96))[1] % 3 == 0))
    guesses = [frame.truth_m + off for off in (1.0, -2.0, 3.0)]
    seen = Backbone(*guesses, *(jnp.zeros((1, 1, 1, 1)),) * 3)
    for weight in (0.0, 0.05, 0.2):
        expected = weight * (1 + 4) + (1 - 2 * weight) * 9
        assert float(branches_error(seen, frame, jnp.float32(weight), loss="square")) == pytest.approx(
            expected, rel=1e-4
        )
        expected = weight * (1 + 3) + (1 - 2 * weight) * 5
        assert float(branches_error(seen, frame, jnp.float32(weight), loss="huber")) == pytest.approx(
            expected, rel=1e-4
        )


@pytest.mark.slow
def test_two_devices_learn_what_one_learns():
    mesh = devices.data_mesh(2)
    if mesh is None:
        pytest.skip("one device")
    rates = {"lr": jnp.float32(1e-3), "weight": jnp.float32(0.2)}
    run = partial(train_step, config=CONFIG, part="branches")
    alone, one = run(create_state(CONFIG, seed=0), batch(), **rates)
    shared, two = run(devices.everywhere(mesh, create_state(CONFIG, seed=0)), devices.cut(mesh, batch()), **rates)
    assert float(two["loss/depth"]) == pytest.approx(float(one["loss/depth"]), rel=1e-4)
    assert float(two["grad_norm"]) == pytest.approx(float(one["grad_norm"]), rel=1e-3)
    for (path, ours), theirs in zip(
        jax.tree.leaves_with_path(shared.values), jax.tree.leaves(alone.values), strict=True
    ):
        if path[-1].key.startswith("running"):
            np.testing.assert_allclose(np.asarray(ours), np.asarray(theirs), rtol=1e-3, atol=1e-4, err_msg=str(path))


@pytest.fixture(autouse=True)
def optax_promotes():
    """optax raises a float to an int."""
    with jax.numpy_dtype_promotion("standard"):
        yield


@pytest.mark.slow
def test_branches_learn_a_wall():
    state = create_state(replace(CONFIG, start_m=10.0), seed=0)
    losses = []
    for k in range(60):
        rates = {"lr": jnp.float32(1e-2), "weight": jnp.float32(0.2)}
        state, metrics = train_step(state, batch(k), **rates, config=CONFIG, part="branches")
        losses.append(float(metrics["loss/depth"]))
    assert np.mean(losses[-10:]) < 0.6 * np.mean(losses[:10])


def test_hubers_loss_is_squared_to_a_metre_and_linear_beyond():
    frame = jax.tree.map(jnp.asarray, plane(0))
    off = lambda metres, loss: float(masked_error(frame.truth_m + metres, frame, loss))  # noqa: E731
    assert off(0.5, "huber") == pytest.approx(0.25, rel=1e-4)
    assert off(-3.0, "huber") == pytest.approx(5.0, rel=1e-4)
    assert off(-3.0, "square") == pytest.approx(9.0, rel=1e-4)
    assert float(masked_error(frame.truth_m + 7, replace(frame, known=frame.known & False), "huber")) == 0


@pytest.mark.slow
def test_the_branches_learn_one_frame_by_heart_better_than_ip_basic_fills_it():
    """A frame whose sparse points alone do not tell its edges: two walls, seen apart in the image."""
    rng = np.random.default_rng(0)
    truth = np.where(np.add.outer(np.arange(64) // 3, np.arange(96)) % 48 < 24, 8.0, 20.0).astype(np.float32)
    given = rng.random(truth.shape) < 0.04
    rgb = np.where(truth[..., None] < 10, np.uint8(60), np.uint8(180)) + np.zeros(3, np.uint8)
    one = DepthFrame(rgb, np.where(given, truth, 0), given, truth, np.ones(truth.shape, bool), intrinsics=INTRINSICS)
    config = replace(CONFIG, width=4, start_m=10.0, loss="huber")
    state, frame = create_state(config, seed=0), jax.tree.map(lambda x: x[None], one)
    for k in range(150):
        rates = {"lr": jnp.float32(1e-2 * min(1.0, 3 * (1 - k / 150))), "weight": jnp.float32(0.05)}
        state, _ = train_step(state, frame, **rates, config=config, part="branches")
    guess = np.asarray(predict(state.values, frame, config=config, part="branches"))[0]
    dense, filled = complete_depth(one.sparse_m, given, "ip_basic")
    learned, classical = (
        depth_errors(depth, filled, truth, known=one.known)["rmse"] for depth in (np.maximum(guess, 0.1), dense)
    )
    assert learned < 0.6 * classical


@pytest.mark.parametrize("seed", range(4))
def test_cropping_and_mirroring_move_the_camera_with_the_image(seed):
    frame = plane(seed)
    cut = augment_frame(frame, STAGES[0], CONFIG, rng=np.random.default_rng(seed))
    assert cut.sparse_m.shape == CROP
    assert cut.rgb.dtype == np.uint8
    v, u = np.mgrid[: CROP[0], : CROP[1]]
    right = (u - cut.intrinsics[0, 2]) / cut.intrinsics[0, 0]
    down = (v - cut.intrinsics[1, 2]) / cut.intrinsics[1, 1]
    # The wall's depth tells where a pixel came from; a mirrored scene has its right on the left.
    old_v, old_u = np.mgrid[: frame.truth_m.shape[0], : frame.truth_m.shape[1]]
    for row, column in ((0, 0), (31, 63), (10, 40)):
        source = np.argwhere(np.isclose(frame.truth_m, cut.truth_m[row, column], atol=1e-5))
        rights = (old_u[tuple(source.T)] - INTRINSICS[0, 2]) / INTRINSICS[0, 0]
        downs = (old_v[tuple(source.T)] - INTRINSICS[1, 2]) / INTRINSICS[1, 1]
        assert np.isclose(np.abs(right[row, column]), np.abs(rights), atol=1e-5).any()
        assert np.isclose(down[row, column], downs, atol=1e-5).any()


def test_a_batch_depends_on_its_place_alone():
    jax.tree.map(np.testing.assert_array_equal, batch(1), batch(1))
    assert (batch(1).rgb != batch(2).rgb).any()
    assert Batches([plane(0)] * 5, CONFIG, seed=0).steps == [2, 2, 2]
    with pytest.raises(ValueError, match="1 training frames do not fill"):
        Batches([plane(0)], CONFIG, seed=0)
    with pytest.raises(ValueError, match="the branches stage crops 32 x 64"):
        augment_frame(plane(0, (16, 96)), STAGES[0], CONFIG, rng=np.random.default_rng(0))


def test_published_weights_are_told_half_of_the_cut_rows(monkeypatch):
    seen = []

    def spy(values, rgb, sparse, *, valid, intrinsics, width, convention):
        seen.append(intrinsics[0])
        return np.ones(sparse.shape, np.float32)

    monkeypatch.setattr(penet, "complete", spy)
    camera, frame = view()
    network = penet.Penet(2, "published", {})
    network(frame.rgb, frame.sparse_m, frame.given, intrinsics=INTRINSICS, rows_cut=23)
    assert seen[0][1, 2] == INTRINSICS[1, 2] + 11.5  # the crop has taken 23 off already
    assert seen[0][0, 2] == INTRINSICS[0, 2]
    assert camera.depth_m is None


@pytest.mark.parametrize(("convention", "rows"), [("exact", 23.0), ("published", 11.5)])
def test_a_kitti_frame_s_crop_moves_the_principal_point(monkeypatch, convention, rows):
    """375 rows, 352 of them used: the published weights alone are told half of what is cut."""
    seen = []

    def spy(values, rgb, sparse, *, valid, intrinsics, width, convention):
        seen.append(intrinsics[0])
        return jnp.full(valid.shape, 10.0)

    monkeypatch.setattr(penet, "complete", spy)
    monkeypatch.setattr(depth, "open_penet", lambda path: penet.Penet(2, convention, {}))
    intrinsics = np.array([[721.5, 0, 609.6], [0, 721.5, 172.9], [0, 0, 1]], np.float32)
    rng = np.random.default_rng(0)
    z = rng.uniform(5, 40, 500)
    places = rng.uniform([20, 100], [1220, 370], (500, 2))
    xyz = np.column_stack([(places - intrinsics[:2, 2]) / 721.5 * z[:, None], z]).astype(np.float32)
    camera = CameraFrame(np.zeros((375, 1242, 3), np.uint8), Camera(intrinsics, np.eye(4, dtype=np.float32)))
    frame = Frame("one", "drive", camera, Cloud(xyz, np.ones(500, np.float32), np.ones(500, bool)))
    view = dense_view(frame, PrepareConfig(inputs=("rgb", "depth"), depth="penet"))
    np.testing.assert_allclose(seen[0][:2, 2], [609.6 - 13, 172.9 - rows], atol=1e-3)
    # What is painted with is where the pixels are, whatever the network was told.
    np.testing.assert_allclose(view.camera.intrinsics[:2, 2], [609.6 - 13, 172.9 - 23], atol=1e-3)
    assert view.depth_m.shape == (352, 1216)
    assert (view.depth_m[view.depth_valid] == 10).all()


def test_nothing_is_learned_above_the_highest_point():
    frame = plane(0)
    given = frame.given & (np.arange(48) >= 20)[:, None]
    backed = where_backed(replace(frame, given=given, sparse_m=np.where(given, frame.sparse_m, 0)))
    assert not backed.known[:16].any()
    assert backed.known[24:].mean() > 0.95
    assert not where_backed(replace(frame, known=np.zeros_like(frame.known))).known.any()


def test_a_renderers_frame_gives_sweep_and_truth():
    camera, frame = view((48, 96))
    rng = np.random.default_rng(0)
    uv = rng.uniform(1, [95, 47], (500, 2))
    z = rng.uniform(5, 20, 500)
    xyz = np.column_stack([(uv[:, 0] - 40) / 60 * z, (uv[:, 1] - 20) / 60 * z, z]).astype(np.float32)
    cloud = Cloud(xyz, np.ones(500, np.float32), np.ones(500, bool))
    seen = replace(camera, depth_m=frame.truth_m, depth_valid=frame.known)
    whole = Frame("one", "street", seen, cloud)
    cut = depth_frame(whole, (32, 64))
    np.testing.assert_array_equal(cut.truth_m, frame.truth_m[16:, 16:80])
    np.testing.assert_array_equal(cut.intrinsics[:2, 2], [40 - 16, 20 - 16])
    assert 0 < cut.given.sum() < 500
    with pytest.raises(ValueError, match="no LiDAR sweep"):
        depth_frame(replace(whole, cloud=None), (32, 64))
    with pytest.raises(ValueError, match="no true depth"):
        depth_frame(replace(whole, camera=camera), (32, 64))
    with pytest.raises(ValueError, match=r"smaller than the crop of 64 x 64; lower --image-crop"):
        depth_frame(whole, (64, 64))
