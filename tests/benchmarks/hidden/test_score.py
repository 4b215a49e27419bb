"""Scores of verdicts written by hand."""

import json
import os

import pytest

from benchmarks.blind.hidden import make_case, score, score_case
from benchmarks.blind.hidden.__main__ import main

KEY = {
    "case": "ab",
    "seed": 1,
    "severity": 2.0,
    "level": "default",
    "effects": [{"name": "range_falloff", "channels": ["intensity"], "parameters": {"exponent": 0.2}}],
    "outside": None,
}


def _named(*claims):
    return {"verdict": "named", "effects": list(claims)}


def _claim(name, *look_alikes, **parameters):
    return {"name": name, "look_alikes": list(look_alikes), "parameters": parameters}


def test_the_right_name_first_is_right_and_its_interval_is_checked():
    inside = {"value": 0.22, "low": 0.15, "high": 0.25}
    result = score(KEY, _named(_claim("range_falloff", "atmospheric_extinction", exponent=inside)))
    assert result["right"]
    assert result["exact"]
    assert (result["in_set"], result["set_size"]) == (True, 2)
    assert result["parameters"][0]["inside"] == 1
    assert result["parameters"][0]["relative_error"] == pytest.approx(0.1)
    off = {"value": 0.1, "low": 0.05, "high": 0.15}
    assert score(KEY, _named(_claim("range_falloff", exponent=off)))["parameters"][0]["inside"] == 0


def test_a_look_alike_named_first_is_in_the_set_but_not_right():
    result = score(KEY, _named(_claim("atmospheric_extinction", "range_falloff")))
    assert (result["right"], result["in_set"], result["false_names"]) == (False, True, ["atmospheric_extinction"])
    assert not score(KEY, _named(_claim("beam_gain")))["in_set"]


def test_a_name_that_a_rendered_law_may_have_is_right_and_not_false():
    key = KEY | {"effects": [KEY["effects"][0] | {"name": "oren_nayar", "right": ["oren_nayar", "incidence_cosine"]}]}
    result = score(key, _named(_claim("incidence_cosine"), _claim("beam_gain")))
    assert (result["right"], result["exact"], result["false_names"]) == (True, False, ["beam_gain"])
    assert not score(key, _named(_claim("beam_gain")))["right"]


def test_the_place_of_the_disagreement_is_scored_by_channel_and_covariate():
    effect = KEY["effects"][0] | {"covariates": ["range", "power"]}
    key = KEY | {"effects": [effect]}
    answer = _named(_claim("range_falloff"))
    assert score(key, answer | {"where": [{"channel": "intensity", "covariate": "range"}]})["where_right"]
    assert not score(key, answer | {"where": [{"channel": "drop", "covariate": "range"}]})["where_right"]
    assert not score(key, answer)["where_right"]
    assert score(KEY | {"effects": []}, {"verdict": "none"})["where_right"] is None


def test_nothing_hidden_wants_none():
    null = KEY | {"effects": []}
    assert score(null, {"verdict": "none"})["right"]
    wrong = score(null, _named(_claim("oren_nayar")))
    assert (wrong["right"], wrong["named"], wrong["f1"]) == (False, True, 0)
    assert not score(KEY, {"verdict": "none"})["right"]


def test_combinations_are_sets():
    pair = KEY | {"effects": [{"name": n, "parameters": {}} for n in ("range_falloff", "random_dropout")]}
    assert score(pair, _named(_claim("random_dropout"), _claim("range_falloff")))["right"]
    half = score(pair, _named(_claim("random_dropout")))
    assert (half["right"], half["recall"], half["precision"]) == (False, 0.5, 1)
    assert half["f1"] == pytest.approx(2 / 3)


def test_outside_wants_the_channel_and_an_acceptable_covariate():
    key = KEY | {"effects": [], "outside": {"name": "x", "channel": "drop", "covariates": ["azimuth", "column"]}}

    def answer(channel, covariate):
        unexplained = {"channel": channel, "covariate": covariate}
        return score(key, {"verdict": "not_in_catalogue", "effects": [], "unexplained": unexplained})["right"]

    assert answer("drop", "column")
    assert answer("drop", ["azimuth"])
    assert answer("drop", "azimuth x range")
    assert not answer("drop", "row")
    assert not answer("range", "azimuth")
    assert not score(key, _named(_claim("random_dropout")))["right"]


def test_vectors_angles_and_levels():
    gains = {"name": "beam_gain", "parameters": {"gain": [-0.1, 0.0, 0.1]}}
    given = {"value": [0.9, 1.0, 1.1], "low": [0.85, 0.95, 1.05], "high": [0.95, 1.05, 1.08]}
    found = score(KEY | {"effects": [gains]}, _named(_claim("beam_gain", gain=given)))["parameters"][0]
    assert found["inside"] == pytest.approx(2 / 3)
    assert found["relative_error"] == pytest.approx(0, abs=1e-9)
    window = {"name": "window_contamination", "parameters": {"azimuth_rad": 3.1}}
    around = {"value": -3.15, "low": -3.25, "high": -3.1}
    found = score(KEY | {"effects": [window]}, _named(_claim("window_contamination", azimuth_rad=around)))
    assert found["parameters"][0]["inside"] == 1
    drops = {"name": "material_dropout", "parameters": {"probability": [None, 0.4]}}
    given = {"value": [0.9, 0.4], "low": [0.8, 0.3], "high": [1.0, 0.5]}
    found = score(KEY | {"effects": [drops]}, _named(_claim("material_dropout", probability=given)))
    assert found["parameters"][0]["inside"] == 1


def test_a_malformed_verdict_is_refused():
    with pytest.raises(ValueError, match="must be an object"):
        score(KEY, {"verdict": "maybe"})
    with pytest.raises(ValueError, match="at least one entry"):
        score(KEY, {"verdict": "named"})
    with pytest.raises(ValueError, match="the catalogue has"):
        score(KEY, _named(_claim("warp")))
    with pytest.raises(ValueError, match="entries in the verdict"):
        score(KEY, _named(_claim("range_falloff", exponent={"value": [1, 2]})))


def test_the_command_makes_and_scores_and_refuses_an_old_answer(tmp_path, capsys):
    folder = tmp_path / "c"
    words = ["make", str(folder), "--seed", "1", "--effect", "none", "--scenes", "2", "--rows", "8", "--columns", "48"]
    assert main(words) == 0
    assert main(words) == 1
    assert "never overwritten" in capsys.readouterr().err
    assert main(["score", str(folder)]) == 1
    assert "no verdict" in capsys.readouterr().err
    out = folder / "out"
    out.mkdir()
    (out / "verdict.json").write_text(json.dumps({"verdict": "none", "effects": []}))
    assert main(["score", str(folder)]) == 0
    assert capsys.readouterr().out.startswith("RIGHT")
    assert json.loads((out / "score.json").read_text())["right"]
    os.utime(out / "verdict.json", (0, 0))
    with pytest.raises(ValueError, match="older than the case"):
        score_case(folder)
    with pytest.raises(FileNotFoundError, match="no key"):
        score_case(tmp_path / "other")


def test_what_is_hidden_is_not_printed(tmp_path, capsys):
    words = ["make", str(tmp_path / "c"), "--seed", "3", "--scenes", "2", "--rows", "8", "--columns", "48"]
    assert main([*words, "--effect", "beam_gain"]) == 0
    assert "beam" not in capsys.readouterr().out
    key = make_case(tmp_path / "d", seed=4, effect="random", scenes=2, rows=8, columns=48)
    assert key.case
