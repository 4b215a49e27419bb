"""What naming is asked: the catalogue with look-alikes, and nothing of intensities that are unrelated."""

from dataclasses import replace

import numpy as np
import pytest

from jaxsim.discover.find.division import NOTHING_YET
from jaxsim.discover.read import Comparison
from jaxsim.discover.stages.ask import ask
from jaxsim.discover.stages.place import place
from jaxsim.effects import get_effect
from tests.discover.toy import toy

pytestmark = [pytest.mark.long, pytest.mark.usefixtures("standard_promotion")]


def test_what_is_hidden_is_the_answer_of_the_catalogue(stages):
    asked = stages.asked
    assert [step.chosen.effect.name for step in asked.answer.choice.steps] == ["range_offset"]
    assert [effect.name for effect in asked.catalogue] == ["range_offset", "incidence_cosine"]
    assert (asked.unrelated, asked.without, asked.contrast) == (None, (), None)


def test_a_simulator_without_noise_and_control_has_no_other_sides(stages):
    assert not stages.placed.division.simulator.noisy
    assert list(stages.asked.others) == []


def test_of_intensities_that_are_unrelated_nothing_is_asked():
    scan, measured = toy(frames=12)
    # Bright surfaces read dark: a relation, but none that a sensor has.
    swapped = np.where(measured.valid, np.clip(0.7 - measured.intensity, 0.01, 1), 0).astype(np.float32)
    names = tuple(f"{k:02d}" for k in range(12))
    comparison = Comparison(scan, replace(measured, intensity=swapped), names, names)
    catalogue = [get_effect(name) for name in ("range_offset", "incidence_cosine", "gamma_response")]
    asked = ask(place(comparison, catalogue, NOTHING_YET, log=lambda line: None), nulls=0, log=lambda line: None)
    assert asked.unrelated is not None
    assert asked.without == ("intensity",)
    assert [effect.name for effect in asked.catalogue] == ["range_offset"]
    assert asked.answer.verdict == "none"
