"""An answer of discover, for engines."""

import json

import pytest

from jaxsim.effects.chain import SensorModel

ALPHA, LOST, SD = 0.003, 0.12, 0.02


@pytest.fixture
def answer(tmp_path):
    """A sensor.json and the verdict.json beside it, as discover writes them."""
    effects = (
        ("atmospheric_extinction", {"coefficient_per_m": ALPHA}),
        ("incidence_cosine", {"exponent": 0.7}),
        ("beam_range_bias", {"bias_m": (0.02, -0.01)}),
        ("extrinsic_rotation", {"yaw_rad": 0.02, "pitch_rad": -0.01}),
        ("extrinsic_translation", {"x_m": 0.1, "y_m": 0.2}),
        ("range_gate", {"maximum_m": 80.0}),
    )
    SensorModel(effects, levels={"range_noise": SD, "random_loss": LOST}).save(tmp_path / "sensor.json")
    interval = {"value": ALPHA, "low": 0.002, "high": 0.004, "unit": "1/m"}
    vector = {"value": [0.02, -0.01], "low": [0.01, -0.02], "high": [0.03, 0.0], "unit": "m"}
    verdict = {
        "effects": [
            {"name": "atmospheric_extinction", "parameters": {"coefficient_per_m": interval}},
            {"name": "beam_range_bias", "parameters": {"bias_m": vector}},
        ],
        "levels": [{"name": "range_noise", "missing": {"value": SD, "low": 0.018, "high": 0.022, "unit": "m"}}],
    }
    (tmp_path / "verdict.json").write_text(json.dumps(verdict))
    return tmp_path / "sensor.json"
