"""The entries of a verdict."""

from jaxsim.discover.name.steps import Step
from jaxsim.discover.unpaired.explain import named_by_losses, ranking, sensor_of, why_not
from jaxsim.discover.unpaired.lost import Loss, Losses
from jaxsim.discover.unpaired.select import Choice
from jaxsim.discover.verdict import Interval
from tests.discover.unpaired.made import candidate


def test_a_ranking_says_why_not():
    best = candidate("beam_gain", 3.0)
    by_chance = candidate("range_falloff", 1.0, chance=0.5)
    choice = Choice((Step(best, (), (best, by_chance)),), ())
    assert why_not(best, choice) == ""
    assert "scenes exchanged between the sides reach as much (p 0.5, must be 0.01)" in why_not(by_chance, choice)
    assert [rank.name for rank in ranking(choice)] == ["beam_gain", "range_falloff"]


def test_a_loss_becomes_an_entry_and_a_part_of_the_sensor():
    probability = Interval(0.1, 0.08, 0.12, "1")
    loss = Loss("random_dropout", 0.001, {"probability": probability}, Interval(0.11, 0.1, 0.12, "share of rays"))
    named = named_by_losses(Losses((loss,), ()))
    assert (named[0].name, named[0].channels, named[0].gain.unit) == ("random_dropout", ("drop",), "share of rays")
    assert sensor_of(named).effects == (("random_dropout", {"probability": 0.1}),)
