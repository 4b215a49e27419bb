"""An oracle that knows the other effects of a pair: what counts as detected and told apart, and how it goes on."""

import json

import pytest

from benchmarks.blind import combinations


def effect(name: str, *, accepted: bool = True, first: str = "") -> dict:
    return {"name": name, "gain": 3.0, "accepted": accepted, "first": first or name}


def told(*effects: dict, exact: bool = True) -> dict:
    return {"key": "k", "exact": exact, "answer": ["beam_gain"], "effects": list(effects)}


@pytest.mark.parametrize(
    ("second", "wanted"),
    [
        (effect("saturation"), (True, True)),
        (effect("saturation", accepted=False), (False, False)),
        (effect("saturation", first="blooming"), (True, False)),
    ],
)
def test_all_effects_of_a_case_must_pass(second, wanted):
    one = told(effect("beam_gain"), second)
    assert (combinations.detects(one), combinations.tells_apart(one)) == wanted


def test_a_line_says_what_is_not_accepted_and_what_gains_more():
    one = told(effect("beam_gain"), effect("saturation", accepted=False, first="blooming"), exact=False)
    words = "beam_gain 3.0; saturation 3.0 (not accepted), less than blooming"
    assert combinations.line(one) == f"| {words} | beam_gain | no |"


def test_the_summary_counts_exact_answers_among_those_that_can_be_told_apart():
    rows = [told(effect("beam_gain")), told(effect("beam_gain"), exact=False), told(effect("a", accepted=False))]
    last = combinations.summary(rows).splitlines()[-1]
    assert [cell.split(" (")[0] for cell in last.strip("| ").split(" | ")] == ["67 %", "67 %", "67 %", "50 %"]


def test_a_further_call_asks_only_what_is_new(tmp_path, monkeypatch, capsys):
    path = tmp_path / "run" / "cases.jsonl"
    path.parent.mkdir()
    rows = [{"key": f"a+b 4 default {k}", "kind": "combination", "exact": True, "answer": ["a"]} for k in range(2)]
    path.write_text("".join(json.dumps(row) + "\n" for row in [*rows, {"key": "a", "kind": "single"}]))
    asked = []

    def ask(row):
        asked.append(row["key"])
        if len(asked) == 2:
            raise KeyboardInterrupt
        return [effect("a"), effect("b")]

    monkeypatch.setattr(combinations, "ask", ask)
    flags = [str(path), "--out", str(tmp_path / "oracle.jsonl")]
    with pytest.raises(KeyboardInterrupt):
        combinations.main(flags)
    combinations.main(flags)
    assert asked == [rows[0]["key"], rows[1]["key"], rows[1]["key"]]
    assert "100 % (2 of 2; 34 to 100 %)" in capsys.readouterr().out


def test_a_file_that_is_not_there_is_told(tmp_path, capsys):
    with pytest.raises(SystemExit):
        combinations.main([str(tmp_path / "none.jsonl"), "--out", str(tmp_path / "oracle.jsonl")])
    assert "is not there; give files of rows" in capsys.readouterr().err
