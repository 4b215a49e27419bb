"""Which candidate is accepted, who is its look-alike, and when a free curve says that none is the answer."""

from dataclasses import replace

import numpy as np

from jaxsim.discover.name.select import Step
from jaxsim.discover.unpaired import select
from jaxsim.discover.unpaired.select import UnpairedChoice, _alike, choose_unpaired
from jaxsim.discover.unpaired.workflow import why_not_unpaired
from jaxsim.discover.verdict import Unexplained
from tests.discover.unpaired.made import candidate


def test_both_tests_must_be_passed():
    assert candidate("beam_gain", 3.0).accepted
    assert not candidate("beam_gain", 3.0, chance=0.02).accepted
    assert not candidate("beam_gain", -0.5).accepted


def test_a_look_alike_need_not_be_accepted_but_gains_about_as_much():
    best = candidate("beam_gain", 3.0)
    assert _alike(candidate("range_falloff", 3.0, chance=0.04), best)
    assert not _alike(candidate("range_falloff", 3.0, chance=0.06), best)
    assert not _alike(candidate("range_falloff", 1.0), best)
    assert not _alike(candidate("range_falloff", 2.5), best)  # every scene says less


def curve(name: str, gain: float):
    made = candidate("beam_gain", gain)
    return replace(made, term=replace(made.term, name=name))


def test_a_curve_must_gain_clearly_more_than_the_best_effect(monkeypatch):
    monkeypatch.setattr(select, "_described", lambda problem, one: Unexplained("intensity", one.name, "other", ""))
    monkeypatch.setattr(select, "shown_by_ground_alone", lambda problem, term: False)
    best = candidate("beam_gain", 3.0)
    choice = UnpairedChoice((Step(best, (), (best,)),), ())
    problem = object.__new__(select.Conditional)
    assert select.outside_catalogue(problem, choice, [curve("range", 5.5)], strongest_nats=1.0).covariate == "range"
    assert select.outside_catalogue(problem, choice, [curve("range", 4.0)], strongest_nats=1.0) is None
    assert select.outside_catalogue(problem, choice, [curve("range", 5.5)], strongest_nats=50.0) is None
    monkeypatch.setattr(select, "shown_by_ground_alone", lambda problem, term: True)
    assert select.outside_catalogue(problem, choice, [curve("range", 5.5)], strongest_nats=1.0) is None


def test_a_curve_along_the_rows_is_an_effect_of_the_catalogue(monkeypatch):
    monkeypatch.setattr(select, "_described", lambda problem, one: Unexplained("intensity", one.name, "other", ""))
    problem = object.__new__(select.Conditional)
    assert select.outside_catalogue(problem, UnpairedChoice((), ()), [curve("row", 9.0)], strongest_nats=0.0) is None


def test_what_gains_little_beside_the_first_effect_is_left_of_its_law(monkeypatch):
    first = candidate("near_range_overlap", 40.0)
    of_steps = {0: [first], 1: [candidate("range_falloff", 0.4)]}
    problem = object.__new__(select.Conditional)
    object.__setattr__(problem, "terms", tuple(one.term for step in of_steps.values() for one in step))
    draws = np.zeros((1, 1))
    monkeypatch.setattr(select, "beside", lambda problem, chosen: problem)
    monkeypatch.setattr(select, "shown_by_ground_alone", lambda problem, term: False)
    monkeypatch.setattr(select, "rank_terms", lambda left, rest, draws: of_steps[2 - len(rest)])
    chosen = choose_unpaired(problem, draws)
    assert [step.chosen.name for step in chosen.steps] == ["near_range_overlap"]
    of_steps[1] = [candidate("range_falloff", 4.0)]
    of_steps[2] = []
    chosen = choose_unpaired(problem, draws)
    assert [step.chosen.name for step in chosen.steps] == ["near_range_overlap", "range_falloff"]


def test_what_the_ground_alone_shows_is_not_named_nor_the_next_best_in_its_place(monkeypatch):
    ranked = [candidate("near_range_overlap", 4.0), candidate("range_falloff", 3.0)]
    problem = object.__new__(select.Conditional)
    object.__setattr__(problem, "terms", tuple(one.term for one in ranked))
    monkeypatch.setattr(select, "rank_terms", lambda left, rest, draws: ranked)
    monkeypatch.setattr(select, "shown_by_ground_alone", lambda problem, term: True)
    choice = choose_unpaired(problem, np.zeros((1, 1)))
    assert choice.steps == ()
    assert [one.of_ground for one in choice.last] == [True, False]
    assert why_not_unpaired(choice.last[0], choice).startswith("the ground alone shows it")
