"""What two commits answered, compared value by value."""

import json

import numpy as np

from benchmarks.same import compare, told


def answered(folder, *, gain=2.0, seconds=1.0, root="/a"):
    """A folder as a job leaves it."""
    (folder / "run" / "checkpoints" / "5" / "sha256").mkdir(parents=True)
    (folder / "run" / "checkpoints" / "5" / "state").write_bytes(bytes([int(seconds)]))
    (folder / "run" / "checkpoints" / "5" / "sha256" / "metadata").write_text(json.dumps({"state": "abc"}))
    (folder / "run" / ".lock.owner").write_text(root)
    verdict = {"effects": [{"name": "beam_gain", "gain": gain}], "seconds": seconds}
    (folder / "run" / "verdict.json").write_text(json.dumps(verdict))
    (folder / "run" / "metrics.jsonl").write_text('{"step": 1, "loss": 0.5}\n{"step": 2, "loss": 0.25}\n')
    np.savez(folder / "run" / "frame.npz", range=np.array([gain, 3.0], np.float32))
    (folder / "run" / "cloud.bin").write_bytes(b"points")
    return folder


def test_every_value_and_array_is_told_but_times_and_locks(tmp_path, monkeypatch):
    folder = answered(tmp_path)
    monkeypatch.chdir(folder)
    names = {name.rpartition("run/")[2] for name, _ in told(folder / "run")}
    assert names == {
        "checkpoints/5/sha256/metadata:state",
        "verdict.json:effects.0.name",
        "verdict.json:effects.0.gain",
        "metrics.jsonl:0.step",
        "metrics.jsonl:0.loss",
        "metrics.jsonl:1.step",
        "metrics.jsonl:1.loss",
        "frame.npz:range",
        "cloud.bin",
    }


def test_what_differs_is_printed_and_times_are_not(tmp_path, monkeypatch, capsys):
    sides = [tmp_path / name for name in ("before", "again", "after")]
    for side, about in zip(sides, ({}, {"seconds": 9.0}, {"gain": 2.5}), strict=True):
        side.mkdir()
        monkeypatch.chdir(side)
        answered(side, **about)
        record = {name.removeprefix(f"{side}/"): value for name, value in told(side / "run")}
        (side / "record.json").write_text(json.dumps(record))
    assert compare(sides[0], sides[1]) == 0
    capsys.readouterr()
    assert compare(sides[0], sides[2]) == 1
    printed = capsys.readouterr().out
    assert "run/verdict.json:effects.0.gain: 2.0 -> 2.5" in printed
    assert "run/frame.npz:range" in printed
    assert "2 of 9 values differ" in printed
