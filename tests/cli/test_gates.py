"""A gate as `jaxsim discover` asks and writes it, of an answer and of distances."""

import errno
import json
from dataclasses import replace
from pathlib import Path

import pytest

from jaxsim.cli import main
from jaxsim.cli.discover import Discover
from jaxsim.cli.gates import ask_gate, check_flags, make_gate
from jaxsim.discover.distances import QuickDistances
from jaxsim.discover.gate import save_gate
from jaxsim.discover.verdict import Interval
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
