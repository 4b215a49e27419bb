"""Tables and files of scores."""

import json

from jaxsim.metrics import Score
from jaxsim.report import list_scores, score_table, write_list, write_scores

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


def test_a_list_says_what_was_compared(tmp_path):
    write_list(tmp_path, "generation", SCORES["network"], about={"frames": [2, 3]})
    assert json.loads((tmp_path / "generation.json").read_text())["frames"] == [2, 3]
    text = (tmp_path / "generation.md").read_text()
    assert text == f"frames: [2, 3]\n\n{list_scores(SCORES['network'])}\n"
    assert "| mae | 0.1235 | 1 | 10 |" in text
