"""Which frames a run learned from is told by their names."""

import json
from pathlib import Path

import pytest

from jaxsim.runs.frames import (
    RunFrames,
    change,
    check_frames,
    judges_of,
    positions_of,
    read_frames,
    shared_frames,
    write_frames,
)


class Drives:
    """A data set of two frames a drive."""

    def __init__(self, *drives: str):
        self.names = [f"{drive}-{k}" for drive in drives for k in range(2)]
        self.splits = {drive: [2 * k, 2 * k + 1] for k, drive in enumerate(drives)}

    def __len__(self) -> int:
        return len(self.names)

    def name_of(self, index: int) -> str:
        return self.names[index]


SMALL = Drives("b", "c")
GROWN = Drives("a", "b", "c")
"""A drive that sorts first has joined."""
FRAMES = RunFrames.at(SMALL, [0, 1], validation=[2, 3])


@pytest.fixture
def begun(tmp_path) -> Path:
    """The folder of a run that learned from drive b."""
    (tmp_path / "config.json").write_text("{}")
    write_frames(tmp_path, FRAMES)
    return tmp_path


def test_what_is_kept_is_read_and_a_run_of_an_earlier_version_has_none(begun):
    assert read_frames(begun) == FRAMES == RunFrames(("b-0", "b-1"), ("c-0", "c-1"))
    assert read_frames(begun / "elsewhere") is None


@pytest.mark.parametrize(
    ("content", "told"),
    [
        ("{", r"frames\.json is not JSON.*; copy it again, or remove it"),
        ('{"train": ["a"]}', r"is no record of a run's frames.*validation.*; copy it again, or remove it"),
        ('{"train": ["a"], "validation": []}', r"is no record .*none of one are named"),
        ('{"train": ["../a"], "validation": ["b"]}', r"is no record .*'\.\./a' came as a frame's name"),
    ],
)
def test_a_damaged_record_is_refused_with_what_to_do(begun, content, told):
    (begun / "frames.json").write_text(content)
    with pytest.raises(ValueError, match=rf"(?s){told}"):
        read_frames(begun)


def test_a_change_tells_what_is_gone_and_what_is_new():
    assert change(["a", "b", "c"], ["c", "b", "a"]) == ""
    assert change(["a", "b", "c"], ["b", "d", "e"]) == (
        "2 of its 3 are not among them (the first: a), 2 are new (the first: d)"
    )
    assert change(["a"], ["a", "b"]) == "1 are new (the first: b)"


def test_a_run_does_not_resume_on_frames_that_it_did_not_learn_from(begun):
    check_frames(begun, RunFrames.at(GROWN, [2, 3], validation=[4, 5]))
    told = (
        r"--data\.train names today: 2 of its 2 .*\(the first: b-0\), 2 are new \(the first: a-0\)\. Give .*--run\.name"
    )
    with pytest.raises(ValueError, match=told):
        check_frames(begun, RunFrames.at(GROWN, [0, 1], validation=[2, 3]))


def test_other_frames_that_validate_are_told_and_refuse_nothing(begun, caplog):
    check_frames(begun, RunFrames.at(GROWN, [2, 3], validation=[0, 4]))
    told = (
        "other frames validate from here on: 1 of its 2 are not among them (the first: c-1), 1 are new (the first: a-0)"
    )
    assert told in caplog.messages[0]


def test_a_record_without_a_run_and_a_run_without_a_record_refuse_nothing(begun):
    other = RunFrames.at(GROWN, [0, 1], validation=[2, 3])
    (begun / "config.json").rename(begun / "away")
    check_frames(begun, other)
    (begun / "away").rename(begun / "config.json")
    (begun / "frames.json").unlink()
    check_frames(begun, other)


def test_a_runs_frames_are_found_by_name_where_others_joined_them(caplog):
    assert positions_of(FRAMES.train, SMALL, text="0-1", part="training") == [0, 1]
    assert positions_of(FRAMES.train, GROWN, text="b", part="training") == [2, 3]
    assert not caplog.messages
    assert positions_of(FRAMES.train, GROWN, text="0-1", part="training") == [2, 3]
    assert caplog.messages[0].startswith("training frames '0-1' are no longer those of the run: 2 of its 2")
    assert caplog.messages[0].endswith("(the first: a-0); those of the run are taken, by name (frames.json)")
    assert positions_of(None, GROWN, text="0-1", part="training") == [0, 1]


def test_frames_that_are_gone_are_told_and_all_of_them_are_an_error(caplog):
    learned = (*FRAMES.train, "d-0")
    assert positions_of(learned, GROWN, text="b,6", part="training") == [2, 3]
    assert "there is no frame 6; the data set has 0-5; the run's 2 that are still here are taken" in caplog.messages[0]
    with pytest.raises(ValueError, match=r"none of the run's 2 training frames is in the data set \(the first: b-0\)"):
        positions_of(FRAMES.train, Drives("a"), text="0-1", part="training")


def test_only_positions_that_a_set_holds_are_asked_for_their_names():
    """A prepared set has a part of its data set's frames, and no name for the others."""

    class Prepared(Drives):
        def holds(self, position: int) -> bool:
            return position > 1

        def name_of(self, index: int) -> str:
            assert self.holds(index)
            return super().name_of(index)

    assert positions_of(FRAMES.train, Prepared("a", "b"), text="b", part="training") == [2, 3]


def test_all_names_of_a_set_are_looked_up_only_where_the_text_names_others():
    """The embedded world has a million."""
    asked = []

    class Noted(Drives):
        def name_of(self, index: int) -> str:
            asked.append(index)
            return super().name_of(index)

    assert positions_of(FRAMES.train, Noted("a", "b", "c"), text="b", part="training") == [2, 3]
    assert asked == [2, 3]


def test_a_run_is_judged_by_its_own_validation_frames_or_by_those_that_are_named():
    assert judges_of(FRAMES, GROWN, frames="", validation="2-3") == [4, 5]
    assert judges_of(FRAMES, GROWN, frames="0", validation="2-3") == [0]
    assert judges_of(None, GROWN, frames="", validation="2-3") == [2, 3]
    assert judges_of(FRAMES, GROWN, frames="", validation="") == list(range(6))


def test_runs_of_other_frames_share_none(begun, tmp_path):
    same, other, earlier = (tmp_path / name for name in ("same", "other", "earlier"))
    write_frames(same, RunFrames(FRAMES.train[::-1], ("c-0",)))
    write_frames(other, RunFrames.at(GROWN, [0, 1], validation=[4, 5]))
    assert shared_frames([begun, same], by="join") == FRAMES
    assert shared_frames([begun, earlier], by="join") is None
    with pytest.raises(ValueError, match=rf"join: {other} learned from other frames than {begun}: 2 of its 2 .*b-0"):
        shared_frames([earlier, begun, other], by="join")


def test_the_record_is_a_list_that_people_can_read(begun):
    assert json.loads((begun / "frames.json").read_text())["train"] == ["b-0", "b-1"]
    assert len((begun / "frames.json").read_text().splitlines()) > 4
