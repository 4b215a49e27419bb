"""A slice of the attack, and that the attack itself sees what is wrong."""

import errno
import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from jaxsim.files import read_json
from tests.fuzz.__main__ import main
from tests.fuzz.judge import digest, fault, of_error
from tests.fuzz.mutations import mutate
from tests.fuzz.reader import Reader, one
from tests.fuzz.worker import attack, prepare, table

SLICE = 152


@pytest.mark.long
def test_no_reader_takes_damage_without_a_word_or_answers_in_a_foreign_one(capsys):
    assert main([str(SLICE), "26", "--workers", "1"]) == 0, capsys.readouterr().out
    assert f"{SLICE} mutations: same" in capsys.readouterr().out


def test_a_mutation_of_a_seed_is_always_the_same(tmp_path):
    results = []
    for _ in range(2):
        one("a.json", '{"a": [1, 2.5, "x"]}')(tmp_path)
        results.append((mutate(tmp_path / "a.json", np.random.default_rng([3, 7])), (tmp_path / "a.json").read_bytes()))
    assert results[0] == results[1]
    assert {name for k in range(300) if (name := _mutated(tmp_path, k))} > {"truncated", "deep", "directory", "utf-16"}


def _mutated(folder: Path, k: int) -> str:
    place = folder / str(k)
    one("a.json", '{"a": [1, 2.5, "x"]}')(place)
    return mutate(place / "a.json", np.random.default_rng(k))


def test_equal_values_alone_have_one_digest():
    value = {"a": np.arange(3.0), "b": (1, "x", None)}
    assert digest(value) == digest({"b": (1, "x", None), "a": np.arange(3.0)})
    others = [
        {"a": np.arange(3.0)},
        {**value, "b": (1, "x", 0)},
        {**value, "a": np.arange(3)},
        {**value, "b": (1, "x")},
    ]
    assert len({digest(other) for other in [value, *others]}) == 5


@pytest.mark.parametrize(
    ("value", "wrong"),
    [
        ({"x": np.array([1.0, np.nan])}, "x is not finite"),
        ({"x": 1e12}, "x spans 1e+12..1e+12"),
        ({"intensity": np.array([0.0, 1.5])}, "intensity spans 0..1.5, beyond 0..1"),
        ({"intensity": np.array([0.0, 1.0]), "name": "x", "x": True}, None),
    ],
)
def test_what_cannot_be_is_seen(value, wrong):
    found = fault(value, Reader(one("a", ""), lambda folder: None, within={"intensity": (0, 1)}))
    assert found is None if wrong is None else str(found).startswith(wrong)


def test_errors_fall_into_their_columns(tmp_path):
    def column(error: Exception) -> str:
        try:
            raise error
        except Exception as raised:
            return of_error(raised, tmp_path)

    (tmp_path / "a.json").write_text("{")
    with pytest.raises(ValueError, match=r"a\.json is not JSON") as own:
        read_json(tmp_path / "a.json", by="test")
    assert of_error(own.value, tmp_path) == "own clear error"
    assert column(OSError(errno.EISDIR, "Is a directory", str(tmp_path / "a"))) == "own clear error"
    assert column(ValueError(f"{tmp_path} of someone else's code")) == "bare foreign text"
    assert column(UnicodeDecodeError("utf-8", b"\xff", 0, 1, "invalid")) == "bare foreign text"
    assert column(KeyError("a")) == "raw traceback"
    wrapped = ValueError(str(tmp_path))
    wrapped.__cause__ = MemoryError("malloc of size 3221225472 failed")
    assert column(wrapped) == "memory"
    wrapped.__cause__ = MemoryError(f"malloc of size {2**62} failed")
    assert column(wrapped) != "memory"


def test_a_careless_reader_is_found_out(tmp_path, monkeypatch):
    """One that believes a file, fails with what comes, and lacks the path."""

    def believe(folder: Path) -> Any:
        # A pipe in the file's place, into which nobody writes, must not hold the test for ever.
        with open(os.open(folder / "a.json", os.O_RDONLY | os.O_NONBLOCK)) as file:
            return json.load(file)

    careless = Reader(one("a.json", '{"range": 5.0}'), believe)
    monkeypatch.setattr("tests.fuzz.worker.table", lambda: {"careless": careless})
    readers, digests = prepare(tmp_path)
    found = {attack(k, 0, readers, digests, tmp_path).column for k in range(200)}
    assert found >= {"same", "implausible accepted", "bare foreign text", "raw traceback"}


def test_every_reader_that_data_sets_have_is_attacked():
    assert len(table()) >= 58
