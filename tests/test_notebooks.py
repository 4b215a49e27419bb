"""The notebooks of docs/notebooks: they run, and results show themselves in them."""

from __future__ import annotations

import ast
import re
import runpy
from pathlib import Path

import numpy as np
import pytest

from tests.pages import is_module_or_member
from tests.programs import TINY

NOTEBOOKS = sorted((Path(__file__).parents[1] / "docs" / "notebooks").glob("*.py"))


@pytest.mark.parametrize("path", NOTEBOOKS, ids=[path.stem for path in NOTEBOOKS])
def test_cells_are_python_and_what_they_import_exists(path):
    """The small form; the slow ones below run them."""
    text = path.read_text()
    cells = re.split(r"^# %%.*$", text, flags=re.MULTILINE)[1:]
    assert len(cells) >= 8
    for cell in cells:
        for node in ast.walk(ast.parse(cell)):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(("jaxsim", "benchmarks")):
                assert all(is_module_or_member(f"{node.module}.{alias.name}") for alias in node.names)


@pytest.mark.slow
def test_the_hidden_effect_is_discovered(tmp_path, monkeypatch, capsys, standard_promotion):
    monkeypatch.chdir(tmp_path)
    done = runpy.run_path(str(NOTEBOOKS[0]))
    assert [effect.name for effect in done["result"].verdict.effects] == ["beam_gain"]
    assert "beam_gain" in capsys.readouterr().out.splitlines()[-1]
    assert (tmp_path / "case" / "sensor.json").is_file()


@pytest.mark.slow
def test_a_sensor_is_learned_and_simulates(tmp_path, monkeypatch, standard_promotion):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TRAINING_FLAGS", " ".join(TINY))
    done = runpy.run_path(str(NOTEBOOKS[1]))
    assert np.asarray(done["cloud"].valid).sum() > 100
