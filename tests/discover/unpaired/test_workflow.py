"""Different streets on the two sides: what can be told is named, what cannot is not, and the answer says so."""

import json

import numpy as np
import pytest

from benchmarks.blind.hidden.streets import make_unpaired
from jaxsim.cli import discover as command
from jaxsim.cli import stop_on_error
from jaxsim.discover import discover_unpaired
from jaxsim.discover.name.select import Step
from jaxsim.discover.show.explain import ranking
from jaxsim.discover.unpaired.read import read_unpaired
from jaxsim.discover.unpaired.select import UnpairedChoice
from jaxsim.discover.unpaired.workflow import divide, why_not_unpaired
from jaxsim.effects.chain import SensorModel
from tests.discover.unpaired.made import RAYS, SMALL, candidate

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def gains(tmp_path_factory, standard_promotion):
    folder = tmp_path_factory.mktemp("streets") / "case"
    key = make_unpaired(folder, effect="beam_gain", severity=4.0, seed=5, **SMALL)
    return key, folder, discover_unpaired(simulated=folder / "simulated", measured=folder / "measured", per_scene=RAYS)


def answer(tmp_path, **case):
    folder = tmp_path / "case"
    make_unpaired(folder, **case, **SMALL)
    return discover_unpaired(simulated=folder / "simulated", measured=folder / "measured", per_scene=RAYS)


def test_hidden_beam_gains_are_named_and_measured(gains):
    key, _, result = gains
    assert result.verdict.verdict == "named"
    assert result.verdict.effects[0].name == "beam_gain"
    truth = np.asarray(key.effects[0]["parameters"]["gain"])
    found = np.asarray(dict(result.effects_model.effects)["beam_gain"]["gain"])
    seen = np.isfinite(found) & (found != 0)
    assert np.corrcoef(truth[seen], found[seen])[0, 1] > 0.7


def test_the_gap_shrinks_on_streets_that_nothing_was_fitted_to(gains):
    gap = gains[2].verdict.gap["intensity"]
    assert gap.after < gap.before
    assert gap.low > 0


def test_the_sensor_holds_what_was_named(gains):
    assert dict(gains[2].effects_model.effects) == {one.name: one.values for one in gains[2].verdict.effects}


def test_the_answer_says_that_streets_differ_and_what_cannot_be_told(gains):
    notes = " ".join(gains[2].verdict.notes)
    assert "different streets" in notes
    assert "motion_distortion" in notes
    assert "beam_gain" not in notes


def test_the_command_writes_a_report_that_says_so(gains, tmp_path, monkeypatch):
    _, folder, result = gains
    monkeypatch.setattr("jaxsim.discover.discover_unpaired", lambda *, simulated, measured, log: result)
    command.Discover(
        measured=folder / "measured", simulated=folder / "simulated", out=tmp_path / "out", unpaired=True
    )()
    assert "different streets" in (tmp_path / "out" / "report.html").read_text()
    verdict = json.loads((tmp_path / "out" / "verdict.json").read_text())
    assert set(verdict["gap"]) == {"intensity", "range", "drop", "closure"}
    assert verdict["gap"]["range"] is None
    assert SensorModel.load(tmp_path / "out" / "sensor.json", rows=SMALL["rows"]) == result.effects_model


def test_a_hidden_falloff_is_named(tmp_path, standard_promotion):
    verdict = answer(tmp_path, effect="range_falloff", severity=8.0, seed=6).verdict
    assert verdict.effects
    first = verdict.effects[0]
    assert "range_falloff" in (first.name, *first.look_alikes)


@pytest.mark.parametrize("effect", ["none", "beam_range_bias"])
def test_nothing_is_named_where_nothing_can_be_told(tmp_path, standard_promotion, effect):
    verdict = answer(tmp_path, effect=effect, severity=4.0, seed=7).verdict
    assert verdict.verdict == "none"
    assert any("beam_range_bias" in note for note in verdict.notes)


def test_too_few_streets(tmp_path, standard_promotion):
    folder = tmp_path / "case"
    make_unpaired(folder, seed=1, **SMALL | {"scenes": 7})
    with pytest.raises(SystemExit) as stop, stop_on_error():
        command.Discover(
            measured=folder / "measured", simulated=folder / "simulated", out=tmp_path / "out", unpaired=True
        )()
    assert "7 simulated scenes; where the streets differ each side needs 8" in str(stop.value)


def test_eight_streets_a_side_are_enough(tmp_path, standard_promotion):
    folder = tmp_path / "case"
    make_unpaired(folder, seed=1, **SMALL | {"scenes": 8})
    parts, find = divide(read_unpaired(folder / "simulated", folder / "measured"))
    assert (len(parts.find), len(parts.judge), int(find.sum())) == (10, 6, 10)


def test_frames_of_the_same_readings_are_an_error(gains):
    _, folder, _ = gains
    with pytest.raises(ValueError, match="the same readings"):
        read_unpaired(folder / "measured", folder / "measured")


def test_a_ranking_says_why_not():
    best = candidate("beam_gain", 3.0)
    by_chance = candidate("range_falloff", 1.0, chance=0.5)
    choice = UnpairedChoice((Step(best, (), (best, by_chance)),), ())
    assert why_not_unpaired(best, choice) == ""
    assert "scenes exchanged between the sides reach as much (p 0.5, must be 0.01)" in why_not_unpaired(
        by_chance, choice
    )
    assert [rank.name for rank in ranking(choice, why_not_unpaired)] == ["beam_gain", "range_falloff"]
