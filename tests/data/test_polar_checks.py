"""What a folder of polar frames may hold."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from jaxsim.data.polar_checks import angles_of
from jaxsim.data.polar_frames import read_frame, read_grid
from jaxsim.geometry.sensor import PRESETS, full_grid


def test_grid_without_elevation_is_named(tmp_path):
    (tmp_path / "grid.json").write_text(json.dumps({"azimuth": [0.0]}))
    with pytest.raises(ValueError, match="lacks elevation"):
        read_grid(tmp_path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"intensity": None}, "lacks intensity"),
        ({"intensity": np.full((3, 5), 128.0)}, "must lie in 0..1"),
        ({"intensity": np.zeros((2, 5))}, r"intensity is \(2, 5\), range \(3, 5\)"),
        (
            {"intensity": np.where(np.arange(15) == 7, np.nan, 0.5).reshape(3, 5)},
            r"0\.5\.\.0\.5, 1 of 15 NaN or infinite",
        ),
        ({"range": np.full((3, 5), np.nan)}, "finite metres"),
    ],
)
def test_frames_of_wrong_content_are_refused(tmp_path, change, message):
    arrays = {"range": np.ones((3, 5)), "intensity": np.zeros((3, 5)), **change}
    np.savez(tmp_path / "a.npz", **{key: value for key, value in arrays.items() if value is not None})
    with pytest.raises(ValueError, match=message):
        read_frame(tmp_path, "a")


RIGHT = {"range": np.ones((3, 5)), "intensity": np.full((3, 5), 0.5)}
WORDS = np.full((3, 5), "road")


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("range", np.ones((3, 5), complex), "range holds complex128; it must hold real numbers"),
        ("range", WORDS, "range holds <U4"),
        ("range", np.ones((3, 5), bool), "range holds bool; it must hold real numbers"),
        ("range", np.ones((3, 5), np.float16), "range holds float16, whose steps are .* write float32"),
        ("range", np.ones((3, 5, 1)), r"range is \(3, 5, 1\); it must be \(rows, columns\)"),
        ("semantic", WORDS, "semantic holds <U4"),
        ("semantic", np.ones((3, 5, 1), np.uint8), r"semantic is \(3, 5, 1\); it must be \(rows, columns\)"),
        ("semantic", np.ones((5, 3), np.uint8), r"semantic is \(5, 3\), range \(3, 5\)"),
        ("semantic", np.full((3, 5), 40), r"semantic spans 40\.\.40; it must hold Cityscapes ids 0\.\.33"),
        ("semantic", np.full((3, 5), 0.5), "whole numbers"),
        ("semantic", np.full((3, 5), np.nan), "whole numbers"),
        ("instance", np.full((3, 5), 1.5), "whole numbers"),
        ("instance", np.full((3, 5), 2**33), "ids are numbers of 32 bits: count"),
        ("instance", np.full((3, 5), 3e9, np.float32), "ids are numbers of 32 bits: count"),
        ("instance", np.full((3, 5), 2**40, np.uint64), "ids are numbers of 32 bits: count"),
        ("incidence", np.ones((3, 5, 2)), r"incidence is \(3, 5, 2\)"),
        ("incidence", np.full((3, 5), 80.0), "in radians, 0 head on to pi/2"),
        ("incidence", np.full((3, 5), np.nan), "incidence spans nothing, 15 of 15 NaN or infinite"),
        ("rgb", np.ones((3, 5), np.uint8), r"rgb is \(3, 5\); it must be \(rows, columns, 3\)"),
        ("rgb", np.ones((3, 5, 4), np.uint8), r"rgb is \(3, 5, 4\)"),
        ("rgb", np.full((3, 5, 3), np.nan), r"rgb spans nothing, 45 of 45 NaN or infinite; it must lie in 0\.\.255"),
        ("rgb", np.full((3, 5, 3), 300), r"must lie in 0\.\.255"),
        ("rgb", np.full((3, 5, 3), 0.5), r"must lie in 0\.\.255"),
        ("time", WORDS, "time holds <U4"),
        ("time", np.ones(5), r"time is \(5,\)"),
        ("time", np.full((3, 5), np.nan), "time spans nothing, 15 of 15 NaN or infinite where the ray hits"),
    ],
)
def test_rasters_that_cannot_be_right_are_named(tmp_path, key, value, message):
    np.savez(tmp_path / "a.npz", **{**RIGHT, key: value})
    with pytest.raises(ValueError, match=rf"a\.npz: .*{message}"):
        read_frame(tmp_path, "a")


NAN = float("nan")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"origin": [0.0]}, "origin is a list of 1 numbers; it must be a list of 3 heights"),
        ({"origin": 0.2}, r"origin is 0\.2; it must be a list of 3"),
        ({"origin": "top"}, "origin is 'top'; it must be a list of 3"),
        ({"origin": [0.0, [1.0], 0.0]}, "it must be a list of 3"),
        ({"origin": [NAN] * 3}, "NaN is no number of JSON"),
        ({"origin": [200.0] * 3}, "finite, within 10 m"),
        ({"frames": {"a": 3}}, r"frames\['a'\] is 3; it must be an object"),
        ({"frames": {"a": None}}, r"frames\['a'\] is None"),
        ({"frames": {"a": {"speed": "fast"}}}, "the speed of 'a' is 'fast'; it must be a finite number in m/s"),
        ({"frames": {"a": {"speed": None}}}, "the speed of 'a' is None"),
        ({"frames": {"a": {"time": "now"}}}, "the time of 'a' is 'now'; it must be a finite number in seconds"),
        (
            {"frames": {"a": {"time": 1.7e18}}},
            "the time of 'a' is 1.7e.18, which is no time in seconds; divide nanoseconds",
        ),
        ({"frames": {"a": {"time": 10**400}}}, "0000 is too large for a whole number"),
        ({"frames": {"a": {"speed": 1e300}}}, "the speed of 'a' is 1e"),
        ({"frames": {"a": {"tag": ["night"]}}}, "'tag' means nothing here; did you mean tags"),
        ({"frames": {"a": {"heading": [0.1]}}}, "the heading of 'a' is"),
        ({"frames": {"a": {"tags": "night"}}}, "the tags of 'a' are 'night'; they must be a list of words"),
        ({"frames": {"a": {"tags": [3]}}}, "the tags of 'a' are"),
        ({"frames": {"a": {"heading": 90.0}}}, r"frames\['a'\]: the heading is 90; it must be in radians, not degrees"),
        ({"frames": {"a": {"speed": -1e30}}}, r"frames\['a'\]: the speed is -1e\+30; it must be in m/s, at most 150"),
        ({"frames": {"a": {"scene": ["drive"]}}}, "the scene of 'a' is"),
        ({"elevation": [-0.3, -0.1, 0.03]}, "top beam first, but row 1"),
        ({"elevation": [0.03, -0.3, -0.1]}, r"row 2 \(-0\.10000 rad\) does not lie below row 1"),
        ({"elevation": [0.03, -0.1, -0.1]}, "sort the beams by elevation"),
        ({"elevation": [1.7, 0.0, -0.1]}, r"elevation spans -0\.1\.\.1\.7; no beam looks beyond the zenith"),
        ({"azimuth": np.linspace(np.pi, -np.pi, 100).tolist()}, r"azimuth spans 6\.28319 rad .* leave out the last"),
        ({"azimuth": np.linspace(6.2, -6.2, 100).tolist()}, r"azimuth spans 12\.40000 rad from the first of 100"),
        ({"elevation": "three"}, "elevation must be a list of numbers in radians"),
    ],
)
def test_grids_that_cannot_be_right_are_named(tmp_path, content, message):
    right = {"azimuth": [0.1, 0.0, -0.1], "elevation": [0.03, -0.1, -0.3]}
    (tmp_path / "grid.json").write_text(json.dumps(right | content))
    with pytest.raises(ValueError, match=rf"grid\.json.*{message}"):
        read_grid(tmp_path)


def test_times_may_be_missing_where_nothing_returned(tmp_path):
    lost = np.eye(3, 5, dtype=bool)
    np.savez(tmp_path / "a.npz", **RIGHT | {"range": np.where(lost, 0, 1.0), "time": np.where(lost, np.nan, 0.1)})
    read_frame(tmp_path, "a")


def test_beams_of_real_sensors_fall(samples):
    for path in samples.glob("ouster/*.json"):
        text = path.read_text()
        beams = np.radians(np.array(json.loads(re.search(r'"beam_altitude_angles":\s*(\[[^]]*\])', text)[1])))
        angles_of(path, "elevation", beams.tolist())
    for spec in PRESETS.values():
        angles_of(Path(spec.name), "elevation", spec.elevation_rad.tolist())
        angles_of(Path(spec.name), "azimuth", full_grid(spec).azimuth_rad.tolist())
