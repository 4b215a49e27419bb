"""Looks at a window: each answer comes back where it belongs, and errors that a look does not share are averaged."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.config import Experiment, GeneratorConfig
from jaxsim.pix2pix import create_state, make_generate
from jaxsim.pix2pix.looks import LOOKS

WINDOW = np.random.default_rng(0).random((2, 14, 9, 3)).astype(np.float32)


def mean_of(answer):
    """A made network's answers to all looks, averaged as `make_generate` does."""
    rows = WINDOW.shape[1]
    return np.mean([np.asarray(look.back(answer(look.at(jnp.asarray(WINDOW))), rows)) for look in LOOKS], axis=0)


def test_what_each_cell_says_of_itself_comes_back_to_it():
    for look in LOOKS:
        seen = look.at(jnp.asarray(WINDOW))
        assert seen.shape == (2, 14 + look.above + look.below, 9, 3)
        np.testing.assert_array_equal(look.back(seen, 14), WINDOW)


def test_no_two_looks_are_alike():
    assert len(set(LOOKS)) == len(LOOKS)


def test_a_step_from_left_to_right_has_no_part_in_the_mean_with_the_mirror():
    def answer(seen):
        place = jnp.arange(seen.shape[2], dtype=jnp.float32)[None, None, :, None]
        return seen[..., :1] + 0.2 * jnp.broadcast_to(place, seen[..., :1].shape)

    np.testing.assert_allclose(mean_of(answer), WINDOW[..., :1] + 0.2 * 4, rtol=1e-6)


def test_lifted_rows_are_not_told_by_their_place():
    """A network that says something else of every other row, whatever it sees there: one look of four contradicts."""

    def answer(seen):
        every_other = (jnp.arange(seen.shape[1]) % 2).astype(jnp.float32)[None, :, None, None]
        return jnp.broadcast_to(every_other, (*seen.shape[:3], 1))

    found = mean_of(answer)
    np.testing.assert_allclose(found[:, ::2], 1 / 4)
    np.testing.assert_allclose(found[:, 1::2], 3 / 4)


@pytest.mark.parametrize("ways", [1, 2, 4])
def test_a_unet_gives_the_mean_of_as_many_looks_as_it_is_told(ways):
    config = GeneratorConfig(form="unet", filters=4, max_filters=8, downsamples=1, blocks=1, enhancers=0, looks=ways)
    experiment = Experiment(generator=config)
    parameters = create_state(experiment, 3, seed=0).ema
    once = make_generate(replace(experiment, generator=replace(config, looks=1)), 3)
    window = jnp.asarray(WINDOW)
    expected = np.mean([look.back(once(parameters, look.at(window)), 14) for look in LOOKS[:ways]], axis=0)
    assert np.ptp(expected) > 0
    np.testing.assert_allclose(make_generate(experiment, 3)(parameters, window), expected, atol=1e-5)
