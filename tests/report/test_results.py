"""Results as files, and tables of scores."""

import json

import numpy as np
import pytest

from jaxsim.discover.verdict import Interval
from jaxsim.metrics import Score
from jaxsim.report.results import (
    list_facts,
    list_scores,
    markdown_table,
    score_table,
    write_list,
    write_results,
    write_scores,
)


def test_json_markdown_and_page_hold_what_was_given(tmp_path):
    path = write_results(tmp_path / "new", "scores", {"mae": 0.5}, text="| mae |", page="<p>0.5</p>")
    assert path == tmp_path / "new" / "scores.html"
    assert path.read_text() == "<p>0.5</p>"
    assert json.loads((tmp_path / "new" / "scores.json").read_text()) == {"mae": 0.5}
    assert (tmp_path / "new" / "scores.md").read_text() == "| mae |\n"


def test_structs_are_objects_of_json_and_arrays_lists(tmp_path):
    content = {"interval": Interval(1.0, 0.5, float("inf"), "m"), "iou": np.array([[0.5, np.nan]]), "seeds": (0, 1)}
    write_results(tmp_path, "scores", content, text="none")
    assert json.loads((tmp_path / "scores.json").read_text()) == {
        "interval": {"value": 1.0, "low": 0.5, "high": None, "unit": "m"},
        "iou": [[0.5, None]],
        "seeds": [0, 1],
    }


def test_without_a_page_the_markdown_is_what_to_open(tmp_path):
    assert write_results(tmp_path, "scores", {}, text="none", indent=1) == tmp_path / "scores.md"
    assert {path.name for path in tmp_path.iterdir()} == {"scores.md", "scores.json"}


def test_facts_are_a_list():
    assert list_facts({"frames": 3, "rules": "official"}) == "- frames: 3\n- rules: official"


def test_a_table_has_heads_a_rule_and_a_line_a_row():
    assert markdown_table(["a", "b"], [["1", "2"], ["3", "4"]]) == "| a | b |\n|---|---|\n| 1 | 2 |\n| 3 | 4 |"
    assert markdown_table(["a|b"], [["c|d"]]) == "| a\\|b |\n|---|\n| c\\|d |"
    assert markdown_table(["a"], [["c\nd"]]) == "| a |\n|---|\n| c d |"


SCORES = {"network": {"mae": Score(0.12345, "1", 10), "psnr": Score(20.126, "dB", 10)}}


def test_a_row_a_predictor_with_units_in_the_head():
    assert score_table(SCORES).splitlines() == [
        "| predictor | mae | psnr (dB) | cells |",
        "|---|---|---|---|",
        "| network | 0.1235 | 20.13 | 10 |",
    ]


def test_scores_are_written_with_name_value_unit_and_count(tmp_path):
    write_scores(tmp_path, SCORES, frames=["a", "b"])
    content = json.loads((tmp_path / "scores.json").read_text())
    assert content["frames"] == ["a", "b"]
    assert content["scores"]["network"]["psnr"] == {"value": 20.126, "unit": "dB", "count": 10}
    assert (tmp_path / "scores.md").read_text() == f"2 frames\n\n{score_table(SCORES)}\n"


def test_json_has_null_where_nothing_counts(tmp_path):
    """Other programs than Python's refuse a file with NaN or Infinity."""
    scores = {"drop_iou": Score(float("nan"), "1", 0), "psnr": Score(float("inf"), "dB", 10)}
    write_list(tmp_path, "generation", scores, about={})
    strict = json.JSONDecoder(parse_constant=lambda word: pytest.fail(f"{word} is no JSON"))
    content = strict.decode((tmp_path / "generation.json").read_text())["scores"]
    assert (content["drop_iou"]["value"], content["psnr"]["value"]) == (None, None)


def test_a_list_says_what_was_compared(tmp_path):
    write_list(tmp_path, "generation", SCORES["network"], about={"frames": [2, 3]})
    assert json.loads((tmp_path / "generation.json").read_text())["frames"] == [2, 3]
    text = (tmp_path / "generation.md").read_text()
    assert text == f"frames: [2, 3]\n\n{list_scores(SCORES['network'])}\n"
    assert "| mae | 0.1235 | 1 | 10 |" in text
