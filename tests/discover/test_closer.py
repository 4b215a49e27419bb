"""A closer look, at more columns of the same frames, where the first leaves effects undecided."""

from dataclasses import replace

import numpy as np
import pytest

from jaxsim.discover.ask import ask
from jaxsim.discover.closer import finds_more, told_whole, undecided
from jaxsim.discover.covariates import Dependence
from jaxsim.discover.division import NOTHING_YET
from jaxsim.discover.name.answer import Answer
from jaxsim.discover.name.doubts import NEGLIGIBLE
from jaxsim.discover.name.select import Choice
from jaxsim.discover.place import place
from jaxsim.discover.read import Comparison
from jaxsim.discover.rules import RULES
from jaxsim.effects import get_effect
from tests.discover.name.made import candidate, problem, step
from tests.discover.toy import toy

ROAD = 7


def answer(*chosen, last=(), curve=None, **more) -> Answer:
    steps = tuple(step(one, ranking=(*chosen, *last)) for one in chosen)
    return Answer("named" if steps else "none", Choice(steps, tuple(last), problem(), **more), None, curve=curve)


def test_candidates_that_are_left_with_some_hope_are_asked_once_more_with_those_like_them():
    weak, alike, chance = candidate("range_falloff", 0.5), candidate("gamma_response", 0.1), candidate("saturation", -1)
    assert undecided(answer(last=(chance, alike, weak))) == ("range_falloff", "gamma_response")
    # By themselves these are what chance gains.
    assert undecided(answer(last=(alike, chance))) == ()
    assert 11 * 0.1 < RULES.closer_nats < 11 * 0.5


def test_what_was_refused_or_goes_by_edges_stays_so_and_beams_that_a_smooth_change_explains_have_no_hope():
    weak = candidate("range_scale", 0.5, "range")
    assert undecided(answer(last=(weak,), refused={"range_scale": NEGLIGIBLE})) == ()
    gains = replace(candidate("beam_gain", 9.0), over_smooth=np.full(11, -0.5))
    assert undecided(answer(last=(gains,))) == ()
    # Beams that point a little elsewhere do the same at edges.
    assert undecided(answer(last=(candidate("mixed_pixels", 0.5, "range"),))) == ()


def test_a_closer_look_is_believed_where_it_leaves_nothing_over_of_what_it_names():
    loss, bent = candidate("random_dropout", 20.0, "drop"), candidate("incidence_cosine", 4.0)
    along = Dependence("intensity", "intensity", 0.01, 0.1, 50.0), candidate("curve", 3.0)
    assert finds_more(answer(loss, bent), answer(loss))
    assert not finds_more(answer(loss), answer(loss))
    assert not finds_more(answer(bent, curve=along), answer())
    # What is left over of intensities says nothing about losses.
    assert finds_more(answer(loss, curve=along), answer())


def test_a_closer_answer_keeps_what_only_the_first_look_asked():
    loss, bent, other = candidate("random_dropout", 2.0), candidate("saturation", 0.1), candidate("range_walk", 1.0)
    first = answer(last=(other, replace(loss, gain=loss.gain / 3), bent), refused={"range_scale": NEGLIGIBLE})
    told = told_whole(answer(loss), replace(first, choice=replace(first.choice, needless=("beam_gain",))))
    assert [one.effect.name for one in told.choice.first_ranking] == ["random_dropout", "range_walk", "saturation"]
    assert told.choice.first_ranking[0].total == pytest.approx(loss.total)
    assert (told.choice.refused, told.choice.needless) == ({"range_scale": NEGLIGIBLE}, ("beam_gain",))


@pytest.mark.long
def test_losses_that_a_few_columns_cannot_show_are_named_from_more_of_them(standard_promotion):
    """Of the road, and of nothing else, two rays in a hundred are lost."""
    scan, measured = toy(frames=12, columns=360)
    lost = (np.random.default_rng(1).random(measured.valid.shape) < 0.018) & (np.asarray(scan.semantic) == ROAD)
    valid = measured.valid & ~lost
    measured = replace(
        measured,
        valid=valid,
        range_m=np.where(valid, measured.range_m, 0),
        intensity=np.where(valid, measured.intensity, 0),
    )
    names = tuple(f"{k:02d}" for k in range(12))
    lines: list[str] = []
    catalogue = [get_effect("random_dropout")]
    first = place(Comparison(scan, measured, names, names), catalogue, NOTHING_YET, log=lines.append)
    asked = ask(first, nulls=0, log=lines.append)
    assert any(line.startswith("undecided: random_dropout; asked once more") for line in lines)
    assert [one.chosen.effect.name for one in asked.answer.choice.steps] == ["random_dropout"]
    looked = [placed.division.blocks.column.shape[1] for placed in (first, asked.placed)]
    assert looked[1] == 3 * looked[0]
    assert asked.placed.division.parts == first.division.parts
