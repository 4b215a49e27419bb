"""When the C++ form is taken, and that one call answers samples, batches, and batches of batches."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.native import build, call, floats, integers, takes

RADIUS, WIDTH = 2, 5
SHAPE = (3, 4, 6)
"""Rows and columns of patches, and how many are asked for."""


@pytest.fixture(autouse=True)
def compiled():
    if not build.available():
        pytest.skip(f"no C++ form here: {build.form()}")


def search(image, mask):
    shapes = floats(*SHAPE), integers(*SHAPE)
    return call("nearest_patches", shapes, image, mask, p=WIDTH, d=1, radius=RADIUS, unlike=1e6)


def images(*batch):
    border = 2 * RADIUS + WIDTH - 1
    rng = np.random.default_rng(0)
    shape = (*batch, SHAPE[0] + border, SHAPE[1] + border)
    return jnp.asarray(rng.normal(size=shape), jnp.float32), jnp.asarray(rng.random(shape) < 0.8, jnp.float32)


def test_a_sample_is_answered_as_a_loop_answers_it():
    image, _ = images()
    distance, number = search(image, jnp.zeros(()))
    cells, wide = np.asarray(image, np.float64), SHAPE[1] + 2 * RADIUS
    for row in range(SHAPE[0]):
        for column in range(SHAPE[1]):
            here = cells[row + RADIUS :, column + RADIUS :][:WIDTH, :WIDTH]
            far = {
                (row + i) * wide + column + j: ((cells[row + i :, column + j :][:WIDTH, :WIDTH] - here) ** 2).sum()
                for i in range(2 * RADIUS + 1)
                for j in range(2 * RADIUS + 1)
            }
            nearest = sorted(far, key=far.get)[: SHAPE[2]]
            np.testing.assert_array_equal(number[row, column], nearest)
            np.testing.assert_allclose(distance[row, column], [far[k] for k in nearest], rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("batch", [(3,), (2, 3)])
def test_a_batch_is_answered_as_its_samples_are(batch):
    image, mask = images(*batch)
    function = search
    for _ in batch:
        function = jax.vmap(function)
    answers = jax.jit(function)(image, mask)
    for place in np.ndindex(*batch):
        for whole, one in zip(answers, search(image[place], mask[place]), strict=True):
            np.testing.assert_array_equal(whole[place], one)


def test_what_all_samples_share_needs_no_batch():
    image, mask = images(3)
    answers = jax.jit(jax.vmap(search, in_axes=(0, None)))(image, mask[0])
    for k in range(3):
        np.testing.assert_array_equal(answers[0][k], search(image[k], mask[0])[0])


def test_other_types_and_a_setting_keep_xlas_form(monkeypatch):
    assert takes(jnp.zeros(2, jnp.float32), jnp.zeros(2, jnp.int32))
    assert not takes(jnp.zeros(2, jnp.float16))
    monkeypatch.setenv(build.SETTING, "0")
    assert not takes(jnp.zeros(2, jnp.float32))
