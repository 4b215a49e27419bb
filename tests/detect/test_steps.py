"""The optimiser against the published schedule and against PyTorch's arithmetic written out."""

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest

from jaxsim import devices
from jaxsim.config import OneCycleConfig
from jaxsim.detect.batches import SceneBatches
from jaxsim.detect.steps import create_state, make_train_step, one_cycle, optimiser
from jaxsim.evaluate.detector import main_scores, make_find, score_detector
from tests.detect.tiny import EXPERIMENT, VOXELS, scene, scene_batch

CONFIG = OneCycleConfig()


@pytest.mark.parametrize("steps", [148480, 100, 997])
def test_the_cycle_is_the_published_one(published, steps):
    heads = published("heads")
    with jax.enable_x64(True):
        for step, (rate, beta) in zip(heads[f"onecycle_{steps}_steps"], heads[f"onecycle_{steps}_lr_mom"], strict=True):
            mine = one_cycle(CONFIG, steps, jnp.asarray(float(step)))
            np.testing.assert_allclose(np.array([float(v) for v in mine]), [rate, beta], rtol=0, atol=1e-12)


def test_the_cycle_on_a_device_is_near_it(published):
    heads = published("heads")
    steps, wanted = heads["onecycle_997_steps"], heads["onecycle_997_lr_mom"]
    mine = jax.jit(jax.vmap(lambda s: jnp.stack(one_cycle(CONFIG, 997, s))))(jnp.asarray(steps, jnp.int32))
    np.testing.assert_allclose(mine, wanted, rtol=2e-5, atol=1e-9)


def oracle(parameter, gradients, steps, config):
    """Clip, decay, Adam (torch.optim.Adam), one array, float64."""
    first = second = np.zeros_like(parameter)
    with jax.enable_x64(True):
        cycle = [tuple(float(v) for v in one_cycle(config, steps, jnp.asarray(float(k)))) for k in range(steps)]
    for k, gradient in enumerate(gradients):
        rate, beta = cycle[k]
        norm = np.linalg.norm(gradient)
        gradient = gradient * min(1.0, config.clip / (norm + 1e-6))
        parameter = parameter * (1 - config.weight_decay * rate)
        first = beta * first + (1 - beta) * gradient
        second = config.beta2 * second + (1 - config.beta2) * gradient**2
        hat = first / (1 - beta ** (k + 1))
        root = np.sqrt(second / (1 - config.beta2 ** (k + 1)))
        parameter = parameter - rate * hat / (root + 1e-8)
    return parameter


def test_updates_are_clipped_decayed_adam():
    rng, steps = np.random.default_rng(0), 8
    config = OneCycleConfig(lr=0.05, clip=3.0, weight_decay=0.1)
    start = rng.standard_normal(6)
    gradients = [rng.standard_normal(6) * scale for scale in (0.5, 4, 1, 9, 0.1, 1, 1, 2)]
    adam = optimiser(config, steps)
    parameters = {"a": jnp.asarray(start[:4], jnp.float32), "b": jnp.asarray(start[4:], jnp.float32)}
    state = adam.init(parameters)

    @jax.jit
    def step(parameters, state, gradient):
        updates, state = adam.update(gradient, state, parameters)
        return optax.apply_updates(parameters, updates), state

    for gradient in gradients:
        tree = {"a": jnp.asarray(gradient[:4], jnp.float32), "b": jnp.asarray(gradient[4:], jnp.float32)}
        parameters, state = step(parameters, state, tree)
    mine = np.concatenate([parameters["a"], parameters["b"]])
    np.testing.assert_allclose(mine, oracle(start, gradients, steps, config), rtol=2e-5, atol=2e-6)


def test_a_fresh_state_has_the_types_of_a_trained_one():
    """A Python number in it would be of a weak type, and the training step would be compiled twice."""
    leaves = jax.tree_util.tree_leaves_with_path(create_state(EXPERIMENT, 10, seed=0))
    assert len(leaves) > 100
    assert [jax.tree_util.keystr(path) for path, leaf in leaves if leaf.weak_type] == []


@pytest.mark.slow
def test_eight_scenes_are_learned_by_heart():
    """3D AP at overlap 0.7 of 95 and more: localisation, headings and scores, all of both stages, must work."""
    steps, scenes = 250, [scene(seed) for seed in range(8)]
    loader = SceneBatches(scenes, VOXELS, EXPERIMENT.augment, size=2, seed=0)
    state, train_step = create_state(EXPERIMENT, steps, seed=0), make_train_step(EXPERIMENT, steps)
    for k in range(steps):
        state, metrics = train_step(state, loader[k])
        assert bool(metrics["finite"])
    curves, _ = score_detector(make_find(EXPERIMENT), state.network, scenes, experiment=EXPERIMENT)
    scores = main_scores(curves)
    assert scores["AP_3d_moderate"].count == 48
    assert scores["AP_3d_moderate"].value >= 95, scores
    assert scores["AP_bev_moderate"].value >= 95, scores


@pytest.mark.slow
@pytest.mark.usefixtures("quick_programs")
def test_two_devices_learn_what_one_does():
    state = jax.tree.map(np.asarray, create_state(EXPERIMENT, 50, seed=0))
    batch, mesh = scene_batch([0, 1]), devices.data_mesh(2)
    assert mesh is not None
    alone, wanted = make_train_step(EXPERIMENT, 50)(state, batch)
    step = make_train_step(EXPERIMENT, 50, mesh=mesh)
    shared, metrics = step(devices.everywhere(mesh, state), devices.cut(mesh, batch))
    for name, value in wanted.items():
        np.testing.assert_allclose(np.asarray(metrics[name], float), float(value), rtol=1e-4, err_msg=name)
    jax.tree.map(
        lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-3, atol=1e-5),
        shared.network.statistics,
        alone.network.statistics,
    )
    # After one step Adam's first moment is (1 - beta) of the clipped gradient: sharding must not change it.
    for (path, own), other in zip(
        jax.tree_util.tree_flatten_with_path(alone.optim["first"])[0],
        jax.tree.leaves(shared.optim["first"]),
        strict=True,
    ):
        own, name = np.asarray(own), jax.tree_util.keystr(path)
        np.testing.assert_allclose(other, own, rtol=1e-3, atol=1e-3 * np.abs(own).max(), err_msg=name)
    assert any(np.asarray(leaf).any() for leaf in jax.tree.leaves(alone.optim["first"]))
