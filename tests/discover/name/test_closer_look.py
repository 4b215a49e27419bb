"""A closer look, at more columns of the same frames, where the first leaves effects undecided."""

import inspect
import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from jaxsim.discover.find.covariates import Dependence
from jaxsim.discover.find.division import Division, NullModel
from jaxsim.discover.name.answer import Answer
from jaxsim.discover.name.closer_look import believed, fulfilled, told_whole, undecided
from jaxsim.discover.name.doubts import NEGLIGIBLE
from jaxsim.discover.name.select import Choice
from jaxsim.discover.read import Comparison
from jaxsim.discover.read.control import NO_CONTROL
from jaxsim.discover.rules import RULES
from jaxsim.discover.stages import ask as stage
from jaxsim.effects import get_effect
from tests.discover.name.made import candidate, problem, step
from tests.discover.toy import toy

CATALOGUE = [get_effect(name) for name in ("beam_gain", "range_falloff")]


def answer(*chosen, last=(), curve=None, **more) -> Answer:
    steps = tuple(step(one, ranking=(*chosen, *last)) for one in chosen)
    return Answer("named" if steps else "none", Choice(steps, tuple(last), problem(), **more), None, curve=curve)


def test_candidates_that_are_left_with_some_hope_are_asked_once_more_with_those_like_them():
    weak, alike, chance = candidate("range_falloff", 0.5), candidate("gamma_response", 0.1), candidate("saturation", -1)
    assert undecided(answer(last=(chance, alike, weak))) == ("range_falloff", "gamma_response")
    # By themselves these are what chance gains.
    assert undecided(answer(last=(alike, chance))) == ()
    # Beside what is named, small errors of its law would be.
    assert undecided(answer(candidate("random_dropout", 20.0, "drop"), last=(weak,))) == ()
    # A lattice is read off, and leaves nothing.
    assert undecided(answer(candidate("range_quantization", 20.0, "range"), last=(weak,))) == ("range_falloff",)
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
    assert believed(answer(loss, bent), answer())
    assert not believed(answer(), answer())
    assert not believed(answer(bent, curve=along), answer())
    # What is left over of intensities says nothing about losses.
    assert believed(answer(loss, curve=along), answer())


def test_a_closer_look_beside_a_lattice_must_name_an_effect_and_keep_the_lattice():
    lattice, bent = candidate("intensity_quantization", 20.0), candidate("incidence_cosine", 4.0)
    assert believed(answer(lattice, bent), answer(lattice))
    assert not believed(answer(lattice), answer(lattice))
    assert not believed(answer(bent), answer(lattice))


def test_a_closer_answer_keeps_what_only_the_first_look_asked():
    loss, bent, other = candidate("random_dropout", 2.0), candidate("saturation", 0.1), candidate("range_walk", 1.0)
    first = answer(last=(other, replace(loss, gain=loss.gain / 3), bent), refused={"range_scale": NEGLIGIBLE})
    told = told_whole(answer(loss), replace(first, choice=replace(first.choice, needless=("beam_gain",))))
    assert [one.effect.name for one in told.choice.first_ranking] == ["random_dropout", "range_walk", "saturation"]
    assert told.choice.first_ranking[0].total == pytest.approx(loss.total)
    assert (told.choice.refused, told.choice.needless) == ({"range_scale": NEGLIGIBLE}, ("beam_gain",))


def asked_closer(monkeypatch, found, *, hopes: bool, lattices=()):
    """What `ask` says where the first look says none or `lattices`, and the closer one what was `found`; and what it
    asked."""
    nearer = SimpleNamespace(
        found=looking(), division=SimpleNamespace(blocks=SimpleNamespace(column=np.zeros((2, 78))))
    )
    first = SimpleNamespace(
        found=looking(), division=SimpleNamespace(control=NO_CONTROL), catalogue=CATALOGUE, closer=lambda: nearer
    )
    names: list[tuple[bool, list[str]]] = []

    def answer_of(placed, *, catalogue, **more):
        names.append((placed is nearer, [effect.name for effect in catalogue]))
        return (found if placed is nearer else answer(*lattices, last=(candidate("range_falloff", 0.5),))), ()

    for name, stub in {
        "correlations": lambda ev: None,
        "of_one_material": lambda ev: [],
        "unrelated": lambda told, one_material: None,
        "with_look_alikes": lambda effects, rays, scan: list(effects),
        "contrast_off": lambda null, choice: None,
        "answer_of": answer_of,
        "fulfilled": lambda *given, bar: hopes,
    }.items():
        monkeypatch.setattr(stage, name, stub)
    return inspect.unwrap(stage.ask)(first, nulls=0, log=lambda line: None), names, first, nearer


def looking():
    return SimpleNamespace(
        null_model=SimpleNamespace(problem=SimpleNamespace(ev=SimpleNamespace(rays=None), scan=None))
    )


@pytest.mark.parametrize("hopes", [True, False])
def test_the_closer_answer_is_taken_where_hopes_are_fulfilled_and_asks_for_these_alone(monkeypatch, hopes):
    monkeypatch.setattr(stage, "Asked", lambda *given: given)
    said, names, first, nearer = asked_closer(monkeypatch, answer(candidate("range_falloff", 3.0)), hopes=hopes)
    assert names[0] == (False, [effect.name for effect in CATALOGUE])
    assert names[1:] == ([(True, ["range_falloff"])] if hopes else [])
    assert said[0] is (nearer if hopes else first)
    assert said[2].verdict == ("named" if hopes else "none")


def test_lattices_that_the_first_look_names_are_asked_closer_with_what_is_undecided(monkeypatch):
    monkeypatch.setattr(stage, "Asked", lambda *given: given)
    lattice = candidate("range_quantization", 20.0, "range")
    monkeypatch.setattr(sys.modules[__name__], "CATALOGUE", [*CATALOGUE, lattice.effect])
    found = answer(lattice, candidate("range_falloff", 3.0))
    said, names, _, nearer = asked_closer(monkeypatch, found, hopes=True, lattices=(lattice,))
    assert names[1:] == [(True, ["range_quantization", "range_falloff"])]
    assert said[0] is nearer


@pytest.mark.long
def test_a_falloff_that_a_few_columns_leave_undecided_is_seen_on_more_of_them(standard_promotion):
    scan, measured = toy(frames=12, columns=240)
    fallen = np.where(measured.valid, measured.intensity * (np.maximum(scan.range_m, 1) / 10) ** -0.12, 0)
    names = tuple(f"{k:02d}" for k in range(12))
    comparison = Comparison(scan, replace(measured, intensity=np.clip(fallen, 0, 1).astype(np.float32)), names, names)
    division = Division.of(comparison)
    closer = division.closer()
    looked = [one.blocks.column.shape[1] for one in (division, closer)]
    assert looked == [104, 240]
    assert closer.parts == division.parts
    # There are no more columns than these.
    assert closer.closer() is closer
    falloff = [get_effect("range_falloff")]
    seen = [fulfilled(falloff, NullModel.of(one).problem, bar=RULES.bar_nats) for one in (division, closer)]
    assert seen == [False, True]
