"""Regimes in the report and in the sentence."""

import json
from dataclasses import replace

import pytest

from jaxsim.discover.verdict import Interval, Regime
from jaxsim.effects.region import Region
from jaxsim.report.words import part_of, verdict_sentence
from tests.report import results


def regime(where: Region, divides: str = "time") -> Regime:
    inside, outside = (Interval(v, v - 0.1, v + 0.1, "of the fit inside") for v in (1.0, 0.02))
    return Regime(
        effect="beam_gain",
        divides=divides,
        where=where,
        share=0.5,
        inside=inside,
        outside=outside,
        p_value=0.004,
        q_value=0.02,
        judge_nats=120.0,
        applied=where.acts,
        x=(0.0, 60.0, 120.0, 180.0),
        sizes=(0.1, float("nan"), 1.1, 0.9),
        held=(False, False, True, True),
    )


def with_regime(one: Regime):
    result = results.named()
    return replace(result, verdict=replace(result.verdict, regimes=(one,)))


def test_a_regime_has_a_table_a_strip_and_a_sentence(tmp_path):
    result = with_regime(regime(Region(time_s=(90.0, None))))
    page = results.page(tmp_path, result)
    assert "Where and when it acts" in page
    assert "from 90.0 s on" in page
    assert (tmp_path / "figures" / "regime_beam_gain.svg").is_file()
    assert "beam_gain acts from 90.0 s on alone (50 % of the rays)." in verdict_sentence(result.verdict)
    results.page(tmp_path, results.named())
    assert not (tmp_path / "figures" / "regime_beam_gain.svg").exists()


def test_what_simulations_cannot_know_is_said():
    one = regime(Region(scenes=("a", "b", "c")), "scene")
    assert "simulations cannot know where" in verdict_sentence(with_regime(one).verdict)


@pytest.mark.parametrize(
    ("where", "words"),
    [
        (Region(azimuth_rad=(3.0, 3.5)), "between 172° and −159° of azimuth"),
        (Region(time_s=(None, 40.0)), "until 40.0 s"),
        (Region(time_s=(10.0, 40.0)), "from 10.0 s to 40.0 s"),
        (Region(tag="night"), "in frames tagged night"),
        (Region(scenes=("a", "b")), "in 2 drives that nothing in grid.json tells from the others"),
    ],
)
def test_a_part_in_words(where, words):
    assert part_of(regime(where)) == words


def test_verdict_json_has_the_part_and_null_where_nothing_tells_a_size():
    told = with_regime(regime(Region(time_s=(90.0, None)))).verdict.to_json()["regimes"][0]
    assert told["where"] == {"time_s": [90.0, None]}
    assert told["sizes"] == [0.1, None, 1.1, 0.9]
    json.dumps(told, allow_nan=False)
