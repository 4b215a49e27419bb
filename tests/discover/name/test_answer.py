"""Which answer is given."""

from dataclasses import replace
from functools import partial

import pytest

from jaxsim.discover.find.covariates import Dependence
from jaxsim.discover.name import answer
from jaxsim.discover.name.candidates import Candidate
from jaxsim.discover.name.doubts import Doubts
from jaxsim.discover.name.other_sides import CONTROL, EXCHANGED
from jaxsim.discover.name.select import Choice
from jaxsim.discover.verdict import Unexplained
from tests.discover.name.made import CHANNEL, candidate, problem, showing, step

NUMBERS = 36
"""Of each free curve here."""
PIECES = "saturation", "near_range_overlap"
DEPENDENCE = {name: Dependence(name, "range", 0.01, 0.1, 50.0) for name in CHANNEL}


@pytest.fixture
def curve_of(monkeypatch):
    """Lets the fits find one free curve, and nothing else: problems of these tests hold no rays that would tell."""

    def given(channel: str, curve):
        monkeypatch.setattr(answer, "free_curves", lambda *_, **__: [(DEPENDENCE[channel], curve)])

    told = Unexplained("", "range", "other", "")
    monkeypatch.setattr(answer, "curve_numbers", lambda *_: NUMBERS)
    monkeypatch.setattr(answer, "describe_curve", lambda problem, along, _: replace(told, channel=along.channel))
    monkeypatch.setattr(answer, "dependences_of", lambda *_: [])
    return given


@pytest.mark.parametrize(
    ("named", "curve", "outside"),
    [
        ([], candidate("curve", 5), True),
        # A number a beam is no rival of two numbers that say as much: these need not gain a tenth more.
        ([candidate("beam_gain", 8, numbers=72)], candidate("curve", 9), False),
        ([candidate("beam_gain", 8, numbers=73)], candidate("curve", 9), True),
        ([candidate("beam_gain", 8, numbers=73)], candidate("curve", 8.9), False),
        ([candidate("beam_gain", 8)], candidate("curve", 5), False),
        ([candidate("beam_gain", 3)], candidate("curve", 8), True),
        # A gain within a tenth of what is named, or a few nats more, is none.
        ([candidate("beam_gain", 8)], candidate("curve", 8.5), False),
        # What a lattice of readings gains is no dependence that a curve would have to beat.
        ([candidate("intensity_quantization", 4000)], candidate("curve", 8), True),
    ],
)
def test_a_curve_outdoes_only_what_it_explains_clearly_better(named, curve, outside):
    choice = Choice(tuple(map(step, named)), (), problem())
    assert answer.outdone(choice, DEPENDENCE["intensity"], curve, numbers=NUMBERS) is outside


@pytest.mark.parametrize(
    ("named", "leaves", "whole"),
    [
        ([candidate("gamma_response", 8), *map(candidate, PIECES, (1, 1))], True, False),
        # Two are no pieces, nor are effects of other channels; and what still says something beside the curve is there.
        ([candidate("gamma_response", 8), candidate("saturation", 2)], True, True),
        ([*map(candidate, PIECES, (8, 1)), candidate("random_dropout", 1, "drop")], True, True),
        ([candidate("gamma_response", 8), *map(candidate, PIECES, (1, 1))], False, True),
        ([candidate("gamma_response", 18), *map(candidate, PIECES, (1, 1))], True, True),
    ],
)
def test_three_effects_that_one_curve_leaves_nothing_to_say_are_its_pieces(named, leaves, whole, monkeypatch, curve_of):
    curve_of("intensity", candidate("curve", 8))
    monkeypatch.setattr(answer, "named_answer", lambda choice, **_: answer.Answer("named", choice, None))
    monkeypatch.setattr(answer, "with_steps", lambda null, steps: problem())
    said = answer.decide(
        problem(),
        Choice(tuple(map(step, named)), (), problem()),
        [],
        beside=lambda found, effects, bar: [candidate(e.name, 0.0 if leaves else 8.0) for e in effects],
    )
    assert (len(said.choice.steps) == len(named)) is whole


@pytest.mark.parametrize(("of_range", "stays"), [(30.0, True), (2.0, False)])
def test_an_effect_of_several_channels_stays_where_a_curve_explains_the_least_of_them(of_range, stays):
    """A car in motion moves readings, and a little of what is bright."""
    moved = candidate("motion_distortion", 5.0)
    gain = moved.gain.copy()
    gain[:, CHANNEL["range"]] = of_range
    assert answer.stands(step(replace(moved, gain=gain)), "intensity") is stays
    assert answer.stands(step(replace(moved, gain=gain)), "range") is not stays


def test_a_curve_of_one_channel_leaves_what_is_named_in_another(monkeypatch, curve_of):
    curve_of("drop", candidate("curve", 9, "drop"))
    null, both = problem(), problem()
    one = problem()
    refitted = []
    monkeypatch.setattr(answer, "with_steps", lambda null, steps: refitted.append(len(steps)) or one)
    gain = step(candidate("beam_gain", 8))
    lost = step(candidate("random_dropout", 2, "drop"))
    said = answer.decide(null, Choice((gain, lost), (), both), [])
    assert said.verdict == "named"
    assert [step.chosen.effect.name for step in said.choice.steps] == ["beam_gain"]
    assert said.unexplained
    assert said.unexplained.channel == "drop"
    assert said.choice.problem is one
    assert refitted == [1]
    said = answer.decide(null, Choice((lost,), (), both, refused={"gamma_response": "noise"}), [])
    assert (said.verdict, said.choice.steps) == ("not_in_catalogue", ())
    assert said.choice.refused == {"gamma_response": "noise"}
    assert said.unexplained
    assert said.unexplained.channel == "drop"
    assert said.choice.problem is null


def test_a_curve_leaves_a_lattice_of_its_channel_named(monkeypatch, curve_of):
    """It was read off the readings; beside it the curve is told, and what else bends the intensity is not named."""
    curve_of("intensity", candidate("curve", 9))
    both, one = problem(), problem()
    monkeypatch.setattr(answer, "with_steps", lambda null, steps: one)
    lattice, weak = step(candidate("intensity_quantization", 4000)), step(candidate("beam_gain", 3))
    for steps, remains in (((lattice,), both), ((lattice, weak), one)):
        said = answer.decide(problem(), Choice(steps, (), both), [])
        assert said.verdict == "named"
        assert [step.chosen.effect.name for step in said.choice.steps] == ["intensity_quantization"]
        assert said.unexplained
        assert said.choice.problem is remains


def test_a_curve_that_other_sides_show_is_not_asked_again(monkeypatch, curve_of):
    curve_of("intensity", candidate("curve", 9))
    whole = problem()
    monkeypatch.setattr(answer, "choose", lambda *_, **__: Choice((), (), whole))
    others = [partial(showing, why=EXCHANGED, all_curves=False), partial(showing, why=CONTROL, all_curves=True)]
    said = answer.name_effects(whole, [], [], doubts=Doubts(others))
    assert said.verdict == "none"
    assert said.elsewhere == (("intensity along range", CONTROL),)
    assert answer.name_effects(whole, [], []).verdict == "not_in_catalogue"
    # Nor is one that is not to be asked at all, and nothing is said of it.
    unasked = answer.name_effects(whole, [], [], unasked=[("intensity", "range")])
    assert (unasked.verdict, unasked.elsewhere) == ("none", ())
    # Nor where effects are confined to a part later.
    assert said.unasked == unasked.unasked == (("intensity", "range"),)


@pytest.mark.parametrize(("each", "verdict"), [(8.5, "named"), (3, "not_in_catalogue")])
def test_what_goes_by_a_free_curves_covariate_is_named_unless_the_curve_says_more(each, verdict, monkeypatch, curve_of):
    curve_of("intensity", candidate("curve", 9))
    whole = problem()
    fall = step(candidate("range_falloff", each))
    monkeypatch.setattr(answer, "choose", lambda *_, **__: Choice((), (fall.chosen,), whole))
    monkeypatch.setattr(answer, "step_along", lambda choice, *along: fall if along == ("intensity", "range") else None)
    monkeypatch.setattr(answer, "add_steps", lambda null, catalogue, begun, **_: Choice(tuple(begun), (), whole))
    monkeypatch.setattr(Candidate, "size", 1.0)
    monkeypatch.setattr(Doubts, "against", lambda *_, **__: "")
    said = answer.name_effects(whole, [], [])
    assert said.verdict == verdict
    assert [one.chosen.effect.name for one in said.choice.steps] == ["range_falloff"] * (verdict == "named")


@pytest.mark.parametrize(("why", "verdict"), [(CONTROL, "none"), (EXCHANGED, "named")])
def test_an_effect_that_says_less_than_what_the_simulator_lacks_by_itself_is_part_of_that(
    monkeypatch, curve_of, why, verdict
):
    whole = problem()
    weak = Choice((step(candidate("beam_gain", 3)),), (), whole)
    curve_of("intensity", candidate("curve", 9))
    monkeypatch.setattr(answer, "choose", lambda *_, **__: weak)
    monkeypatch.setattr(answer, "named_answer", lambda choice, **_: answer.Answer("named", choice, None))
    others = [partial(showing, why=why, all_curves=True)]
    said = answer.name_effects(whole, [], [], doubts=Doubts(others))
    assert said.verdict == verdict
    assert len(said.choice.steps) == (verdict == "named")


@pytest.mark.parametrize(("steps", "verdict"), [((), "none"), ((step(candidate("beam_gain", 8)),), "named")])
def test_without_a_curve_that_is_not_confirmed_the_rest_stays(steps, verdict):
    curve = (DEPENDENCE["intensity"], candidate("curve", 9))
    found = answer.Answer(
        "not_in_catalogue",
        Choice(steps, (), problem()),
        unexplained=Unexplained("intensity", "range", "other", ""),
        curve=curve,
    )
    left = answer.without_curve(found)
    assert (left.verdict, left.unexplained, left.curve) == (verdict, None, None)
    assert left.choice is found.choice
    assert left.unconfirmed == ("intensity along range",)
    assert answer.without_curve(left) is left


@pytest.mark.parametrize(
    ("covariates", "beside", "stays"),
    [
        (("row",), 8.0, True),
        # What goes by the curve's covariate is its nearest law, what goes by materials is of those that the simulator
        # has wrong, and what the curve says most of is no more than that.
        (("row", "range"), 8.0, False),
        (("incidence",), 8.0, False),
        (("row",), 3.0, False),
    ],
)
def test_an_effect_that_a_stronger_curve_says_nothing_of_stays_named(covariates, beside, stays, monkeypatch, curve_of):
    """A simulator without texture, of which colours tell, hides no fog."""
    curve_of("intensity", candidate("curve", 90))
    monkeypatch.setattr(answer, "named_answer", lambda choice, **_: answer.Answer("named", choice, None))
    monkeypatch.setattr(answer, "with_steps", lambda null, steps: problem())
    named = candidate("gamma_response", 8)
    named = replace(named, effect=replace(named.effect, covariates=covariates))
    asked = []

    def ranked(found, effects, bar):
        asked.extend(effects)
        return [candidate(effect.name, beside) for effect in effects]

    said = answer.decide(problem(), Choice((step(named),), (), problem()), [], beside=ranked)
    assert said.verdict == ("named" if stays else "not_in_catalogue")
    # To fit the law costs seconds.
    assert bool(asked) is (covariates == ("row",))
