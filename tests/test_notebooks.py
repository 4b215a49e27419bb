"""The notebooks of docs/notebooks: they run, and results show themselves in them."""

from __future__ import annotations

import ast
import json
import re
import runpy
from html import unescape
from pathlib import Path

import numpy as np
import pytest

from jaxsim.frame import Cloud, PolarImage
from jaxsim.report import verdict_sentence
from jaxsim.report.notebook import html_of
from tests.report import results
from tests.test_docs import is_module_or_member
from tests.test_packaging import TINY

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
def test_the_hidden_effect_is_discovered(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    done = runpy.run_path(str(NOTEBOOKS[0]))
    assert [effect.name for effect in done["result"].verdict.effects] == ["beam_gain"]
    assert "beam_gain" in capsys.readouterr().out.splitlines()[-1]
    assert (tmp_path / "case" / "sensor.json").is_file()


@pytest.mark.slow
def test_a_sensor_is_learned_and_simulates(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TRAINING_FLAGS", " ".join(TINY))
    done = runpy.run_path(str(NOTEBOOKS[1]))
    assert np.asarray(done["cloud"].valid).sum() > 100


def test_a_result_shows_its_sentence_and_its_report():
    result = results.with_frames()
    text = result._repr_html_()
    assert unescape(text).startswith(f"<p>{verdict_sentence(result.verdict)}</p>")
    # The page is an attribute of a frame: nothing of it reaches the notebook's own.
    assert "<script" not in text
    assert '<script type="application/json" id="scenes">' in unescape(text)


def test_a_cloud_turns_and_of_a_batch_the_first_is_shown():
    xyz = np.random.default_rng(0).normal(0, 9, (2, 40, 3)).astype(np.float32)
    valid = np.ones((2, 40), bool)
    valid[0, 30:] = False
    cloud = Cloud(xyz, np.full((2, 40), 0.3, np.float32), valid)
    page = unescape(cloud._repr_html_())
    assert "30 points; the first of a batch of (2,)" in page
    scenes = json.loads(page.split('id="scenes">')[1].split("</script>")[0])
    assert len(scenes["scenes"]) == 1
    nothing = Cloud(xyz[0], np.zeros(40, np.float32), np.zeros(40, bool))
    assert nothing._repr_html_() == "<p>0 points</p>"


def test_a_frame_is_two_pictures():
    shape = (16, 90)
    image = PolarImage(np.full(shape, 9.0, np.float32), np.full(shape, 0.4, np.float32), np.eye(*shape) > 0)
    text = image._repr_html_()
    assert "16 rows x 90 columns, 16 returns" in text
    assert text.count("data:image/png;base64,") == 1


def test_what_it_does_not_know_is_refused():
    with pytest.raises(TypeError, match="int cannot be shown"):
        html_of(3)
