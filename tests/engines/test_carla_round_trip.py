"""An answer that is right, written for CARLA and simulated again by CARLA's law, closes the gap."""

import json

import numpy as np

from jaxsim.discover.gate import quick_distances
from jaxsim.effects.chain import SensorModel
from jaxsim.engines import ENGINES, read_answer, translate
from tests.discover.test_gate import COLUMNS, ROWS, write
from tests.engines.carla_law import ray_cast

HIDDEN = {"atmosphere_attenuation_rate": 0.012, "dropoff_general_rate": 0.25, "noise_stddev": 0.04}


def test_the_effects_of_hidden_attributes_are_written_as_these_attributes(tmp_path):
    rng = np.random.default_rng(0)
    streets = rng.uniform(3, 60, (8, ROWS, COLUMNS))
    scenes = [f"drive{k}" for k in range(len(streets))]
    write(tmp_path / "measured", [ray_cast(street, rng, **HIDDEN) for street in streets], scenes)
    write(tmp_path / "before", [ray_cast(street, rng) for street in streets], scenes)
    # In our words: an extinction of half the rate that CARLA's default lacks, losses and noise.
    lacks = (("atmospheric_extinction", {"coefficient_per_m": (0.012 - 0.004) / 2}),)
    SensorModel(lacks, levels={"random_loss": 0.25, "range_noise": 0.04}).save(tmp_path / "sensor.json")
    told = translate(read_answer(tmp_path / "sensor.json"), "carla", ENGINES["carla"])
    written = {key: float(value) for key, value in json.loads(told.text)["attributes"].items()}
    assert written == HIDDEN
    write(tmp_path / "after", [ray_cast(street, rng, **written) for street in streets], scenes)
    before = quick_distances(tmp_path / "before", tmp_path / "measured")
    after = quick_distances(tmp_path / "after", tmp_path / "measured")
    # Intensity has no noise in CARLA: it is the same again. What is random is alike in its share alone.
    assert before["intensity"].value > 0.1
    assert after["intensity"].value < 1e-6
    returned = [
        np.mean([np.load(path)["range"] > 0 for path in sorted((tmp_path / side).glob("*.npz"))])
        for side in ("before", "after", "measured")
    ]
    assert abs(returned[1] - returned[2]) < 0.03 < abs(returned[0] - returned[2])
