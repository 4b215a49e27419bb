"""Hidden attributes of CARLA's law, from buffers to buffers: discovered, written, simulated again."""

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.blind import carla_round_trip
from benchmarks.blind.carla import buffers, law, street
from benchmarks.blind.carla_round_trip import distances, run, summary, write_recordings
from jaxsim.data.polar_frames import open_polar_frames
from jaxsim.discover import discover_folders
from jaxsim.effects.chain import SensorModel
from jaxsim.engines import ENGINES, read_answer, translate
from jaxsim.engines.carla import nearest_drop_off

HIDDEN = {"atmosphere_attenuation_rate": 0.012, "dropoff_general_rate": 0.25, "range": 30.0}
FEW = ("atmospheric_extinction", "random_dropout", "material_dropout", "range_gate")
RAY = buffers.rays(16, 96)


def few_effects(words):
    """`jaxsim discover` with few candidates, which are fitted in seconds."""
    if words[0] != "discover":
        return command(words)
    simulated, measured, out = (Path(words[words.index(flag) + 1]) for flag in ("--simulated", "--measured", "--out"))
    result = discover_folders(simulated=simulated, measured=measured, effects=FEW)
    result.effects_model.save(out / "sensor.json")
    result.verdict.save(out)
    return None


command = carla_round_trip.jaxsim


@pytest.mark.slow  # A minute and a half of processor time: its parts are tested below, in a second.
def test_what_a_law_hides_is_discovered_written_and_gone_when_simulated_again(
    tmp_path, monkeypatch, standard_promotion
):
    monkeypatch.setattr(carla_round_trip, "jaxsim", few_effects)
    monkeypatch.setattr(law, "hidden_attributes", lambda seed: HIDDEN)
    row = run(5, tmp_path, scenes=12, fresh=4, ray=RAY)
    # The longest range makes classes that lie far away lose more: losses may be named by class, of which CARLA has the
    # mean.
    losses = {"random_dropout", "material_dropout"} & set(row["named"])
    assert set(row["named"]) == {"atmospheric_extinction", "range_gate"} | losses
    assert len(losses) == 1
    assert row["cannot"] == []
    for name, value in HIDDEN.items():
        assert row["written"][name] == pytest.approx(value, rel=0.1), name
    assert row["after"]["intensity"] < 0.05 * row["before"]["intensity"]
    assert row["after"]["returns"] < 0.2 * row["before"]["returns"]
    assert row["again"]["intensity"] == 0
    assert "0.012" in summary([row])


def test_recordings_are_read_a_scene_a_folder(tmp_path):
    write_recordings(tmp_path, 0, {}, scenes=2, ray=RAY)
    command(["frames", str(tmp_path / "simulated_raw"), "--out", str(tmp_path / "simulated")])
    frames = open_polar_frames(tmp_path / "simulated")
    assert frames.names == ("street00_000000", "street01_000000")
    assert [frames.about[name]["scene"] for name in frames.names] == ["street00", "street01"]
    image, rasters = frames.read("street01_000000")
    seen = street.look(RAY, np.random.default_rng([0, 2, 1]))
    expected = np.where(seen.distance_m <= 120, seen.distance_m, 0)
    np.testing.assert_allclose(np.where(image.valid, image.range_m, 0), expected, rtol=1e-5)
    np.testing.assert_allclose(np.cos(rasters["incidence"])[image.valid], seen.cosine[image.valid], atol=1e-3)


def test_recordings_of_different_sensors_are_no_log(tmp_path):
    write_recordings(tmp_path, 0, {}, scenes=2, ray=RAY)
    about = tmp_path / "simulated_raw/street01/attributes.json"
    about.write_text(json.dumps(json.loads(about.read_text()) | {"channels": "8"}))
    with pytest.raises(SystemExit, match="are of different sensors"):
        command(["frames", str(tmp_path / "simulated_raw"), "--out", str(tmp_path / "simulated")])


def told(path, effects, levels=None):
    SensorModel(effects, levels=levels or {}).save(path)
    answer = translate(read_answer(path), "carla", ENGINES["carla"])
    return {key: float(value) for key, value in json.loads(answer.text)["attributes"].items()}


def test_the_effects_of_hidden_attributes_are_written_as_these_attributes(tmp_path):
    lacks = (("atmospheric_extinction", {"coefficient_per_m": (0.012 - 0.004) / 2}),)
    written = told(tmp_path / "sensor.json", lacks, {"random_loss": 0.25, "range_noise": 0.04})
    assert written == {
        "atmosphere_attenuation_rate": 0.012,
        "dropoff_general_rate": 0.25,
        "noise_stddev": 0.04,
    }
    gap = distances(written, written | {"noise_stddev": 0.0}, seed=0, fresh=2, ray=RAY)
    assert gap["intensity"] == 0
    assert gap["range_m"] == pytest.approx(0.04, rel=0.1)


def test_a_sharp_threshold_on_power_is_a_longest_range_in_carla(tmp_path):
    at_40_m = -0.004 * 40 - 2 * np.log(40 / 10)
    written = told(tmp_path / "sensor.json", (("snr_dropout", {"threshold": at_40_m, "width": 0.1}),))
    assert written == {"range": pytest.approx(40, rel=0.02)}
    # A width that is not given is the catalogue's, and no reason to leave the threshold out.
    written = told(tmp_path / "sensor.json", (("snr_dropout", {"threshold": at_40_m}),))
    assert written == {"range": pytest.approx(40, rel=0.02)}


def test_losses_below_an_intensity_are_carlas_own_two_attributes(tmp_path):
    lacks = ("snr_dropout", {"limit": 0.7, "zero_loss": 0.6})
    written = told(tmp_path / "sensor.json", (lacks,))
    assert written == {"dropoff_intensity_limit": pytest.approx(0.7), "dropoff_zero_intensity": pytest.approx(0.6)}
    # Beside a threshold on the power that loses rays within reach, what comes nearest to both.
    both = told(tmp_path / "sensor.json", ((lacks[0], lacks[1] | {"threshold": -6.0, "width": 1.0}),))
    assert both["dropoff_zero_intensity"] > 0.7


def test_a_soft_threshold_becomes_carlas_losses_by_intensity():
    """Of CARLA's own law the very numbers come back."""
    intensity = np.exp(-0.02 * np.geomspace(2, 120, 80))
    lost = 1 - 0.8 * np.where(intensity > 0.7, 1, 1 - 0.6 + 0.6 / 0.7 * intensity)
    found = nearest_drop_off(lost, intensity)
    assert (found.general, found.zero) == pytest.approx((0.2, 0.6), abs=0.02)
    assert found.limit == pytest.approx(0.7, abs=0.02)


@pytest.mark.parametrize(("threshold", "width"), [(-2.0, 1.0), (-5.0, 2.0)])
def test_the_nearest_losses_are_those_that_a_search_of_all_finds(threshold, width):
    range_m = np.geomspace(2, 120, 80)
    intensity = np.exp(-0.02 * range_m)
    lost = 1 - 1 / (1 + np.exp(-(np.log(intensity) - 2 * np.log(range_m / 10) - threshold) / width))
    shares = np.linspace(0, 1, 51)
    general, zero, limit = np.meshgrid(shares, shares, shares[1:], indexing="ij")
    faint = np.maximum(1 - intensity / limit[..., None], 0)
    off = ((1 - (1 - general[..., None]) * (1 - zero[..., None] * faint) - lost) ** 2).sum(-1)
    assert nearest_drop_off(lost, intensity).off < 1.01 * off.min()


def test_losses_by_class_become_their_mean(tmp_path):
    per_class = [0.0] * 34
    per_class[7] = per_class[11] = 0.3
    ends = {"low": [0.28 if p else 0.0 for p in per_class], "high": [0.32 if p else 0.5 for p in per_class]}
    verdict = {"effects": [{"name": "material_dropout", "parameters": {"probability": ends}}]}
    (tmp_path / "verdict.json").write_text(json.dumps(verdict))
    written = told(tmp_path / "sensor.json", (("material_dropout", {"probability": tuple(per_class)}),))
    assert written == {"dropoff_general_rate": pytest.approx(0.3)}


def test_without_a_verdict_classes_that_lose_nothing_thin_out_no_mean(tmp_path):
    per_class = [0.0] * 34
    per_class[26] = 0.4
    written = told(tmp_path / "sensor.json", (("material_dropout", {"probability": tuple(per_class)}),))
    assert written == {"dropoff_general_rate": pytest.approx(0.4)}
