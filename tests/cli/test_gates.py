"""A gate as `jaxsim discover` asks and writes it, of an answer and of distances."""

import errno
import json
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import pytest

from jaxsim.cli import main
from jaxsim.cli.discover import Discover
from jaxsim.cli.gates import ask_gate, check_flags, make_gate
from jaxsim.discover.distances import QuickDistances
from jaxsim.discover.gate import save_gate
from jaxsim.discover.verdict import Interval
from tests.discover.made_gate import sides
from tests.report import results

DISTANCES = QuickDistances({"intensity": Interval(0.10, 0.09, 0.11, "share of full scale")}, 8, 8)


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        ({}, "--fast is for a gate"),
        ({"gate": Path("g.json"), "write_gate": Path("g.json")}, "give one of them"),
        ({"gate": Path("g.json"), "nulls": 20}, "--nulls came with --fast"),
        ({"gate": Path("g.json"), "every_frame": True}, "--every-frame came with --fast"),
    ],
)
def test_flags_of_gates_that_do_not_go_together(flags, message):
    with pytest.raises(ValueError, match=message):
        check_flags(vars(Discover(out=Path("out"), fast=True, **flags)))


def refused():
    raise ValueError("2 scenes")


def unreadable():
    raise PermissionError(errno.EACCES, "Permission denied", "measured")


def broken():
    """A fault of nobody's files."""
    return {}["x"]


@pytest.mark.parametrize(
    ("most", "compare", "status", "title"),
    [
        (0.2, lambda: DISTANCES, 0, "The simulation passes"),
        (0.05, lambda: DISTANCES, 1, "The simulation lacks something"),
        (0.095, lambda: DISTANCES, 2, "This cannot be judged for certain"),
        (0.2, refused, 2, "This cannot be judged for certain"),
        (0.2, unreadable, 2, "This cannot be judged for certain"),
        (0.2, broken, 2, "This cannot be judged for certain"),
    ],
)
def test_the_status_is_the_colour_and_frames_that_cannot_be_compared_are_unsure(
    tmp_path, capsys, most, compare, status, title
):
    (tmp_path / "gate.json").write_text(json.dumps({"thresholds": {"intensity": most}}))
    assert ask_gate(tmp_path / "gate.json", tmp_path, compare) == status
    assert title in capsys.readouterr().out
    assert title in (tmp_path / "gate.md").read_text()
    assert (tmp_path / "junit.xml").is_file()


@pytest.mark.parametrize(("gate", "out"), [("file/gate.json", "out"), ("gate.json", "file"), ("gate.json", "file/out")])
def test_a_failure_is_no_gap(tmp_path, capsys, gate, out):
    (tmp_path / "file").touch()
    save_gate(tmp_path / "gate.json", thresholds={"intensity": 0.05})
    folders = ["--measured", str(tmp_path), "--simulated", str(tmp_path), "--out", str(tmp_path / out)]
    with pytest.raises(SystemExit) as stop:
        main(["discover", *folders, "--gate", str(tmp_path / gate), "--fast"])
    assert stop.value.code == 2
    assert "file" in "".join(capsys.readouterr())


def test_what_was_made_of_an_answer_passes_that_answer(tmp_path, capsys):
    verdict = results.named().verdict
    verdict.save(tmp_path / "out")
    gate = tmp_path / "gate.json"
    make_gate(gate, tmp_path / "out", verdict)
    assert capsys.readouterr().out == f'{gate}: {{ "baseline": "out/verdict.json" }}\n'
    assert ask_gate(gate, tmp_path, lambda: verdict) == 0


def test_what_was_made_of_distances_says_what_they_were(tmp_path):
    make_gate(tmp_path / "gate.json", tmp_path, DISTANCES)
    assert "0.1 (0.09 .. 0.11) share of full scale" in (tmp_path / "gate.md").read_text()
    assert ask_gate(tmp_path / "gate.json", tmp_path, lambda: DISTANCES) == 0


@pytest.mark.parametrize("flag", ["--gate", "--write-gate"])
def test_nothing_is_written_into_a_folder_that_is_read(tmp_path, capsys, flag):
    for name in ("measured", "simulated"):
        (tmp_path / name).mkdir()
    folders = [f"--{name}={tmp_path / name}" for name in ("measured", "simulated")]
    with pytest.raises(SystemExit) as stop:
        main(["discover", *folders, "--out", str(tmp_path / "measured"), flag, str(tmp_path / "g.json"), "--fast"])
    said = f"{stop.value.code} {capsys.readouterr().err}"
    assert said.startswith("2 ") == (flag == "--gate")
    assert "would be written into; give another --out" in said
    assert not [*(tmp_path / "measured").iterdir()]


def test_the_notes_of_an_answer_stand_under_its_checks(tmp_path, capsys):
    verdict = replace(results.named().verdict, notes=("10 frames have no partner",))
    (tmp_path / "gate.json").write_text(json.dumps({"allowed": [effect.name for effect in verdict.effects]}))
    ask_gate(tmp_path / "gate.json", tmp_path, lambda: verdict)
    assert (tmp_path / "gate.md").read_text().endswith("\n\n- 10 frames have no partner\n")


@pytest.mark.parametrize(("gain", "code"), [(1.0, 0), (1.3, 1)])
def test_the_command_ends_with_the_colour_and_writes_it_down(tmp_path, gain, code):
    simulated, measured = sides(tmp_path, gain=gain)
    (tmp_path / "gate.json").write_text('{"thresholds": {"intensity": 0.02}}')
    out = tmp_path / "out"
    words = [
        "--simulated",
        str(simulated),
        "--measured",
        str(measured),
        "--gate",
        str(tmp_path / "gate.json"),
        "--fast",
    ]
    with pytest.raises(SystemExit) as stop:
        main(["discover", *words, "--out", str(out)])
    assert stop.value.code == code
    suite = ET.parse(out / "junit.xml").getroot()
    assert suite.get("failures") == str(code)
    assert ("**gap**" in (out / "gate.md").read_text()) == bool(code)


def test_frames_that_cannot_be_compared_end_with_two(tmp_path):
    simulated, measured = sides(tmp_path, scenes=2)
    (tmp_path / "gate.json").write_text('{"thresholds": {"intensity": 0.02}}')
    asked = Discover(
        out=tmp_path / "out", simulated=simulated, measured=measured, gate=tmp_path / "gate.json", fast=True
    )
    with pytest.raises(SystemExit) as stop:
        asked()
    assert stop.value.code == 2
    assert 'errors="1"' in (tmp_path / "out/junit.xml").read_text()


def test_different_streets_have_no_frames_of_one_name_to_compare_fast(tmp_path):
    simulated, measured = sides(tmp_path)
    (tmp_path / "gate.json").write_text('{"thresholds": {"intensity": 0.02}}')
    given = {"out": tmp_path / "out", "simulated": simulated, "measured": measured, "unpaired": True, "fast": True}
    with pytest.raises(SystemExit) as stop:
        Discover(**given, gate=tmp_path / "gate.json")()
    assert stop.value.code == 2
    assert "--fast came with --unpaired" in (tmp_path / "out/gate.md").read_text()
    with pytest.raises(ValueError, match="--fast came with --unpaired, which compares frames of one name"):
        Discover(**given, write_gate=tmp_path / "new.json")()


def test_a_gate_that_cannot_be_read_is_no_gap(tmp_path):
    simulated, measured = sides(tmp_path)
    (tmp_path / "gate.json").write_text('{"threshold": {"intensity": 0.02}}')
    for name, words in (("gate.json", "did you mean thresholds?"), ("none.json", "none.json")):
        out = tmp_path / name.removesuffix(".json")
        asked = Discover(out=out, simulated=simulated, measured=measured, gate=tmp_path / name, fast=True)
        with pytest.raises(SystemExit) as stop:
            asked()
        assert stop.value.code == 2
        assert words in (out / "gate.md").read_text()
