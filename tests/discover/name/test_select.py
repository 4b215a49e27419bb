"""Which candidates are chosen, which stand beside them, and which are taken back."""

from types import SimpleNamespace

import numpy as np
import pytest

from jaxsim.discover.explain import ranking, why_not
from jaxsim.discover.name import select
from jaxsim.discover.name.select import (
    Bars,
    Choice,
    choose,
    look_back,
    runner_up,
    says_as_much,
    simpler_beginning,
    too_rich,
    worse,
)
from tests.discover.name.made import candidate, problem, step


def test_more_numbers_must_gain_more():
    assert too_rich(candidate("random_dropout", 20.0, numbers=4), candidate("random_dropout", 20.0, numbers=1))
    assert not too_rich(candidate("random_dropout", 22.0, numbers=4), candidate("random_dropout", 20.0, numbers=1))
    assert not too_rich(candidate("random_dropout", 20.0, numbers=1), candidate("random_dropout", 20.0, numbers=4))


def test_worse_is_what_gains_clearly_less_or_less_in_every_scene():
    best = candidate("beam_gain", 10.0)
    assert worse(candidate("saturation", 7.0), best)
    assert worse(candidate("saturation", 9.0), best)
    assert not worse(candidate("saturation", 10.0 + np.array([1, -1] * 5 + [0])), best)


def test_an_early_effect_that_the_others_make_needless_is_taken_back(monkeypatch):
    again = {"gamma_response": 0.1, "range_falloff": 9.0, "beam_gain": 9.0}
    beside = []

    def added(null, steps):
        beside.append([one.chosen.effect.name for one in steps])
        return null

    monkeypatch.setattr(select, "with_steps", added)
    monkeypatch.setattr(select, "together", lambda null, steps: list(steps))
    monkeypatch.setattr(
        select, "rank_effects", lambda problem, effects: [candidate(e.name, again[e.name]) for e in effects]
    )
    lines = []
    steps = [step(candidate(name, 9.0)) for name in ("gamma_response", "range_falloff", "beam_gain")]
    needed = look_back(problem(), steps, Bars(), log=lines.append)
    assert [one.chosen.effect.name for one in needed] == ["range_falloff", "beam_gain"]
    assert beside[:2] == [["range_falloff", "beam_gain"], ["beam_gain"]]
    assert lines == ["gamma_response is not needed beside the others: 1 nats"]


def test_what_came_after_an_effect_that_is_gone_counts_for_what_it_gains_without_it(monkeypatch):
    """A gate beside losses of faint echoes gains little; without them, which it explains too, it gains all."""
    faint = {"gain": 0.1}

    def rank(beside, effects):
        [effect] = effects
        # Effects in place -> what the gate gains on top of them.
        gate = 90.0 if beside == ["random_dropout"] else 1.0
        gain = {"snr_dropout": faint["gain"], "range_gate": gate}.get(effect.name, 50.0)
        return [candidate(effect.name, gain)]

    monkeypatch.setattr(select, "with_steps", lambda null, steps: [one.chosen.effect.name for one in steps])
    monkeypatch.setattr(select, "together", lambda null, steps: list(steps))
    monkeypatch.setattr(select, "rank_effects", rank)
    gains = {"random_dropout": 60.0, "snr_dropout": 80.0, "range_gate": 1.0, "beam_gain": 6.0}
    steps = [step(candidate(name, each)) for name, each in gains.items()]
    needed = look_back(problem(), steps, Bars())
    assert [one.chosen.effect.name for one in needed] == ["random_dropout", "range_gate", "beam_gain"]
    assert [one.chosen.by_scene[0] for one in needed] == [60.0, 90.0, 50.0]
    assert needed[0] is steps[0]
    faint["gain"] = 50.0
    assert look_back(problem(), steps, Bars()) == tuple(steps)


def test_what_gains_less_than_the_nulls_is_not_named(monkeypatch):
    strong = candidate("gamma_response", np.array([4.0, 5, 3, 6, 4, 5, 2, 4, 3, 5, 6]))
    monkeypatch.setattr(select, "rank_effects", lambda problem, effects: [strong])
    choice = choose(problem(ev=SimpleNamespace(scene=np.arange(11))), [], bars=Bars(46.0))
    assert choice.steps == ()
    assert why_not(strong, choice) == "its gain is within what a null reaches"
    assert ranking(choice, why_not, bar=choice.bars.effect)[0].bar == pytest.approx(46 / 11)


def test_the_placebo_is_named_nowhere():
    gain = candidate("beam_gain", 9)
    fall = candidate("range_falloff", 7)
    haze = candidate("atmospheric_extinction", 6)
    gamma = candidate("gamma_response", 5)
    first = step(gain, ranking=(gain, fall, haze, gamma))
    assert runner_up((first, step(fall, haze))) is gamma
    assert runner_up(()) is None


def chosen_of(*steps, ranking=()):
    return Choice(tuple(steps), tuple(ranking), problem(), Bars())


RANDOM = candidate("random_dropout", 95.0, "drop", numbers=1)
BY_CLASS = candidate("material_dropout", 100.0, "drop", numbers=34)
GATE = candidate("range_gate", 20.0, "drop", numbers=2)


def test_a_simpler_candidate_that_gained_nearly_as_much_is_a_second_beginning():
    found = simpler_beginning(chosen_of(step(BY_CLASS, ranking=(BY_CLASS, RANDOM)), step(GATE)))
    assert found is not None
    assert (found[0], found[1].effect.name) == (0, "random_dropout")


@pytest.mark.parametrize(
    "steps",
    [
        # It is named alone: nothing came after it that it could have stood in for.
        (step(BY_CLASS, ranking=(BY_CLASS, RANDOM)),),
        (step(BY_CLASS, ranking=(BY_CLASS, candidate("random_dropout", 80.0, "drop", numbers=1))), step(GATE)),
        (step(RANDOM, ranking=(RANDOM, candidate("material_dropout", 94.0, "drop", numbers=34))), step(GATE)),
        (step(BY_CLASS, ranking=(BY_CLASS, RANDOM)), step(RANDOM)),
        (step(BY_CLASS, ranking=(BY_CLASS, candidate("range_scale", 99.0, "range", numbers=1))), step(GATE)),
    ],
    ids=["alone", "less", "not simpler", "named too", "another channel"],
)
def test_else_the_first_choice_stands(steps):
    assert simpler_beginning(chosen_of(*steps)) is None


def test_a_second_choice_holds_where_it_says_as_much_with_fewer_numbers():
    first = chosen_of(step(BY_CLASS), step(GATE))
    assert says_as_much(chosen_of(step(RANDOM), step(candidate("range_gate", 26.0, "drop", numbers=2))), first)
    assert not says_as_much(chosen_of(step(RANDOM), step(GATE)), first)
    assert not says_as_much(first, first)


def test_what_is_refused_is_passed_over_and_told(monkeypatch):
    best, next_best, weak = (
        candidate(name, each) for name, each in (("gamma_response", 8), ("beam_gain", 4), ("saturation", 0.1))
    )
    asked = []

    def rank(problem, effects):
        names = [effect.name for effect in effects]
        asked.append(names)
        return [one for one in (best, next_best, weak) if one.effect.name in names]

    monkeypatch.setattr(select, "rank_effects", rank)
    monkeypatch.setattr(select, "fitted_step", lambda problem, best, *, ranking, good: step(best, ranking=ranking))
    monkeypatch.setattr(select, "with_steps", lambda null, steps: null)
    catalogue = [one.effect for one in (best, next_best, weak)]
    whole = problem(ev=SimpleNamespace(scene=np.arange(11)))
    choice = select.choose(whole, catalogue, refuse=lambda one: one.chosen.effect.name == "gamma_response")
    assert [one.chosen.effect.name for one in choice.steps] == ["beam_gain"]
    assert choice.refused == ("gamma_response",)
    # It stays in the ranking that is told, and is not fitted again beside the others.
    assert [one.effect.name for one in choice.first_ranking] == ["gamma_response", "beam_gain", "saturation"]
    assert asked == [["gamma_response", "beam_gain", "saturation"], ["saturation"]]
