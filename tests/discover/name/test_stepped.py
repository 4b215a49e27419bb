"""A step of all intensities in time is said where no effect says it."""

from dataclasses import replace

import numpy as np
import pytest

from jaxsim.discover.name import stepped as module
from jaxsim.discover.name.answer import Answer
from jaxsim.discover.name.doubts import NO_DOUBTS
from jaxsim.discover.name.select import Choice
from jaxsim.discover.name.stepped import IN_TIME, stepped
from jaxsim.discover.rules import RULES
from tests.discover.name.made import candidate, step
from tests.discover.switched import problem_with

pytestmark = pytest.mark.usefixtures("standard_promotion")
STEPPED = np.where((np.arange(16) >= 5) & (np.arange(16) < 11), 0.6, 1.0)


def asked(null, *chosen, beside=(), **more) -> Answer:
    """What `stepped` makes of an answer that names what was `chosen`, of which `beside` is what it gains beside it."""
    choice = Choice(tuple(step(one) for one in chosen), tuple(chosen), null)
    answer = Answer("named" if chosen else "none", choice, None, **more)
    return stepped(null, answer, doubts=NO_DOUBTS, beside=lambda curve, effects, bar: beside, log=lambda line: None)


@pytest.fixture(scope="module")
def null():
    return problem_with(STEPPED)


def test_a_gain_that_switches_is_not_in_the_catalogue(null):
    said = asked(null)
    assert said.verdict == "not_in_catalogue"
    assert (said.unexplained.channel, said.unexplained.covariate, said.unexplained.character) == (*IN_TIME, "step")
    inside, outside = min(said.unexplained.y), max(said.unexplained.y)
    assert inside - outside == pytest.approx(np.log(0.6), abs=0.1)
    # A frame's levels are told at the ends of each part alone.
    assert len(said.unexplained.x) == 6


def test_what_was_seen_elsewhere_is_not_asked_and_a_recording_that_does_not_step_keeps_its_answer(null):
    assert asked(null, unasked=(IN_TIME,)).verdict == "none"
    assert asked(problem_with(np.ones(16))).verdict == "none"


@pytest.mark.parametrize("left", [0.0, 0.9])
def test_effects_that_only_mend_the_step_go_and_others_stay(null, monkeypatch, left):
    drift, loss = candidate("emitter_drift", 5.0), candidate("random_dropout", 20.0, "drop")
    monkeypatch.setattr(module, "with_steps", lambda null, steps: null)
    said = asked(null, drift, loss, beside=[replace(drift, gain=left * drift.gain)])
    named = [one.chosen.effect.name for one in said.choice.steps]
    assert named == (["emitter_drift", "random_dropout"] if left > RULES.weak_share else ["random_dropout"])
    assert said.verdict == "named"
    assert said.unexplained is not None
    # With nothing else named it is what is missing.
    alone = asked(null, drift, beside=[replace(drift, gain=0.0 * drift.gain)])
    assert (alone.verdict, alone.choice.steps) == ("not_in_catalogue", ())
