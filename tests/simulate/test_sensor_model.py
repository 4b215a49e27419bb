import dataclasses

import jax
import numpy as np
import pytest

from jaxsim.effects.chain import SensorModel
from jaxsim.frame import Painted, PolarImage
from jaxsim.geometry import preset, window_grid
from jaxsim.simulate.effects import settle_sensor, with_effects

GRID = window_grid(preset("vlp16"), 0.5, -0.5, 40)
SHAPE = (16, 40)
MODEL = SensorModel(
    (("beam_gain", {"gain": tuple(np.linspace(-0.3, 0.3, 16).tolist())}), ("range_scale", {"scale": 0.01}))
)


def frame():
    valid = np.ones(SHAPE, bool)
    valid[:, 30:] = False
    image = PolarImage(np.full(SHAPE, 12.0, "f4"), np.full(SHAPE, 0.2, "f4"), valid)
    none = np.zeros(SHAPE, np.int32)
    painted = Painted(range_m=image.range_m, depth_m=image.range_m, rgb=np.zeros((*SHAPE, 3), "f4"), semantic=none,
                      instance=none, valid=np.ones(SHAPE, bool), occluded=np.zeros(SHAPE, bool))  # fmt: skip
    return image, painted


def test_effects_act_on_what_came_back():
    image, painted = frame()
    after = with_effects(MODEL, image, painted, GRID, key=jax.random.key(0))
    np.testing.assert_array_equal(after.valid, image.valid)
    np.testing.assert_allclose(after.range_m[after.valid], 12.12, rtol=1e-5)
    gain = np.exp(np.linspace(-0.3, 0.3, 16))
    np.testing.assert_allclose(after.intensity[:, 0], 0.2 * gain, rtol=1e-5)


def test_a_frame_depends_on_its_key_and_time():
    image, painted = frame()
    model = SensorModel((("random_dropout", {"probability": 0.5}), ("emitter_drift", {"rate": 1.0})))
    first, same, other = (
        with_effects(model, image, painted, GRID, key=jax.random.key(k), time_s=t)
        for k, t in ((0, 0.0), (0, 0.0), (1, 60.0))
    )
    np.testing.assert_array_equal(first.valid, same.valid)
    assert (first.valid != other.valid).any()
    np.testing.assert_allclose(other.intensity[other.valid], 0.2 / np.e, rtol=1e-5)


def test_a_folder_holds_frames_of_one_sensor_model(tmp_path):
    settle_sensor(tmp_path, MODEL)
    settle_sensor(tmp_path, MODEL)
    weaker = dataclasses.replace(MODEL, effects=MODEL.effects[:1])
    for other in (None, weaker):
        with pytest.raises(ValueError, match="give another --out"):
            settle_sensor(tmp_path, other)
    plain = tmp_path / "plain"
    (plain / "polar").mkdir(parents=True)
    (plain / "polar" / "a.npz").touch()
    settle_sensor(plain, None)
    with pytest.raises(ValueError, match="made with no sensor model, this run has beam_gain, range_scale"):
        settle_sensor(plain, MODEL)
