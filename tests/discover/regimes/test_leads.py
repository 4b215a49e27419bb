"""Which regions are looked at, and for which effects."""

import inspect
from dataclasses import replace
from types import SimpleNamespace

import numpy as np

from jaxsim.discover.regimes import leads
from jaxsim.discover.regimes.cells import Cells
from jaxsim.discover.regimes.chance import FoundRegion
from tests.discover.name.made import candidate


def test_beams_that_change_smoothly_are_not_what_is_divided(monkeypatch):
    beams = replace(candidate("beam_range_bias", 31.0, "range"), over_smooth=np.zeros(11))
    offset = candidate("range_offset", 26.0, "range")
    monkeypatch.setattr(leads, "disputed", lambda tried, asked, facts: [])
    asked_of = []
    monkeypatch.setattr(leads, "_divisions", lambda effect, *_, **__: asked_of.append(effect.name) or [])
    choice = SimpleNamespace(first_ranking=(beams, offset), refused={}, steps=(), bars=SimpleNamespace(effect=1e9))
    of_candidates = inspect.unwrap(leads.of_candidates)
    assert of_candidates(None, choice, facts=None, asked=()) == []
    assert asked_of == ["range_offset"]
    # Rough numbers of beams are, and so is what a smooth change explains where there is nothing else.
    rough = replace(beams, over_smooth=np.full(11, 5.0) + 0.1 * np.arange(11))
    of_candidates(None, SimpleNamespace(**{**vars(choice), "first_ranking": (rough, offset)}), facts=None, asked=())
    of_candidates(None, SimpleNamespace(**{**vars(choice), "first_ranking": (beams,)}), facts=None, asked=())
    assert asked_of == ["range_offset", "beam_range_bias", "range_offset", "beam_range_bias"]
    # Beams that a few drives alone have rough are what these drives dispute, though the scenes do not agree on it.
    disputed = replace(beams, over_smooth=np.where(np.arange(11) < 4, 30.0, -2.0))
    assert disputed.smooth_is_enough
    of_candidates(None, SimpleNamespace(**{**vars(choice), "first_ranking": (disputed, offset)}), facts=None, asked=())
    assert asked_of[-2:] == ["beam_range_bias", "range_offset"]


def test_drives_are_asked_of_every_candidate_that_exists_and_arcs_of_weak_ones_too(monkeypatch):
    """Haze in a third of the drives: over all of them a turn of less than a mrad gains as much."""
    turn = candidate("extrinsic_rotation", 18.0, "range")
    haze = candidate("atmospheric_extinction", 17.0, "intensity")
    nothing = candidate("window_contamination", 0.1, "intensity")
    monkeypatch.setattr(leads, "disputed", lambda tried, asked, facts: [])
    asked_of = []

    def divisions(effect, result, problem, *, facts, asked, facts_asked):
        asked_of.append((effect.name, len(asked)))
        drives = SimpleNamespace(between_scenes=lambda scene: np.ones((1, 11), bool))
        return [FoundRegion(part, 0, 0.01) for part in (sectors, drives)]

    monkeypatch.setattr(leads, "_divisions", divisions)
    sectors = SimpleNamespace(between_scenes=lambda scene: None)
    bars = SimpleNamespace(effect=10.0)
    choice = SimpleNamespace(first_ranking=(turn, haze, nothing), refused={}, steps=(), bars=bars)
    facts = SimpleNamespace(scene=None)
    found = inspect.unwrap(leads.of_candidates)(None, choice, facts=facts, asked=[sectors])
    assert asked_of == [("extrinsic_rotation", 1), ("atmospheric_extinction", 1), ("window_contamination", 1)]
    whole = (turn, haze, nothing)
    orders = [whole, whole, (haze, turn, nothing), (haze, turn, nothing), (nothing, turn, haze)]
    assert [lead.candidates for lead in found] == orders
    # What drives do not show at all they do not dispute; arcs that all of them have may show it.
    assert found[-1].finding.question is sectors
    assert all(lead.exists for lead in found)
    # Of the strongest alone all scenes may have a part that is nothing over all of them.
    weak = SimpleNamespace(**{**vars(choice), "first_ranking": (nothing,)})
    found = inspect.unwrap(leads.of_candidates)(None, weak, facts=facts, asked=[sectors])
    assert [lead.exists for lead in found] == [True, False]


def test_rivals_in_some_drives_are_those_that_gain_most_there_forwards_or_back(monkeypatch):
    """Biases of beams that half of the drives have are nearly nothing to all of them together, or their opposite."""
    drives, sectors = 11, 4
    inside = np.arange(drives) < 5
    first = candidate("beam_elevation_error", 20.0, "range")
    wave = candidate("cyclic_range_error", 15.0, "range")
    walk = candidate("range_walk", 9.0, "range")
    turn = candidate("extrinsic_rotation", 8.0, "range")
    bias = candidate("beam_range_bias", -5.0, "range")
    slopes = {"cyclic_range_error": 3.0, "range_walk": 1.0, "extrinsic_rotation": 2.0, "beam_range_bias": -30.0}

    def cells_of(effect, problem, result, *, sector, sectors):
        curvature = np.ones((drives, sectors))
        return Cells(np.where(inside[:, None], slopes[effect.name], 0.0) - curvature, curvature, curvature)

    monkeypatch.setattr(leads, "cells_of", cells_of)
    rivals = inspect.unwrap(leads.rivals)
    facts = SimpleNamespace(scene=None, sector=None, sectors=sectors)

    def lead(whole):
        question = SimpleNamespace(between_scenes=lambda scene: whole, inside=inside[None, :, None])
        return SimpleNamespace(candidates=(first, wave, walk, turn, bias), finding=FoundRegion(question, 0, 0.01))

    assert rivals(lead(inside[None]), None, facts) == (bias, wave, turn)
    assert rivals(lead(None), None, facts) == (wave, walk, turn)


def test_drives_told_by_their_readings_are_told_by_a_tag_where_it_divides_them_just_so():
    facts = SimpleNamespace(scene=None)
    as_frames_say = inspect.unwrap(leads._as_frames_say)

    def divided_by(divides, *scenes):
        whole = np.stack([np.isin(np.arange(6), one) for one in scenes])
        return SimpleNamespace(divides=divides, between_scenes=lambda scene: whole)

    by_size = FoundRegion(divided_by("scene", [1, 3, 4]), 0, 0.002)
    tags = [divided_by("tag", [0, 1, 3]), divided_by("tag", [0, 2], [1, 3, 4])]
    assert as_frames_say(by_size, tags, facts) == FoundRegion(tags[1], 1, 0.002)
    assert as_frames_say(by_size, tags[:1], facts) is by_size
