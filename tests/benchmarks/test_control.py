"""The benchmark of controls: trees that learn a hidden world's sensor, its streets divided in three, its table."""

import numpy as np
import pytest

from benchmarks.blind import control
from benchmarks.blind.hidden import make_case
from benchmarks.blind.hidden.part import Part
from jaxsim.data.polar_frames import frame_names, read_frame

pytest.importorskip("sklearn", reason="trees are scikit-learn's: pip install 'jaxsim-lidar[trees]'")
EACH = 2
LATE = Part("time", (4, 5), None, None, ((),) * 3 * EACH)


@pytest.fixture
def case(tmp_path, monkeypatch):
    monkeypatch.setattr(control, "EACH", EACH)
    folder = tmp_path / "case"
    key = make_case(folder, effect="range_offset", severity=40, seed=3, scenes=3 * EACH, rows=12, columns=64, part=LATE)
    return folder, key


def errors(simulated, measured, name):
    ours, theirs = (read_frame(folder, name)[0] for folder in (simulated, measured))
    both = (ours.range_m > 0) & (theirs.range_m > 0) & (np.abs(ours.range_m - theirs.range_m) < 1)
    return np.median((theirs.range_m - ours.range_m)[both])


def test_the_effect_is_in_the_last_streets_alone(case):
    folder, key = case
    [effect] = key.effects
    names = frame_names(folder / "measured")
    moved = np.array([errors(folder / "simulated", folder / "measured", name) for name in names])
    offset = effect["parameters"]["offset_m"]
    assert abs(offset) > 0.2
    np.testing.assert_allclose(moved[: 2 * EACH], 0, atol=0.06)
    np.testing.assert_allclose(moved[2 * EACH :], offset, atol=0.06)


def test_trees_stand_in_the_simulated_frames_and_know_the_sensor_better_than_a_constant(case):
    folder, _ = case
    before = {name: read_frame(folder / "simulated", name)[0] for name in frame_names(folder / "simulated")}
    error = control.learn(folder, angles=True)
    spread = []
    for name in frame_names(folder / "simulated")[EACH : 2 * EACH]:
        now, _ = read_frame(folder / "simulated", name)
        np.testing.assert_array_equal(now.range_m, before[name].range_m)
        assert not np.array_equal(now.intensity, before[name].intensity)
        measured = read_frame(folder / "measured", name)[0].intensity
        logs = np.log(measured[measured > 0])
        spread.append(np.abs(logs - np.median(logs)).mean())
    assert error < np.mean(spread)


def test_streets_are_divided_in_three(case):
    folder, _ = case
    names = frame_names(folder / "measured")
    for part, name in enumerate(("control", "now"), 1):
        simulated, measured = control.divide(folder, name, part)
        assert frame_names(simulated) == frame_names(measured) == names[part * EACH : (part + 1) * EACH]
    assert frame_names(folder / "measured") == names[:EACH]


def test_the_table_holds_both_answers_side_by_side():
    wrong = {"verdict": "named", "answer": ["gamma_response"], "named": True, "first_right": False}
    wrong |= {"false_names": ["gamma_response"]}
    right = {"verdict": "named", "answer": ["beam_gain"], "named": True, "first_right": True, "false_names": []}
    none = {"verdict": "none", "answer": [], "named": False, "first_right": False, "false_names": []}
    rows = [
        {"key": "a", "kind": "null", "truth": "none", "control": [], "alone": wrong, "beside": none},
        {"key": "b", "kind": "single", "truth": "beam_gain", "control": ["snr"], "alone": wrong, "beside": right},
    ]
    text = control.summary(rows)
    assert "| nulls: an effect named | 100 % (1 of 1; 21 to 100 %) | 0 % (0 of 1; 0 to 79 %) |" in text
    assert "| effects: right first | 0 % (0 of 1; 0 to 79 %) | 100 % (1 of 1; 21 to 100 %) |" in text
    assert "| beam_gain | snr | gamma_response | beam_gain |" in text
    assert "| none | - | gamma_response | none |" in text
