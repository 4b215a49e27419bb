"""When a free curve says that none of the effects is the answer."""

from dataclasses import replace

from jaxsim.discover.name.steps import Step
from jaxsim.discover.unpaired import free_curves
from jaxsim.discover.unpaired.select import Choice
from jaxsim.discover.verdict import Unexplained
from tests.discover.unpaired.made import candidate


def curve(name: str, gain: float):
    made = candidate("beam_gain", gain)
    return replace(made, term=replace(made.term, name=name, effect=None))


def test_a_curve_must_gain_clearly_more_than_the_best_effect(monkeypatch):
    monkeypatch.setattr(free_curves, "_described", lambda problem, one: Unexplained("intensity", one.name, "other", ""))
    best = candidate("beam_gain", 3.0)
    choice = Choice((Step(best, (), (best,)),), ())
    problem = object.__new__(free_curves.Conditional)
    assert free_curves.outside_catalogue(problem, choice, [curve("range", 5.5)]).covariate == "range"
    assert free_curves.outside_catalogue(problem, choice, [curve("range", 4.0)]) is None


def test_a_curve_along_the_rows_is_an_effect_of_the_catalogue(monkeypatch):
    monkeypatch.setattr(free_curves, "_described", lambda problem, one: Unexplained("intensity", one.name, "other", ""))
    problem = object.__new__(free_curves.Conditional)
    assert free_curves.outside_catalogue(problem, Choice((), ()), [curve("row", 9.0)]) is None
