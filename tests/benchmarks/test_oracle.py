"""An oracle that knows the form: its bars come of nulls of the same condition, and a table stands beside discover's."""

import json
from dataclasses import asdict

import pytest

from benchmarks.blind import oracle
from benchmarks.blind.plan import Settings

OTHERS = ["blooming", "range_walk", "range_gate", "saturation"]


def _row(truth, gain, *, others=0.0, number=0, answer=(), given="all"):
    """One effect's gain in a row whose other four gain `others`."""
    ranking = [[truth or "beam_gain", gain], *([name, others] for name in OTHERS)]
    kind, right = ("single", truth in answer) if truth else ("none", not answer)
    settings = asdict(Settings(simulator="noisy", given=given))
    told = {"kind": kind, "truth": [truth] if truth else [], "first_right": right, "in_set": right}
    return told | {"key": f"{truth} {number}", "settings": settings, "ranking": sorted(ranking, key=lambda r: -r[1])}


@pytest.fixture
def nulls():
    """Forty, in which beam_gain gains 0.00, 0.01, ... 0.39."""
    return [_row("", k / 100, number=k) for k in range(40)]


def test_a_bar_is_what_one_null_in_twenty_gains(nulls):
    gains = [dict(row["ranking"]) for row in nulls]
    share = sum(one["beam_gain"] > oracle.bar("beam_gain", gains) for one in gains) / len(gains)
    assert share == pytest.approx(oracle.FALSE)
    assert oracle.bar("range_scale", gains) == 0.0
    assert oracle.bar("range_scale", [one | dict.fromkeys(OTHERS, 0.2) | {"beam_gain": 0.5} for one in gains]) == 0.2


@pytest.mark.parametrize(
    ("gain", "others", "wanted"),
    [(0.5, 0.1, (True, True)), (0.5, 0.6, (True, False)), (0.3, 0.1, (False, False)), (0.3, 0.6, (False, False))],
)
def test_it_detects_above_the_bar_and_tells_apart_where_nothing_gains_more(nulls, gain, others, wanted):
    [(_, *found)] = oracle.judged([*nulls, _row("beam_gain", gain, others=others)])
    assert tuple(found) == wanted


def test_what_is_not_among_the_five_is_not_detected(nulls):
    hidden = _row("beam_gain", 0.5) | {"truth": ["range_scale"]}
    assert [found for _, *found in oracle.judged([*nulls, hidden])] == [[False, False]]


def test_too_few_nulls_or_those_of_another_condition_make_no_oracle(nulls):
    assert oracle.judged([*nulls[: oracle.FEWEST - 1], _row("beam_gain", 0.5)]) == []
    assert len(oracle.judged([*nulls[: oracle.FEWEST], _row("beam_gain", 0.5)])) == 1
    assert oracle.judged([*nulls, _row("beam_gain", 0.5, given="bare")]) == []
    assert oracle.table(nulls) == ""


def test_effects_of_one_severity_are_asked_beside_all_nulls(tmp_path, nulls, capsys):
    strong = _row("beam_gain", 0.5, answer=["beam_gain"]) | {"severity": 2.0}
    weak = _row("beam_gain", 0.1, number=1) | {"severity": 1.0}
    path = tmp_path / "cases.jsonl"
    path.write_text("".join(json.dumps(row) + "\n" for row in [*nulls, strong, weak]))
    oracle.main([str(path), "--severity", "2"])
    assert "| 100 % (1 of 1; 21 to 100 %) |" in capsys.readouterr().out


def test_rows_of_several_runs_are_counted_once(tmp_path, nulls, capsys):
    cases = [_row("beam_gain", 0.5, answer=["beam_gain"]), _row("beam_gain", 0.1, number=1)]
    for name in ("one.jsonl", "two.jsonl"):
        (tmp_path / name).write_text("".join(json.dumps(row) + "\n" for row in [*nulls, *cases]))
    oracle.main([str(tmp_path / "one.jsonl"), str(tmp_path / "two.jsonl")])
    half = "50 % (1 of 2; 9 to 91 %)"
    line = f"| home-own-noisy-all | {half} | {half} | {half} | {half} | 100 % (1 of 1; 21 to 100 %) | beam_gain |"
    assert line in capsys.readouterr().out
    with pytest.raises(SystemExit):
        oracle.main([str(tmp_path / "none.jsonl")])
