"""What may divide an effect, of frames of two tags that follow one another."""

from dataclasses import replace

import numpy as np
import pytest

from jaxsim.discover.regimes.questions import Facts, questions
from jaxsim.discover.rules import RULES
from tests.discover.toy import toy

FRAMES, COLUMNS = 10, 60


@pytest.fixture(scope="module")
def facts():
    scan, _ = toy(frames=FRAMES, rows=4, columns=COLUMNS)
    frame = np.arange(FRAMES)
    tags = {"night": frame >= 5, "rare": frame == 0}
    column = np.broadcast_to(np.arange(0, COLUMNS, 2), (FRAMES, COLUMNS // 2))
    return Facts(replace(scan, tags=tags), tuple(f"drive {k}" for k in frame), frame, frame, column)


def test_a_tag_divides_where_enough_scenes_have_it_and_enough_do_not(facts):
    tags = [one for one in questions(facts) if one.divides == "tag"]
    assert [region.tag for one in tags for region in one.regions] == ["night"]
    np.testing.assert_array_equal(tags[0].between_scenes(facts.scene), [[*[False] * 5, *[True] * 5]])


@pytest.mark.parametrize("at_once", [1, 2], ids=["apart", "two cars recorded at once"])
def test_every_moment_leaves_enough_scenes_to_both_sides(facts, at_once):
    time_s = np.array(facts.scan.time_s)
    time_s[:at_once] = time_s[0]
    facts = replace(facts, scan=replace(facts.scan, time_s=time_s))
    asked = [one for one in questions(facts) if one.divides == "time"]
    assert len(asked) == 2
    for one in asked:
        scenes = one.between_scenes(facts.scene)
        assert scenes is not None
        assert (np.minimum(scenes.sum(1), (~scenes).sum(1)) >= RULES.regime_fewest_scenes).all()
        assert (scenes[:, :at_once] == scenes[:, :1]).all()
    # From a moment on, or until one: as many as there are cuts, each from both sides.
    assert len(asked[0].regions) == 2 * (FRAMES + 1 - 2 * RULES.regime_fewest_scenes)


def test_arcs_hold_the_sectors_of_their_azimuths(facts):
    [one] = [one for one in questions(facts) if one.divides == "azimuth"]
    assert one.between_scenes(facts.scene) is None
    azimuth = np.asarray(facts.scan.grid.azimuth_rad, float)
    sector = facts.sector[0]
    middle = np.array([azimuth[facts.column[0][sector == k]].mean() for k in range(facts.sectors)])
    for region, inside in zip(one.regions, one.inside, strict=True):
        low, high = region.azimuth_rad
        held = (middle - low) % (2 * np.pi) < high - low
        np.testing.assert_array_equal(inside[0], held)


@pytest.mark.parametrize("columns", [450, 500, 900])
def test_an_arc_holds_the_very_columns_of_the_sectors_that_it_was_asked_of(columns):
    """Of numbers of columns that the sectors do not divide: some have one column more."""
    scan, _ = toy(frames=1, rows=2, columns=columns)
    frame = np.zeros(1, int)
    facts = Facts(scan, ("drive",), frame, frame, np.arange(columns)[None])
    [one] = [one for one in questions(facts) if one.divides == "azimuth"]
    azimuth = np.asarray(scan.grid.azimuth_rad)
    for region, inside in zip(one.regions, one.inside, strict=True):
        np.testing.assert_array_equal(region.in_sector(azimuth), inside[0][facts.sector[0]])


def test_what_few_drives_differ_in_is_not_asked(facts):
    frame = np.repeat(np.arange(FRAMES), 2)
    two = tuple("drive a" if k < FRAMES // 2 else "drive b" for k in range(FRAMES))
    scene = 2 * (frame >= FRAMES // 2) + np.tile([0, 1], FRAMES)
    cut = Facts(facts.scan, two, frame, scene, facts.column[frame])
    assert cut.few_drives
    assert questions(cut) == []
    assert questions(facts)


@pytest.mark.parametrize("frames", [6, 8])
def test_frames_of_one_drive_are_divided_by_their_own_moments_however_many_its_sectors_are(facts, frames):
    """Six sectors of each frame, as blocks: a sector's number is no moment's."""
    sectors = 6
    frame, scene = np.divmod(np.arange(frames * sectors), sectors)
    column = scene[:, None] * (COLUMNS // sectors) + np.arange(COLUMNS // sectors)
    asked = [
        one for one in questions(Facts(facts.scan, ("drive",) * FRAMES, frame, scene, column)) if one.divides == "time"
    ]
    time_s = np.asarray(facts.scan.time_s)[frame]
    assert asked
    for one in asked:
        for region, inside in zip(one.regions, one.inside, strict=True):
            np.testing.assert_array_equal(inside[:, 0], region.in_time(time_s))
