"""A comparison with the sensor where it stands: divided, with what is known in place, and what is left over found."""

import numpy as np
import pytest

from jaxsim.discover.find.division import NOTHING_YET
from jaxsim.discover.mounting.constant import Mounting
from jaxsim.discover.read import Comparison
from jaxsim.discover.stages.place import place
from jaxsim.effects import get_effect
from tests.discover.rooms import comparison
from tests.discover.toy import toy

pytestmark = [pytest.mark.long, pytest.mark.usefixtures("standard_promotion")]


def test_what_is_known_is_in_place_and_what_it_does_not_explain_is_found(stages):
    placed = stages.placed
    assert placed.mounting.known.names == ("random_dropout",)
    assert placed.found.null_model.known == placed.mounting.known
    assert "range" in {one.channel for one in placed.found.single}
    assert [effect.name for effect in placed.catalogue] == ["range_offset", "incidence_cosine"]
    assert placed.of_drive.effects == ()


def test_with_free_contrast_all_is_found_again_beside_it(stages):
    free = stages.placed.with_free_contrast()
    assert free.division.simulator.free_contrast
    assert not stages.placed.division.simulator.free_contrast
    assert free.division.parts == stages.placed.division.parts
    assert (
        free.found.null_model.problem.ev.features.shape[-1]
        > stages.placed.found.null_model.problem.ev.features.shape[-1]
    )


def test_few_drives_that_are_too_narrow_for_sectors_are_refused():
    scan, measured = toy(frames=4)
    names = tuple("abcd")
    with pytest.raises(ValueError, match="frames of 1 drive, of 60 columns, are too narrow"):
        place(Comparison(scan, measured, names, ("drive",) * 4), [get_effect("beam_gain")], NOTHING_YET, log=print)


def test_progress_tells_how_scenes_are_divided():
    scan, measured = toy(frames=10)
    names = tuple(f"{k}" for k in range(10))
    lines: list[str] = []
    placed = place(Comparison(scan, measured, names, names), [], NOTHING_YET, log=lines.append)
    assert lines == [f"7 scenes to find with, 3 to judge on: split {placed.division.parts.sha256}"]
    assert np.unique(placed.division.blocks.scene).tolist() == sorted(names)


def test_a_lift_that_a_finer_look_does_not_find_is_asked_like_all_others(monkeypatch):
    lifted = comparison(np.zeros(6), lift=0.0087)
    asked = [get_effect("beam_elevation_error"), get_effect("beam_gain")]
    given = place(lifted, asked, NOTHING_YET, log=str)
    assert given.mounting.effects == ("beam_elevation_error",)
    assert [effect.name for effect in given.catalogue] == ["beam_gain"]
    monkeypatch.setattr(
        "jaxsim.discover.stages.place.refine_lift",
        lambda comparison, mounting, null, *, known: Mounting((), comparison, known),
    )
    finer = place(lifted, asked, NOTHING_YET, log=str)
    assert finer.mounting.effects == ()
    assert [effect.name for effect in finer.catalogue] == ["beam_elevation_error", "beam_gain"]
