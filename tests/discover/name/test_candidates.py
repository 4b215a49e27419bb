"""What counts as agreement between scenes."""

from types import SimpleNamespace

import numpy as np
import pytest

from jaxsim.discover.name import select as name
from jaxsim.discover.name.candidates import Candidate
from jaxsim.discover.name.select import accepted, padded
from jaxsim.discover.name.unexplained import agreed
from jaxsim.discover.scenes import clipped
from jaxsim.effects import EFFECTS


def candidate(effect: str, gain, slope=None) -> Candidate:
    gain = np.asarray(gain, float)
    by_channel = np.stack([gain, 0 * gain, 0 * gain], axis=-1)
    return Candidate(EFFECTS[effect], by_channel, (), np.asarray(gain if slope is None else slope, float))


def test_two_scenes_cannot_decide():
    gain = np.array([900.0, 800.0, 3.0, -1.0, -2.0, -1.0, 1.0, -400.0, 2.0, -1.0, -2.0])
    assert clipped(gain).max() == 400.0
    assert clipped(gain).min() == -400.0
    assert clipped(gain).sum() < 410
    assert not accepted(candidate("beam_gain", gain))


def test_scenes_that_agree_are_believed_and_scenes_that_do_not_are_not():
    steady = np.array([4.0, 5, 3, 6, 4, 5, 2, 4, 3, 5, 6])
    assert accepted(candidate("beam_gain", steady))
    assert candidate("beam_gain", steady).chance == pytest.approx(2 / 2048)
    assert not accepted(candidate("beam_gain", steady * np.array([1, -1, 1, 1, -1, 1, 1, -1, 1, 1, -1])))
    assert not accepted(candidate("beam_gain", steady / 10))  # agreed, but next to nothing


def test_the_direction_of_a_fit_can_be_agreed_where_its_length_is_not():
    gain = np.array([30.0, 25, 12, -29, 9, 31, -22, 28, 11, 3, 4])
    slope = np.array([9.0, 8, 4, 1, 3, 9, 0.5, 8, 4, 4, 5])
    assert not accepted(candidate("beam_gain", gain))
    assert accepted(candidate("beam_gain", gain, slope))


def test_rare_events_need_three_scenes_and_no_others_against_them():
    rare = np.array([210.0, 0, 0, 180, 0, -0.4, 0, 190, -0.3, 0, -0.2])
    assert accepted(candidate("packet_loss", rare))
    assert not accepted(candidate("packet_loss", np.where(rare > 200, 0, rare)))
    assert not accepted(candidate("packet_loss", rare - 40))


def test_more_numbers_must_gain_more():
    def with_numbers(count, gain):
        one = candidate("random_dropout", gain)
        fits = (SimpleNamespace(z={"probability": np.zeros(count)}),)
        return Candidate(one.effect, one.gain, fits, one.slope)  # pyright: ignore[reportArgumentType]

    base = np.full(11, 20.0)
    assert padded(with_numbers(4, base), with_numbers(1, base))
    assert not padded(with_numbers(4, base + 2), with_numbers(1, base))
    assert not padded(with_numbers(1, base), with_numbers(4, base))


def test_an_early_effect_that_the_others_make_needless_is_taken_back(monkeypatch):
    def step(effect):
        return name.Step(candidate(effect, np.full(11, 9.0)), (), (), SimpleNamespace(z={}), 0.001)  # pyright: ignore

    again = {"gamma_response": np.full(11, 0.1), "range_falloff": np.full(11, 9.0)}
    beside = []

    def added(null, steps):
        beside.append([one.chosen.effect.name for one in steps])
        return null

    monkeypatch.setattr(name, "with_steps", added)
    monkeypatch.setattr(name, "survey", lambda problem, effects: [candidate(e.name, again[e.name]) for e in effects])
    said = []
    steps = [step(n) for n in ("gamma_response", "range_falloff", "beam_gain")]
    kept = name.look_back(None, steps, name.Bars(), say=said.append)  # pyright: ignore[reportArgumentType]
    assert [one.chosen.effect.name for one in kept] == ["range_falloff", "beam_gain"]
    assert beside == [["range_falloff", "beam_gain"], ["beam_gain"]]
    assert said == ["gamma_response is not needed beside the others: 1 nats"]


def test_scenes_must_agree_on_a_free_curve_more_than_on_an_effect():
    steady = np.array([4.0, 5, 3, 6, 4, 5, 2, 4, 3, 5, 6])
    against = np.where(np.arange(11) == 3, -6.0, steady)
    assert 0.005 < candidate("beam_gain", against).chance <= 0.02
    assert agreed(candidate("beam_gain", steady))
    assert accepted(candidate("beam_gain", against))
    assert not agreed(candidate("beam_gain", against))
    # Of seven scenes no more than all can agree.
    assert agreed(candidate("beam_gain", steady[:7]))
