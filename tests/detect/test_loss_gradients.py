"""Gradients of both stages' losses against finite differences, in float64."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.config import DetectorConfig, RoiConfig
from jaxsim.detect.anchors import AnchorTargets
from jaxsim.detect.losses import corner_loss, roi_losses, rpn_losses
from jaxsim.detect.roi_head import targets_of

pytestmark = pytest.mark.usefixtures("quick_programs")

CONFIG = DetectorConfig()
STEP = 1e-6


@pytest.fixture(autouse=True)
def float64():
    with jax.enable_x64(True):
        yield


def slopes(loss, x):
    """Central differences of a scalar loss along each element of x."""
    x = np.asarray(x, np.float64)
    moves = STEP * np.eye(x.size).reshape(x.size, *x.shape)
    both = jnp.asarray(np.concatenate([x[None] + moves, x[None] - moves]))
    up, down = np.split(np.asarray(jax.jit(jax.vmap(loss))(both)), 2)
    return ((up - down) / (2 * STEP)).reshape(x.shape)


def check(loss, x):
    """The gradient of the loss, which finite differences confirm."""
    gradient = np.asarray(jax.jit(jax.grad(loss))(jnp.asarray(x, jnp.float64)))
    np.testing.assert_allclose(gradient, slopes(loss, x), rtol=2e-5, atol=2e-8)
    return gradient


@pytest.mark.parametrize("term", ["rpn_cls", "rpn_loc", "rpn_dir"])
def test_the_first_stages_gradients_are_its_slopes(term):
    rng, shape = np.random.default_rng(0), (2, 6)
    positive = np.array([[1, 0, 0, 1, 0, 0], [0, 0, 1, 0, 0, 0]], bool)
    ignored = np.array([[0, 1, 0, 0, 0, 0], [0, 0, 0, 0, 1, 0]], bool)
    deltas = rng.normal(0, 0.5, (*shape, 7)) * positive[..., None]
    label = rng.integers(0, 2, shape).astype(np.int32) * positive
    targets = AnchorTargets(positive, ~positive & ~ignored, jnp.asarray(deltas), jnp.asarray(label, jnp.int32))
    given = {
        "rpn_cls": rng.normal(-1, 1, shape),
        "rpn_loc": rng.normal(0, 0.5, (*shape, 7)),
        "rpn_dir": rng.normal(0, 1, (*shape, 2)),
    }

    def loss(x):
        inputs = {name: jnp.asarray(value) for name, value in given.items()} | {term: x}
        return rpn_losses(tuple(inputs.values()), targets, CONFIG)[term]

    gradient = check(loss, given[term])
    learns = positive if term != "rpn_cls" else ~ignored
    assert (gradient[~learns] == 0).all()
    assert (gradient[learns] != 0).all()


def proposals(rng, count):
    """Proposals, and objects near them."""
    middle, size = rng.uniform(-10, 10, (1, count, 3)), rng.uniform([3.5, 1.5, 1.4], [4.5, 1.9, 1.8], (1, count, 3))
    rois = np.concatenate([middle, size, rng.uniform(-3, 3, (1, count, 1))], -1)
    objects = rois + rng.normal(0, [0.3, 0.3, 0.1, 0.2, 0.1, 0.1, 0.2], rois.shape)
    return rois, objects


@pytest.mark.parametrize("term", ["roi_cls", "roi_reg", "roi_corner"])
def test_the_second_stages_gradients_are_its_slopes(term):
    rng = np.random.default_rng(1)
    rois, objects = proposals(rng, 5)
    rois[0, 4] = objects[0, 4] = 0  # fills up the list
    overlap = np.array([[0.8, 0.6, 0.5, 0.3, 0.0]])
    targets = targets_of(jnp.asarray(rois), jnp.asarray(objects), jnp.asarray(overlap), config=RoiConfig())
    given = {"cls": rng.normal(0, 1, (1, 5)), "box": rng.normal(0, 0.2, (1, 5, 7))}
    name = "cls" if term == "roi_cls" else "box"

    def loss(x):
        inputs = {key: jnp.asarray(value) for key, value in given.items()} | {name: x}
        return roi_losses(inputs["cls"], inputs["box"], targets, config=CONFIG)[term]

    gradient = check(loss, given[name])
    learns = np.array([[True, True, False, False, False]]) if name == "box" else np.ones((1, 5), bool)
    assert (gradient[~learns] == 0).all()
    assert (gradient[learns] != 0).all()


def test_the_corner_loss_slopes_as_its_gradient_says_near_and_far_and_turned_about():
    rng = np.random.default_rng(2)
    predicted, target = (boxes[0] for boxes in proposals(rng, 6))
    predicted[3:, :3] += 4  # beyond the Huber loss's turn
    target[1::2, 6] += np.pi
    check(lambda x: corner_loss(x, jnp.asarray(target)).sum(), predicted)
    turned = target + np.array([0, 0, 0, 0, 0, 0, np.pi])
    same = [corner_loss(jnp.asarray(predicted), jnp.asarray(t)) for t in (target, turned)]
    np.testing.assert_allclose(*same, rtol=1e-9)
