"""Which candidates are chosen, which stand beside them, and which are taken back."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from jaxsim.discover.name import select
from jaxsim.discover.name.candidates import Candidate
from jaxsim.discover.name.select import (
    Bars,
    Choice,
    choose,
    much_richer,
    needless,
    runner_up,
    says_as_much,
    simpler_beginning,
    simplest,
    too_rich,
    worse,
)
from jaxsim.discover.rules import RULES
from jaxsim.discover.show.explain import ranking, why_not
from jaxsim.effects import EFFECTS
from tests.discover.name.made import candidate, problem, step


def test_more_numbers_must_gain_more():
    assert too_rich(candidate("random_dropout", 20.0, numbers=4), candidate("random_dropout", 20.0, numbers=1))
    assert not too_rich(candidate("random_dropout", 22.0, numbers=4), candidate("random_dropout", 20.0, numbers=1))
    assert not too_rich(candidate("random_dropout", 20.0, numbers=1), candidate("random_dropout", 20.0, numbers=4))


def test_one_number_more_is_another_law_and_many_are_none():
    best = candidate("fog_backscatter", 20.0, numbers=3)
    assert not much_richer(candidate("precipitation_clutter", 20.0, numbers=4), best)
    assert much_richer(candidate("material_dropout", 20.0, numbers=5), best)
    assert not much_richer(candidate("material_dropout", 22.0, numbers=5), best)


def test_of_those_that_gain_as_much_the_one_with_the_fewest_numbers_is_chosen():
    rich, plain = candidate("snr_dropout", 3.7, "drop", numbers=4), candidate("random_dropout", 3.6, "drop", numbers=1)
    assert simplest([rich, plain]) is plain
    better = candidate("snr_dropout", 4.0, "drop", numbers=4)
    assert simplest([better, plain]) is better
    # Of another channel it says something else; and of two numbers alike the larger gain counts.
    elsewhere = candidate("gamma_response", 3.6, numbers=1)
    assert simplest([rich, elsewhere]) is rich
    assert simplest([candidate("snr_dropout", 3.61, "drop", numbers=1), plain]).effect.name == "snr_dropout"


def test_worse_is_what_gains_clearly_less_or_less_in_every_scene():
    best = candidate("beam_gain", 10.0)
    assert worse(candidate("saturation", 7.0), best)
    assert worse(candidate("saturation", 9.0), best)
    assert not worse(candidate("saturation", 10.0 + np.array([1, -1] * 5 + [0])), best)


def test_a_look_alike_may_lie_below_the_bar_that_the_best_hardly_passes(monkeypatch):
    monkeypatch.setattr(select, "fit", lambda effect, *args, **kwargs: candidate(effect.name, 0.0).fits[0])
    monkeypatch.setattr(Candidate, "fitted_values", ())
    to_and_fro = 0.3 * np.array([1, -1] * 5 + [0])
    best = candidate("range_falloff", (RULES.bar_nats + 0.9) / 11 + np.zeros(11))
    near = candidate("atmospheric_extinction", (RULES.bar_nats - 0.5) / 11 + to_and_fro)
    torn = candidate("intensity_offset", (RULES.bar_nats - 0.5) / 11 + 20 * to_and_fro)
    less = candidate("gamma_response", 0.5 * RULES.bar_nats / 11 + to_and_fro)
    assert [one.accepted() for one in (best, near)] == [True, False]
    assert [one.scenes_agree for one in (near, torn)] == [True, False]
    every = [best, near, torn, less]
    said = select.fitted_step(problem(), best, ranking=every, among=every)
    assert [one.effect.name for one in said.alike] == ["atmospheric_extinction"]
    # What was refused, or goes by something else, is not asked to stand in for it.
    assert not select.fitted_step(problem(), best, ranking=every, among=[best, torn, less]).alike


def test_an_early_effect_that_the_others_make_needless_is_found(monkeypatch):
    again = {"gamma_response": 9.0, "range_falloff": 0.1, "beam_gain": 9.0}
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
    steps = [step(candidate(name, 9.0)) for name in again]
    assert needless(problem(), steps, Bars(), log=lines.append) == 1
    assert beside == [["range_falloff", "beam_gain"], ["gamma_response", "beam_gain"]]
    assert lines == ["range_falloff is not needed beside the others: 1 nats"]
    again["range_falloff"] = 9.0
    assert needless(problem(), steps, Bars()) is None


@pytest.mark.parametrize(("left", "gone"), [(8.0, None), (3.0, 0)])
def test_an_effect_that_gains_most_of_what_it_did_is_needed_though_scenes_agree_less(left, gone, monkeypatch):
    """A car that moves in some scenes alone, beside readings at edges: slow scenes lose a little."""
    disputed = left * np.array([3, 3, 3, 2, 2, 2, 2, -1, -1, -1, -1.5])
    monkeypatch.setattr(select, "with_steps", lambda null, steps: null)
    monkeypatch.setattr(select, "together", lambda null, steps: list(steps))
    monkeypatch.setattr(
        select, "rank_effects", lambda problem, effects: [candidate("motion_distortion", disputed, "range")]
    )
    steps = [step(candidate("motion_distortion", 9.0, "range")), step(candidate("mixed_pixels", 5.0, "range"))]
    [again] = select.rank_effects(None, ())
    assert not again.accepted(RULES.bar_nats)
    assert needless(problem(), steps, Bars()) == gone


def test_what_came_after_an_effect_that_is_gone_is_chosen_once_more_without_it(monkeypatch):
    """Losses of faint echoes stand in for losses at random and a gate, of which they leave a number a class to mend."""
    alone = {"snr_dropout": 90.0, "material_dropout": 85.0, "random_dropout": 84.0, "range_gate": 30.0}
    # What each gains beside others; 0.1 where they say it already.
    beside = {
        ("range_gate", ("snr_dropout",)): 20.0,
        ("material_dropout", ("range_gate", "snr_dropout")): 15.0,
        ("range_gate", ("material_dropout",)): 28.0,
        ("range_gate", ("random_dropout",)): 29.0,
        ("material_dropout", ("range_gate",)): 80.0,
        ("random_dropout", ("range_gate",)): 80.0,
        ("range_gate", ("material_dropout", "snr_dropout")): 20.0,
    }
    numbers = {"material_dropout": 34, "random_dropout": 1}
    asked = []

    def rank(place, effects):
        names = [effect.name for effect in effects]
        asked.append((place, names))
        gains = {name: beside.get((name, place), 0.1) if place else alone[name] for name in names}
        made = [candidate(name, gains[name], "drop", numbers=numbers.get(name, 2)) for name in names]
        return sorted(made, key=lambda one: -one.total)

    named = lambda steps: tuple(sorted(one.chosen.effect.name for one in steps))  # noqa: E731
    monkeypatch.setattr(select, "rank_effects", lambda place, effects, **_: rank(place.scan, list(effects)))
    monkeypatch.setattr(select, "fitted_step", lambda place, best, *, ranking, among: step(best, ranking=ranking))
    monkeypatch.setattr(select, "with_steps", lambda null, steps: problem(scan=named(steps)))
    monkeypatch.setattr(select, "together", lambda null, steps: list(steps))
    choice = choose(problem(scan=()), [EFFECTS[name] for name in alone])
    assert [one.chosen.effect.name for one in choice.steps] == ["random_dropout", "range_gate"]
    assert choice.steps[1].chosen.by_scene[0] == 29.0
    # The first ranking is told whole, and computed once.
    assert [one.effect.name for one in choice.first_ranking] == list(alone)
    assert [place for place, names in asked if names == list(alone)] == [()]
    # Whoever asks why the best alone is not named is told.
    assert choice.needless == ("snr_dropout",)
    assert why_not(choice.first_ranking[0], choice) == "what is named explains what it does, and more"


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

    def rank(problem, effects, **_):
        names = [effect.name for effect in effects]
        asked.append(names)
        return [one for one in (best, next_best, weak) if one.effect.name in names]

    monkeypatch.setattr(select, "rank_effects", rank)
    monkeypatch.setattr(select, "fitted_step", lambda problem, best, *, ranking, among: step(best, ranking=ranking))
    monkeypatch.setattr(select, "with_steps", lambda null, steps: null)
    catalogue = [one.effect for one in (best, next_best, weak)]
    whole = problem(ev=SimpleNamespace(scene=np.arange(11)))
    choice = select.choose(
        whole, catalogue, refuse=lambda one, beside: "noise" * (one.chosen.effect.name == "gamma_response")
    )
    assert [one.chosen.effect.name for one in choice.steps] == ["beam_gain"]
    assert choice.refused == {"gamma_response": "noise"}
    # It stays in the ranking that is told, and is not fitted again beside the others.
    assert [one.effect.name for one in choice.first_ranking] == ["gamma_response", "beam_gain", "saturation"]
    assert asked == [["gamma_response", "beam_gain", "saturation"], ["saturation"]]


def test_a_weak_effect_is_no_weaker_an_answer_than_a_free_curve_along_what_it_goes_by(monkeypatch):
    """A laser that fades makes some streets as dark as a gamma would, and others not."""
    monkeypatch.setattr(select, "fitted_step", lambda problem, best, *, ranking, among: step(best, ranking=ranking))
    gamma = candidate("gamma_response", np.array([-52, 18, 46, 51, 13, 53, 26, 10, -167, 50, 16]))
    drift = candidate("emitter_drift", 4.0)
    choice = Choice((), (gamma, drift), problem())
    assert select.first_step(choice.problem, choice.first_ranking, choice.bars) is None
    along = select.step_along(choice, "intensity", "frame")
    assert along.chosen is drift
    # Nothing else is a free curve's answer, nor what was refused, nor is there one where effects are named.
    assert select.step_along(choice, "intensity", "range") is None
    assert select.step_along(choice, "range", "frame") is None
    assert select.step_along(replace(choice, refused={"emitter_drift": "noise"}), "intensity", "frame") is None
    assert select.step_along(replace(choice, steps=(step(gamma),)), "intensity", "frame") is None
