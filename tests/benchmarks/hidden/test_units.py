"""The oracle's test statistic and the committed table."""

import json

import pytest

from benchmarks.blind.hidden.case import look_at, make_setting, measure, plant, predict
from benchmarks.blind.hidden.catalogue import EFFECTS, OUTSIDE, UNITS_FILE, Choice, amount_of, unit_of
from benchmarks.blind.hidden.units import noncentrality, oracle_power


@pytest.fixture(scope="module")
def street():
    setting = make_setting((8, 6), "default", 2, 1, 16, 96)
    simulated = predict(setting)
    return setting, simulated, measure(setting, simulated, [])


def _see(street, name, severity):
    setting, simulated, base = street
    plans, _ = plant(Choice((name,)), severity, setting, look_at(setting, simulated))
    return noncentrality(base, measure(setting, simulated, plans), setting.nuisance)


def test_nothing_planted_is_nothing_seen(street):
    assert noncentrality(street[2], street[2], street[0].nuisance) == 0


@pytest.mark.parametrize("name", ["range_falloff", "range_scale", "random_dropout", "range_noise", "interference"])
def test_more_is_seen_of_more(street, name):
    seen = [_see(street, name, s) for s in (0.5, 1, 2)]
    assert 0 < seen[0] < seen[1] < seen[2]


def test_the_table_has_a_row_for_all_that_can_be_hidden_and_the_command_that_made_it():
    table = json.loads(UNITS_FILE.read_text())
    assert table["command"] == "python -m benchmarks.blind.hidden units"
    assert set(table["units"]) == {*EFFECTS, *OUTSIDE}
    for name, row in table["units"].items():
        assert row["unit"] == pytest.approx(max(row["oracle"], row["floor"]))
        floor = EFFECTS[name].floor if name in EFFECTS else OUTSIDE[name].floor
        assert row["floor"] == pytest.approx(floor, rel=0.01)
        assert amount_of(name, 2) == pytest.approx(2 * unit_of(name))


def test_the_oracle_detects_its_own_size_half_the_time_and_nothing_at_the_tests_level():
    table = json.loads(UNITS_FILE.read_text())["units"]
    found = {"name": "retroreflection", "amount": table["retroreflection"]["oracle"]}
    assert oracle_power({"effects": [found], "outside": None}) == pytest.approx(0.5, abs=1e-3)
    assert oracle_power({"effects": [found, found], "outside": None}) > 0.7
    assert oracle_power({"effects": [], "outside": None}) == pytest.approx(0.05, abs=1e-3)
    assert oracle_power({"effects": [], "outside": {"name": "hue_gain", "amount": 0.08}}) > 0.99
    assert oracle_power({"effects": [{"name": "range_quantization", "amount": 0.01}], "outside": None}) == 1
