"""Results as files."""

import json

from jaxsim.report.results import list_facts, write_results


def test_json_markdown_and_page_hold_what_was_given(tmp_path):
    path = write_results(tmp_path / "new", "scores", {"mae": 0.5}, text="| mae |", page="<p>0.5</p>")
    assert path == tmp_path / "new" / "scores.html"
    assert path.read_text() == "<p>0.5</p>"
    assert json.loads((tmp_path / "new" / "scores.json").read_text()) == {"mae": 0.5}
    assert (tmp_path / "new" / "scores.md").read_text() == "| mae |\n"


def test_without_a_page_the_markdown_is_what_to_open(tmp_path):
    assert write_results(tmp_path, "scores", {}, text="none", indent=1) == tmp_path / "scores.md"
    assert {path.name for path in tmp_path.iterdir()} == {"scores.md", "scores.json"}


def test_facts_are_a_list():
    assert list_facts({"frames": 3, "rules": "official"}) == "- frames: 3\n- rules: official"
