"""Text and JSON: nothing is passed over."""

import json
import shlex
from functools import partial

import numpy as np
import pytest

from jaxsim.config import RunConfig
from jaxsim.data.kitti_files import read_labels, read_motion
from jaxsim.data.polar_frames import open_polar_frames
from jaxsim.effects.chain import SensorModel
from jaxsim.files import (
    as_argument,
    check_keys,
    parse_json,
    parse_number,
    parse_settings,
    read_json,
    read_names,
    read_text,
    real,
)
from jaxsim.metrics.detection.files import frame_list, read_detections

CAR = "Car 0.00 0 1.85 387.63 181.54 423.81 203.12 1.67 1.87 3.69 -16.53 2.39 58.49 1.57"


def test_a_byte_order_mark_costs_no_label(tmp_path):
    (tmp_path / "0.txt").write_bytes(b"\xef\xbb\xbf" + CAR.encode())
    assert read_labels(tmp_path / "0.txt").kind == ("Car",)
    (tmp_path / "0.txt").write_bytes(b"\xef\xbb\xbf" + f"{CAR} 0.5".encode())
    assert read_detections(tmp_path).lower_kind.tolist() == ["car"]
    (tmp_path / "val.list").write_bytes(b"\xef\xbb\xbf000001\n")
    assert frame_list(tmp_path / "val.list") == read_names(tmp_path / "val.list", by="kitti") == ["000001"]


def test_a_path_stays_one_argument_of_a_command(tmp_path):
    for name in ("runs", "set of pairs", "it's", "$HOME", "a;b"):
        assert shlex.split(f"jaxsim eval {as_argument(tmp_path / name)}") == ["jaxsim", "eval", str(tmp_path / name)]
    assert as_argument("runs/demo") == "runs/demo"


def test_text_of_another_encoding_is_named_with_its_line(tmp_path):
    (tmp_path / "0.txt").write_bytes(CAR.encode() + b"\nVoiture \xe9\n")
    with pytest.raises(ValueError, match=r"0\.txt, line 2: byte 0xe9 is no UTF-8"):
        read_labels(tmp_path / "0.txt")
    (tmp_path / "0.txt").write_bytes(CAR.encode("utf-16"))
    with pytest.raises(ValueError, match=r"line 1: byte 0xff is no UTF-8"):
        read_text(tmp_path / "0.txt", by="test")


def test_a_text_whose_end_was_lost_says_from_which_line(tmp_path):
    (tmp_path / "0.txt").write_bytes(CAR.encode() + b"\n" + bytes(30))
    with pytest.raises(
        ValueError, match=r"0\.txt, line 2: 30 of \d+ bytes are 0, which no text has: its content was lost"
    ):
        read_labels(tmp_path / "0.txt")


@pytest.mark.parametrize("word", ["1_0", "١", "１０", "1,5", "", "0x1"])
def test_what_python_alone_takes_for_a_number_is_none(tmp_path, word):
    with pytest.raises(ValueError):  # noqa: PT011
        parse_number(word, float, where="a file")
    if word:
        (tmp_path / "0.txt").write_text(CAR.replace("58.49", word), encoding="utf-8")
        with pytest.raises(ValueError, match=r"0\.txt, line 1"):
            read_labels(tmp_path / "0.txt")
        (tmp_path / "oxts.txt").write_text(" ".join(["0"] * 29 + [word]), encoding="utf-8")
        with pytest.raises(ValueError, match="30 numbers"):
            read_motion(tmp_path / "oxts.txt")


def test_a_frame_listed_twice_is_refused(tmp_path):
    (tmp_path / "val.txt").write_text("000001\n000002\n000001\n")
    for read in (frame_list, partial(read_names, by="kitti")):
        with pytest.raises(ValueError, match="names 000001 more than once"):
            read(tmp_path / "val.txt")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"a": 1, "a": 2}', "'a' is named twice"),
        ("[" * 100000, "deeper than can be read"),
        ("9" * 5000, "digits"),
        ("{", "Expecting"),
        ("", "it is empty; copy it again"),
        ("\n", "it is empty"),
    ],
)
def test_json_that_is_none_or_says_two_things_is_refused(tmp_path, text, message):
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(ValueError, match=rf"a\.json is not JSON: .*{message}"):
        read_json(tmp_path / "a.json", by="test")


@pytest.mark.parametrize("value", ["1", True, None, [1], 10**400])
def test_only_a_number_is_a_number(value):
    with pytest.raises(ValueError, match="is no number"):
        real(value)


def test_a_value_of_another_kind_is_told_without_pythons_words(tmp_path):
    for content in ("[]", "null", '{"effects": 3}'):
        (tmp_path / "sensor.json").write_text(content)
        with pytest.raises(ValueError, match=r"sensor\.json is not .*: a value is of another kind$"):
            SensorModel.load(tmp_path / "sensor.json")


def test_a_misspelt_key_names_the_nearest(tmp_path):
    with pytest.raises(ValueError, match=r"'orign' means nothing here; did you mean origin\?"):
        check_keys({"orign": 1}, ("azimuth", "origin"), where="grid.json")
    with pytest.raises(ValueError, match="'x' means nothing here; known: azimuth, origin"):
        check_keys({"x": 1}, ("azimuth", "origin"), where="grid.json")


def sensor(**entry):
    return {"effects": [{"name": "beam_gain", "parameters": {"gain": 0.1}} | entry]}


@pytest.mark.parametrize(
    ("content", "guess"),
    [
        ({"effects": [{"name": "beam_gain", "paramters": {"gain": 0.1}}]}, "did you mean parameters"),
        (sensor() | {"level": {}}, "did you mean levels"),
        (sensor(parameters={"gain": "0.1"}), "'0.1' is no number"),
        (sensor(parameters={"gain": True}), "True is no number"),
        (sensor() | {"learned": [{"chanel": "drop"}]}, "did you mean channel"),
    ],
)
def test_sensor_json_is_taken_as_it_is_written(tmp_path, content, guess):
    (tmp_path / "sensor.json").write_text(json.dumps(content))
    with pytest.raises(ValueError, match=guess):
        SensorModel.load(tmp_path / "sensor.json")


GRID = {"azimuth": [0.1, 0.0], "elevation": [0.1, 0.0]}


@pytest.mark.parametrize(
    ("change", "guess"),
    [
        ({"orign": [0.2, 0.2]}, "did you mean origin"),
        ({"frames": {"a": {"scenes": "x"}}}, "did you mean scene"),
        ({"azimuth": ["0.1", "0.0"]}, "numbers in radians"),
    ],
)
def test_grid_json_is_taken_as_it_is_written(tmp_path, change, guess):
    np.savez(tmp_path / "a.npz", range=np.ones((2, 2)), intensity=np.ones((2, 2)))
    (tmp_path / "grid.json").write_text(json.dumps(GRID))
    assert open_polar_frames(tmp_path).names == ("a",)
    (tmp_path / "grid.json").write_text(json.dumps(GRID | change))
    with pytest.raises(ValueError, match=guess):
        open_polar_frames(tmp_path)


@pytest.mark.parametrize("change", ['{"kep": 1}', '{"keep": "2"}', '{"keep": true}', '{"keep": 0}', '{"keep": 1.5}'])
def test_settings_are_taken_as_they_are_written(change):
    assert parse_settings(RunConfig, parse_json('{"keep": 3}')).keep == 3
    with pytest.raises(ValueError, match=r"^(keep: .*|settings: 'kep' means nothing here; did you mean keep\?)$"):
        parse_settings(RunConfig, parse_json(change))
