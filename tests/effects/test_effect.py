"""What a law is, whatever its formula."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.effects import EFFECTS, Law, get_effect


def test_laws_are_equal_by_name_and_serve_as_static_arguments():
    effect = EFFECTS["beam_gain"]
    assert effect == get_effect("beam_gain") == replace(effect, title="another title")
    assert effect != replace(effect, name="beam_loss")
    assert len({effect, get_effect("beam_gain"), EFFECTS["range_scale"]}) == 2


def test_a_law_needs_no_row_of_the_catalogue():
    law = Law(name="none", parameters={}, channels=("intensity",), apply=lambda p, rays: rays)
    assert (law.casts, law.covariates, law.starts, law.values({}, 5)) == (0, (), (), {})


def test_values_are_arrays_of_the_parameters_shapes():
    values = EFFECTS["focal_compensation"].values({"slope": 0.5, "focal_m": np.arange(5)}, 5)
    assert {name: value.shape for name, value in values.items()} == {"slope": (), "focal_m": (5,)}
    assert all(value.dtype == jnp.float32 for value in values.values())
    repeated = EFFECTS["material_dropout"].values({"probability": 0.25}, 5)["probability"]
    np.testing.assert_array_equal(np.asarray(repeated), np.full(34, 0.25, np.float32))


def test_what_a_law_does_not_have_is_answered_with_what_it_has():
    with pytest.raises(ValueError, match="no parameter size; it has gain"):
        EFFECTS["beam_gain"].values({"size": 1.0}, 5)
    with pytest.raises(ValueError, match="5 beams"):
        EFFECTS["beam_gain"].values({"gain": np.zeros(4)}, 5)
