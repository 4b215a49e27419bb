"""Which answer is given, and what is said of the candidates that are not named."""

from types import SimpleNamespace

import numpy as np
import pytest

from jaxsim.discover.explain import why_not
from jaxsim.discover.find.localise import Place
from jaxsim.discover.name import answer
from jaxsim.discover.name.answer import outdone
from jaxsim.discover.name.candidates import Candidate
from jaxsim.discover.name.select import BAR, Choice, Step
from jaxsim.discover.name.unexplained import shape_of
from jaxsim.discover.show.judge import runner_up
from jaxsim.effects import EFFECTS

CHANNEL = {"intensity": 0, "range": 1, "drop": 2}


def candidate(name, each, channel="intensity", *, slope=None, units=10):
    gain = np.zeros((units, 3))
    gain[:, CHANNEL[channel]] = each
    slope = gain.sum(1) / 4 if slope is None else slope
    fits = (SimpleNamespace(z={"x": np.zeros(3)}),)
    effect = EFFECTS[name] if name in EFFECTS else SimpleNamespace(name=name, channels=(channel,))
    return Candidate(effect, gain, fits, slope)


def step(chosen, *alike, ranking=()):
    return Step(chosen, alike, ranking, SimpleNamespace(z={}), chosen.chance)


PLACE = {name: Place(name, "range", 0.01, 0.1, 50.0) for name in CHANNEL}


@pytest.mark.parametrize(
    ("named", "curve", "outside"),
    [
        ([], candidate("curve", 5), True),
        ([candidate("beam_gain", 8)], candidate("curve", 5), False),
        ([candidate("beam_gain", 3)], candidate("curve", 8), True),
        # A gain within a tenth of what is named, or a few nats more, is none.
        ([candidate("beam_gain", 8)], candidate("curve", 8.5), False),
        # What a lattice of readings gains is no dependence that a curve would have to beat.
        ([candidate("intensity_quantization", 4000)], candidate("curve", 8), True),
    ],
)
def test_a_curve_outdoes_only_what_it_explains_clearly_better(named, curve, outside):
    choice = Choice(tuple(map(step, named)), None, ())
    assert outdone(choice, PLACE["intensity"], curve) is outside


def test_a_curve_of_one_channel_leaves_what_is_named_in_another(monkeypatch):
    curve = candidate("curve", 9, "drop")
    monkeypatch.setattr(answer, "free_curves", lambda problem, places: [(PLACE["drop"], curve)])
    monkeypatch.setattr(answer, "describe", lambda problem, place, found: place.channel)
    monkeypatch.setattr(answer, "localise", lambda *_: [])
    monkeypatch.setattr(answer, "standardised", lambda *_: (None, {}))
    monkeypatch.setattr(answer, "with_steps", lambda null, steps: f"with {len(steps)}")
    gain, lost = step(candidate("beam_gain", 8)), step(candidate("random_dropout", 2, "drop"))
    said, choice, rest = answer.decide(None, Choice((gain, lost), "both", ()), [], np.ones(10), np.arange(10))
    assert (said, [one.chosen.effect.name for one in choice.steps], rest) == ("named", ["beam_gain"], "drop")
    assert choice.problem == "with 1"
    said, choice, rest = answer.decide(None, Choice((lost,), "one", ()), [], np.ones(10), np.arange(10))
    assert (said, choice.steps, rest) == ("not_in_catalogue", (), "drop")


def test_the_placebo_is_named_nowhere():
    gain, fall, haze, gamma = (
        candidate(name, each)
        for name, each in (("beam_gain", 9), ("range_falloff", 7), ("atmospheric_extinction", 6), ("gamma_response", 5))
    )
    ranking = (gain, fall, haze, gamma)
    first, second = step(gain, ranking=ranking), step(fall, haze)
    assert runner_up(Choice((first, second), None, ())) is gamma
    assert runner_up(Choice((), None, ranking)) is None


def test_each_candidate_is_told_why_it_was_not_named():
    best = candidate("beam_gain", 9)
    alike, weak = candidate("range_falloff", 8.9), candidate("saturation", 0.5)
    split = candidate("gamma_response", np.tile([60, -20], 5), slope=np.tile([3.0, -2.9], 5))
    little = candidate("oren_nayar", 4)
    ranking = (best, alike, split, little, weak)
    fall = candidate("atmospheric_extinction", 3)
    choice = Choice((step(best, alike, ranking=ranking), step(fall)), None, ())
    assert why_not(best, choice) == ""
    assert why_not(alike, choice).startswith("these data cannot tell")
    assert weak.total < BAR
    assert "within what a null reaches" in why_not(weak, choice)
    assert why_not(split, choice) == "the scenes disagree on it"
    assert why_not(little, choice) == "it explains clearly less than the one that is named"
    assert why_not(fall, choice) == "named too, after beam_gain"
    nothing = Choice((), None, (split, little))
    assert "weak beside gamma_response" in why_not(little, nothing)


@pytest.mark.parametrize(
    ("y", "character"),
    [
        (lambda x: 0.3 * x, "monotone"),
        (lambda x: np.where(x < 2, 0.0, 0.4), "step"),
        (lambda x: 0.3 * np.sin(3 * 2 * np.pi * x / 4), "periodic"),
    ],
)
def test_a_curve_is_called_what_it_looks_like(y, character):
    x = np.linspace(0, 4, 40)
    assert shape_of(x, y(x), np.ones(40), PLACE["intensity"])[0] == character
