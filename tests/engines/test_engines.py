"""Answers in engines' parameters: numbers that the engine's own law turns back into the effect."""

import json
import xml.etree.ElementTree as ET

import numpy as np
import pytest

from jaxsim.effects.catalogue import EFFECTS
from jaxsim.effects.chain import LEVELS, SensorModel
from jaxsim.effects.region import Region
from jaxsim.engines import ENGINES, read_answer, translate
from tests.engines.made import ALPHA, LOST, SD


def settings(path, name, **now):
    told = translate(read_answer(path), name, ENGINES[name], now=now)
    return {one.name: one for one in told.settings}, told


def test_carlas_law_gives_the_effects_back(answer):
    found, told = settings(answer, "carla")
    rate = found["atmosphere_attenuation_rate"].value
    distance = np.linspace(1, 100, 50)
    # exp(-a d) of CARLA's source, against ours on top of its default 0.004.
    ours = np.exp(-0.004 * distance) * np.exp(-2 * ALPHA * distance)
    np.testing.assert_allclose(np.exp(-rate.value * distance), ours, rtol=1e-6)
    assert (rate.low, rate.high) == pytest.approx((0.008, 0.012))
    assert found["dropoff_general_rate"].value.value == pytest.approx(LOST)
    assert found["noise_stddev"].value == pytest.approx((SD, 0.018, 0.022))
    assert found["range"].value.value == 80
    assert np.isnan(found["range"].value.low)
    # CARLA's y points to the right, its yaw turns clockwise, its pitch lifts the nose.
    assert found["transform.y"].value.value == pytest.approx(-0.2)
    assert found["transform.yaw"].value.value == pytest.approx(-np.rad2deg(0.02))
    assert found["transform.pitch"].value.value == pytest.approx(np.rad2deg(0.01))
    assert set(told.cannot) == {"incidence_cosine", "beam_range_bias"}
    plain = json.loads(told.text)
    assert float(plain["attributes"]["noise_stddev"]) == pytest.approx(SD)
    assert plain["add_to_transform"]["x"] == pytest.approx(0.1)


def test_what_an_engine_has_now_is_counted(answer):
    found, _ = settings(answer, "carla", atmosphere_attenuation_rate=0.0, noise_stddev=0.015, dropoff_general_rate=0.5)
    assert found["atmosphere_attenuation_rate"].value.value == pytest.approx(2 * ALPHA)
    assert found["noise_stddev"].value.value == pytest.approx(0.025)
    assert found["dropoff_general_rate"].value.value == pytest.approx(1 - 0.5 * (1 - LOST))


def test_isaacs_emitters_have_a_value_each(answer):
    found, told = settings(answer, "isaac")
    assert found["omni:sensor:Core:rangeAccuracyM"].value.value == pytest.approx(SD)
    each = found["omni:sensor:Core:emitterState:s001:distanceCorrectionM"].each
    assert [e.value for e in each] == pytest.approx([-0.02, 0.01])
    assert (each[0].low, each[0].high) == pytest.approx((-0.03, -0.01))
    assert told.text.startswith("#usda 1.0")
    assert "float omni:sensor:Core:farRangeM = 80" in told.text


def test_rgls_noise_node(answer):
    found, told = settings(answer, "rgl")
    assert found["distance.mean"].value.value == pytest.approx(0.005)
    assert told.text.endswith("rgl_node_gaussian_noise_distance(&noise, 0.005f, 0.02f, 0.0f);\n")


def test_gazebos_sdf_and_helios_xml_are_whole(answer):
    lidar = ET.fromstring(settings(answer, "gazebo")[1].text)
    assert float(lidar.findtext("noise/stddev")) == pytest.approx(SD)
    assert lidar.findtext("noise/type") == "gaussian"
    assert float(lidar.findtext("range/max")) == 80
    scanner = ET.fromstring(settings(answer, "helios")[1].text)
    assert float(scanner.get("accuracy_m")) == pytest.approx(SD)
    # Koschmieder: 3.91 over the visibility in kilometres is the extinction in 1/km.
    assert 3.912 / float(scanner.get("atmosphericVisibility_km")) == pytest.approx(1000 * ALPHA, rel=1e-3)


def test_haze_that_may_be_none_has_no_farthest_sight(tmp_path):
    alpha = {"value": 0.003, "low": -0.001, "high": 0.007}
    SensorModel((("atmospheric_extinction", {"coefficient_per_m": 0.003}),)).save(tmp_path / "sensor.json")
    verdict = {"effects": [{"name": "atmospheric_extinction", "parameters": {"coefficient_per_m": alpha}}]}
    (tmp_path / "verdict.json").write_text(json.dumps(verdict))
    [sight] = translate(read_answer(tmp_path / "sensor.json"), "helios", ENGINES["helios"]).settings
    assert sight.value.low == pytest.approx(3.912 / 7, rel=1e-3)
    assert sight.value.high == float("inf")


def test_haze_that_a_simulator_has_and_the_street_had_not_is_taken_back_or_said(tmp_path):
    SensorModel((("atmospheric_extinction", {"coefficient_per_m": -0.002}),)).save(tmp_path / "sensor.json")
    answer = read_answer(tmp_path / "sensor.json")

    def told(name):
        return translate(answer, name, ENGINES[name])

    # CARLA's frames have exp(-0.004 r) by default, which is more than the street had by 2 x 0.002.
    rate = next(one for one in told("carla").settings if one.name == "atmosphere_attenuation_rate")
    assert rate.value.value == pytest.approx(0.0, abs=1e-9)
    assert "less than none" not in rate.why
    more = translate(answer, "carla", ENGINES["carla"], now={"atmosphere_attenuation_rate": 0.001}).settings
    [rate] = [one for one in more if one.name == "atmosphere_attenuation_rate"]
    assert rate.value.value == 0
    assert "less than none" in rate.why
    assert "atmosphericVisibility_km" not in told("helios").text
    assert told("helios").cannot["atmospheric_extinction"].startswith("the frames that were compared have haze")


@pytest.mark.parametrize("name", ENGINES)
def test_nothing_that_was_found_is_passed_over(name, tmp_path):
    """Every effect of the catalogue and every level is a parameter, or is said to be none."""
    engine = ENGINES[name]
    known = set(EFFECTS) | set(LEVELS)
    assert engine.expresses <= known
    assert set(engine.instead) <= known
    effects = tuple((effect, {}) for effect in EFFECTS)
    SensorModel(effects, levels={"intensity_step": 0.01}).save(tmp_path / "sensor.json")
    told = translate(read_answer(tmp_path / "sensor.json"), name, engine)
    assert set(told.cannot) == (set(EFFECTS) | {"intensity_step"}) - engine.expresses
    assert all(one.why for one in told.settings)


def test_an_effect_of_a_part_is_no_parameter_that_holds_everywhere(tmp_path):
    lost = ("random_dropout", {"probability": 0.3})
    part = {"random_dropout": Region(azimuth_rad=(0.0, 0.5))}
    SensorModel((lost,), regions=part).save(tmp_path / "sensor.json")
    found, told = settings(tmp_path / "sensor.json", "carla")
    assert not found
    assert told.cannot["random_dropout"].startswith("it acts in a part alone")


def test_an_open_end_of_the_ranges_is_not_written_and_a_shortest_range_not_lost(tmp_path):
    gate = ("range_gate", {"minimum_m": 3.0, "maximum_m": 200.0})
    SensorModel((gate,)).save(tmp_path / "sensor.json")
    for name, ends in (("gazebo", {"range.min"}), ("helios", {"rangeMin_m"}), ("carla", set())):
        found, told = settings(tmp_path / "sensor.json", name)
        assert set(found) == ends
        assert set(told.cannot) == (set() if ends else {"range_gate.minimum_m"})


def test_what_an_engine_has_now_is_refused_where_nothing_is_made_of_it(answer):
    with pytest.raises(ValueError, match=r"of noise in --now nothing is made for CARLA; it may hold atmosphere_"):
        settings(answer, "carla", noise=0.01)
    with pytest.raises(ValueError, match=r"of noise_stddev in --now nothing is made for RGL; leave --now out"):
        settings(answer, "rgl", noise_stddev=0.01)


def test_intervals_of_another_answer_are_not_taken(answer):
    """Nor is a vector that was cut to fewer beams."""
    verdict = json.loads((answer.parent / "verdict.json").read_text())
    verdict["effects"][0]["parameters"]["coefficient_per_m"] = {"value": 0.1, "low": 0.09, "high": 0.11}
    (answer.parent / "verdict.json").write_text(json.dumps(verdict))
    found, told = settings(answer, "carla")
    assert np.isnan(found["atmosphere_attenuation_rate"].value.low)
    assert found["noise_stddev"].value == pytest.approx((SD, 0.018, 0.022))
    assert "No intervals of atmospheric_extinction.coefficient_per_m" in told.notes[-1]
    verdict["effects"][1]["parameters"]["bias_m"] = {"value": [0.02] * 64, "low": [0.01] * 64, "high": [0.03] * 64}
    (answer.parent / "verdict.json").write_text(json.dumps(verdict))
    with pytest.raises(ValueError, match=r"beam_range_bias\.bias_m has 2 numbers, but .*json 64: one .* was cut"):
        read_answer(answer)


@pytest.mark.parametrize(
    ("content", "wrong"),
    [
        ([], "of another kind"),
        ({"levels": None}, "of another kind"),
        ({"levels": [{"name": "range_noise"}]}, "lacks 'missing'"),
        ({"levels": [3]}, "of another kind"),
        ({"effects": {"beam_gain": {}}}, "of another kind"),
        ({"effects": [{"name": "beam_range_bias", "parameters": None}]}, "of another kind"),
        ({"effects": [{"parameters": {}}]}, "lacks 'name'"),
    ],
)
def test_a_verdict_that_is_none_is_refused_in_a_line(answer, content, wrong):
    (answer.parent / "verdict.json").write_text(json.dumps(content))
    with pytest.raises(ValueError, match=rf"verdict\.json is not what .* writes: .*{wrong}; move it away, or run it"):
        read_answer(answer)
