import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from jaxsim.config import DataConfig
from jaxsim.effects.chain import SensorModel
from jaxsim.frame import Frame
from jaxsim.geometry import full_grid, preset
from jaxsim.simulate.folder import (
    FrameBatch,
    FrameMaker,
    MadeBatch,
    Speed,
    _first_read,
    _overlapped,
    claim_effects,
    claim_frames,
    data_words,
    pictures_of,
    simulate_folder,
)
from tests.export.made_trees import Six, boxes_at

MADE = {"fingerprint": "4f2a", "data": "synthetic", "seed": 0, "source": DataConfig().of_frames}


@pytest.fixture
def out(tmp_path):
    """A folder that holds a frame made so."""
    claim_frames(tmp_path, **MADE)
    (tmp_path / "polar").mkdir()
    (tmp_path / "polar" / "a.npz").touch()
    return tmp_path


def test_the_same_making_resumes(out):
    claim_frames(out, **MADE)


@pytest.mark.parametrize(
    ("change", "meaning"),
    [
        ({"fingerprint": "93c1"}, r"sensor was 4f2a, now 93c1"),
        ({"data": "kitti_raw"}, "data was synthetic, now kitti_raw"),
        ({"seed": 1}, "seed was 0, now 1"),
        ({"source": DataConfig(streets="suburb").of_frames}, r"source\.streets was town, now suburb"),
        ({"source": DataConfig(lidar="camera").of_frames}, r"source\.lidar was kitti, now camera"),
        ({"source": DataConfig(scenes=("0001",)).of_frames}, r"source\.scenes was \[\], now \['0001'\]"),
    ],
)
def test_frames_of_another_making_are_not_added(out, change, meaning):
    with pytest.raises(ValueError, match=f"{meaning}.*give another --out"):
        claim_frames(out, **(MADE | change))
    claim_frames(out, **MADE)


def test_a_folder_without_frames_may_change_its_making(tmp_path):
    claim_frames(tmp_path, **MADE)
    claim_frames(tmp_path, **(MADE | {"seed": None}))


def test_frames_that_do_not_say_their_making_are_not_added_to(out):
    (out / "simulation.json").unlink()
    with pytest.raises(ValueError, match=r"no simulation\.json says"):
        claim_frames(out, **MADE)


def test_a_note_of_before_that_names_no_source_is_taken_for_this_ones(out):
    record = out / "simulation.json"
    record.write_text(json.dumps({"sensor": "4f2a", "data": "synthetic", "seed": 0}))
    claim_frames(out, **MADE)
    assert json.loads(record.read_text())["source"]["streets"] == "town"


def test_a_damaged_note_says_so(out):
    (out / "simulation.json").write_text("{")
    with pytest.raises(ValueError, match="cannot be read"):
        claim_frames(out, **MADE)


FRAMES = [object.__new__(Frame) for _ in range(4)]
"""Frames of which nothing is looked at."""


class Noting(FrameMaker):
    """Notes what is done, and fails where it is told to."""

    def __init__(self, fails_at=None):
        object.__setattr__(self, "done", [])
        object.__setattr__(self, "fails_at", fails_at)
        object.__setattr__(self, "dataset", self)

    def __getitem__(self, position):
        self.note("read", position)
        return FRAMES[position]

    def note(self, what, position):
        if (what, position) == self.fails_at:
            raise ValueError(f"{what} failed")
        self.done.append((what, position))

    def simulate(self, chosen, frames):
        assert all(frame is FRAMES[k] for frame, k in zip(frames, chosen.positions, strict=True))
        self.note("simulate", chosen.positions[0])
        return None, None, 0.5

    def write(self, chosen, frames, simulated):
        self.note("write", chosen.positions[0])
        return MadeBatch({str(position): {} for position in chosen.positions}, simulated[2])


BATCHES = [FrameBatch((k,), frozenset(), 0.0) for k in range(4)]


@pytest.mark.parametrize(("positions", "first"), [([2, 3, 1], "six-3"), ([2], None)])
def test_what_an_effect_needs_is_asked_of_the_first_frame_that_can_be_read(positions, first):
    dataset = Six(boxes=lambda index: Path("lost").read_bytes() if index == 2 else boxes_at())
    found = _first_read(dataset, positions)
    assert (found and found.name) == first


def test_batches_come_in_their_order_each_read_once_and_written_once():
    maker = Noting()
    assert [[*made.about] for made in _overlapped(maker, BATCHES, failures=[])] == [["0"], ["1"], ["2"], ["3"]]
    assert sorted(maker.done) == [(what, k) for what in ("read", "simulate", "write") for k in range(4)]
    assert [k for what, k in maker.done if what == "write"] == [0, 1, 2, 3]
    assert list(_overlapped(Noting(), [], failures=[])) == []


def test_a_frame_that_cannot_be_read_costs_itself_alone():
    batches = [FrameBatch((0, 1, 2), frozenset(), 0.0, ("a", "b", "c")), FrameBatch((3,), frozenset(), 0.0, ("d",))]
    for bad, made in ((1, [["0", "2"], ["3"]]), (3, [["0", "1", "2"]])):
        failures = []
        found = _overlapped(Noting(("read", bad)), batches, failures=failures)
        assert [[*batch.about] for batch in found] == made
        assert failures == ["read failed"]
    assert batches[0].part([0, 2]).sources == ("a", "c")


@pytest.mark.parametrize("what", ["simulate", "write"])
def test_what_fails_ends_the_command_and_what_was_written_before_is_told(what):
    told = []
    with pytest.raises(ValueError, match=f"{what} failed"):
        told.extend(made.about for made in _overlapped(Noting((what, 2)), BATCHES, failures=[]))
    assert {"0": {}} in told
    assert len(told) <= 2


def speed(batches_s):
    return Speed(simulated=20, already=0, batch=8, batches_s=batches_s, total_s=100.0)


def told(batches_s, **more):
    first, second = speed(batches_s).words(Path("out"), **more).splitlines()
    assert first == "20 frames simulated, 0 were there: out"
    return second


def test_the_simulations_speed_leaves_out_compilation_and_all_other_work():
    assert told((30.0, 1.0, 3.0)).startswith("simulation alone 4.00 frames/s")
    assert "100.0 s in all" in told((30.0, 1.0, 3.0))


def test_one_batch_tells_no_speed():
    assert "frames/s" not in told((30.0,))


def test_of_a_cluster_the_speed_is_that_of_all_workers():
    assert told((30.0, 30.0), workers=True).startswith("0.20 frames/s; ")


def test_where_nothing_was_left_to_do_there_is_no_speed():
    done = Speed(simulated=0, already=3, batch=8, batches_s=(), total_s=1.0)
    assert done.words(Path("out")) == "0 frames simulated, 3 were there: out"


def test_words_of_the_data_say_what_is_unlike_a_runs_own():
    assert data_words(DataConfig("kitti_raw", lidar="camera")) == "kitti_raw"
    assert data_words(DataConfig("vkitti2", lidar="camera"), "none") == "vkitti2, LiDAR in the camera, not projected"


class Of(FrameMaker):
    """A maker of these fields alone."""

    def __init__(self, **fields):
        for name, value in fields.items():
            object.__setattr__(self, name, value)


def test_effects_that_drift_count_from_the_data_sets_first_frame(tmp_path, monkeypatch):
    """Whichever frames are chosen, as trees count."""

    def started(self, index, read=Six.__getitem__):
        return replace(read(self, index), time_s=1.3e9 + 0.1 * index)

    monkeypatch.setattr(Six, "__getitem__", started)
    learned = SimpleNamespace(window=(full_grid(preset("vlp16")), None), fingerprint="4f2a")
    drift = SensorModel((("emitter_drift", {"rate": 0.1}),))
    maker = Of(learned=learned, dataset=Six(), out=tmp_path, effects_model=drift)
    seen = []

    def spread(batches):
        seen.extend(batches)
        return iter([MadeBatch({}, 0.1)])

    simulate_folder(maker, [3, 4, 5], source=DataConfig(), spread=spread)
    assert [batch.first_s for batch in seen] == [1.3e9]


def test_frames_of_other_levels_are_not_added(tmp_path):
    noisy = SensorModel((), {"range_noise": 0.02})
    claim_effects(tmp_path, noisy)
    claim_effects(tmp_path, noisy)
    with pytest.raises(ValueError, match=r"levels\.range_noise was 0\.02, now 0\.03"):
        claim_effects(tmp_path, SensorModel((), {"range_noise": 0.03}))


def test_a_frame_that_is_there_is_drawn_where_a_picture_is_asked_for_and_it_has_none(tmp_path):
    learned = SimpleNamespace(window=(full_grid(preset("vlp16")), None), fingerprint="4f2a")
    maker = Of(learned=learned, dataset=Six(), out=tmp_path, formats=())

    def simulated(previews, positions):
        """The places that are simulated, and of which pictures are drawn."""
        told = []

        def spread(batches):
            for batch in batches:
                told.append((batch.positions, sorted(batch.drawn)))
                names = [f"six-{k}" for k in batch.positions]
                pictures = [path for k in batch.drawn for path in pictures_of(tmp_path, f"six-{k}")]
                for path in (*(tmp_path / "polar" / f"{name}.npz" for name in names), *pictures):
                    path.parent.mkdir(exist_ok=True)
                    with path.open("wb") as file:
                        np.savez(file, source="")
                yield MadeBatch({name: {} for name in names}, 0.1)

        simulate_folder(maker, positions, source=DataConfig(), previews=previews, spread=spread)
        return told

    assert simulated(0, [3, 4]) == [((3, 4), [])]
    assert simulated(1, [3, 4]) == [((3,), [3])]
    assert simulated(1, [3, 4]) == []
    # The first of all that are asked for, as the page of clouds shows them, not the first that are left to do.
    assert simulated(2, [2, 3, 4, 5]) == [((2, 5), [2])]
