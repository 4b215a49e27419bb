"""How often gates turn red: thresholds from what was before, and the table, on numbers made up."""

import numpy as np
import pytest

from benchmarks.blind.gates import EFFECTS, RULES, colour_of_answer, colours, halves, jobs, of_answers, summary
from jaxsim.effects import EFFECTS as CATALOGUE


def case(effect="none", seed=1, simulator="ideal", before=0.1, after=0.1):
    """Eight streets that scatter by a hundredth, four before and four judged."""
    scatter = np.array([-0.01, 0.01, -0.005, 0.005])
    streets = np.concatenate([before + scatter, after + scatter])
    return {
        "effect": effect,
        "seed": seed,
        "simulator": simulator,
        "kind": "none",
        "streets": [[value, value / 10, value / 5] for value in streets.tolist()],
    }


def test_each_sensor_is_asked_as_it_is_and_the_first_with_an_effect_since():
    planned = jobs(10, ("beam_gain", "range_noise"), 4.0)
    nulls = [job for job in planned if job["effect"] == "none"]
    planted = [job for job in planned if job["effect"] != "none"]
    assert len(nulls) == 20
    assert {(job["effect"], job["simulator"]) for job in planted} == {
        (effect, simulator) for effect in ("beam_gain", "range_noise") for simulator in ("ideal", "noisy")
    }
    known = {(job["seed"], job["simulator"], job["nuisance"]) for job in nulls}
    assert all((job["seed"], job["simulator"], job["nuisance"]) in known for job in planted)
    assert {*EFFECTS} <= {*CATALOGUE}


def test_streets_before_and_after_are_told_apart():
    before, after = halves(case(before=0.1, after=0.2))
    assert before["intensity"].value == pytest.approx(0.1)
    assert after["intensity"].value == pytest.approx(0.2)
    assert after["range"].value == pytest.approx(0.02)


def test_what_grew_turns_red_and_what_did_not_stays_green():
    rows = [case(), case(effect="beam_gain", after=0.2), case(seed=2, after=0.101)]
    for rule in RULES.values():
        told = colours(rows, "ideal", rule)
        assert told[1] == ("beam_gain", "gap")
        assert told[0][1] == "pass"
    assert colours(rows, "ideal", RULES["the mean before"])[2][1] == "unsure"
    assert colours(rows, "ideal", RULES["the upper end of its interval"])[2][1] == "pass"


def test_the_table_counts_nulls_and_names_what_is_not_seen():
    rows = [case(), case(effect="beam_gain", after=0.2), case(effect="incidence_cosine")]
    rows += [row | {"simulator": "noisy"} for row in rows]
    text = summary(rows)
    assert "0 % (0 of 1;" in text
    assert "1 of 2, not incidence_cosine" in text
    assert len(text.splitlines()) == 2 + 2 * len(RULES)


def answered(verdict, kind="none", severity=1.0, *, nats=0.0, **gains):
    row = {"kind": kind, "severity": severity, "verdict": verdict, "answer": list(gains), "ranking": [["fog", 9.0]]}
    return row | {"gained": {"intensity": [nats, 5.0, 0.0], "drop": [0.1, 9.0, 0.0]}, "gains": gains}


def test_whole_answers_are_red_where_something_is_certain():
    nulls = [answered("none"), answered("named", blooming=1.0), answered("not_in_catalogue", nats=2.6)]
    single = [answered("named", "single", severity, beam_gain=30.0) for severity in (1.0, 2.0)]
    text = of_answers([*nulls, answered("not_in_catalogue", nats=2.3), *single])
    assert "nulls gap: 25 % (1 of 4;" in text
    assert "nulls unsure: 50 % (2 of 4;" in text
    assert "or more gap: 100 % (1 of 1;" in text
    # Rows of before hold gains in the first ranking alone, which has others too.
    old = {"kind": "none", "verdict": "named", "answer": ["blooming"], "ranking": [["fog", 9.0], ["blooming", 2.0]]}
    assert colour_of_answer(old) == "unsure"
    assert colour_of_answer(old | {"answer": ["fog"]}) == "gap"
