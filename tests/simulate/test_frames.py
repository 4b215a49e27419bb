import dataclasses
from pathlib import Path

import jax
import numpy as np
import pytest

from jaxsim.config import PrepareConfig
from jaxsim.data import open_dataset
from jaxsim.effects import EFFECTS
from jaxsim.effects.chain import SensorModel
from jaxsim.frame import Painted, PolarImage
from jaxsim.geometry import preset, window_grid
from jaxsim.simulate.folder import claim_effects
from jaxsim.simulate.frames import begin_of, simulate_batch, with_effects
from jaxsim.simulate.learned_sensor import load
from tests.export.made_trees import Six
from tests.untrained import tiny_experiment, untrained_run

GRID = window_grid(preset("vlp16"), 0.5, -0.5, columns=40)
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
    after = with_effects(MODEL, image, painted, grid=GRID, key=jax.random.key(0))
    np.testing.assert_array_equal(after.valid, image.valid)
    np.testing.assert_allclose(after.range_m[after.valid], 12.12, rtol=1e-5)
    gain = np.exp(np.linspace(-0.3, 0.3, 16))
    np.testing.assert_allclose(after.intensity[:, 0], 0.2 * gain, rtol=1e-5)


def test_a_frame_depends_on_its_key_and_time():
    image, painted = frame()
    model = SensorModel((("random_dropout", {"probability": 0.5}), ("emitter_drift", {"rate": 1.0})))

    def at(seed: int, time_s: float) -> PolarImage:
        return with_effects(model, image, painted, grid=GRID, key=jax.random.key(seed), time_s=time_s)

    first, same = at(0, 0.0), at(0, 0.0)
    other = at(1, 60.0)
    np.testing.assert_array_equal(first.valid, same.valid)
    assert (first.valid != other.valid).any()
    np.testing.assert_allclose(other.intensity[other.valid], 0.2 / np.e, rtol=1e-5)


@pytest.fixture(scope="module")
def sensor(tmp_path_factory):
    """One that sees neither colours nor classes."""
    prepare = PrepareConfig(inputs=("depth", "row"), network_size=(16, 24), depth="given")
    experiment = tiny_experiment()
    return load(
        untrained_run(tmp_path_factory.mktemp("run") / "plain", dataclasses.replace(experiment, prepare=prepare))
    )


def test_frames_of_other_rasters_are_simulated_together_as_each_alone(sensor):
    """What a frame lacks, and no input needs, is nothing in its own result, and all that it is in the others'."""
    world = open_dataset("synthetic")
    whole, bare = world[1920], world[1921]
    view = bare.camera
    bare = dataclasses.replace(bare, camera=view.replace(semantic=None, instance=None, has_image=False))
    images, painted, _ = simulate_batch(sensor, [whole, bare], 2)
    for k, frame in enumerate((whole, bare)):
        one, under, _ = simulate_batch(sensor, [frame], 2)
        np.testing.assert_allclose(images.intensity[k], one.intensity[0], atol=1e-5)
        np.testing.assert_array_equal(painted.semantic[k], under.semantic[0])
        assert painted.instance[k].any() == under.instance[0].any() == (k == 0)


def street():
    """A flat road that ends at a wall 30 m ahead: what a moved origin changes."""
    image, painted = frame()
    elevation = np.asarray(GRID.elevation_rad)[:, None]
    azimuth = np.asarray(GRID.azimuth_rad)[None, :]
    wall = 30 / (np.cos(azimuth) * np.cos(elevation))
    road = np.where(elevation < 0, 1.7 / np.maximum(-np.sin(elevation), 1e-6), np.inf)
    range_m = np.minimum(wall, road).astype(np.float32)
    return image.replace(range_m=range_m, valid=np.ones(SHAPE, bool)), painted.replace(range_m=range_m)


def test_motion_distortion_moves_ranges_by_the_frames_speed():
    model = SensorModel((("motion_distortion", {"share": 1.0}),))
    image, painted = street()

    def ranges(speed_mps: float) -> np.ndarray:
        return with_effects(model, image, painted, grid=GRID, key=jax.random.key(0), speed_mps=speed_mps).range_m

    still, fast = ranges(0.0), ranges(20.0)
    np.testing.assert_allclose(still, image.range_m, rtol=1e-5)
    # 2 m in a scan: the wall is 1 m farther where the scan begins, 1 m nearer where it ends.
    wall = np.asarray(GRID.elevation_rad) > 0
    ahead = np.cos(np.asarray(GRID.azimuth_rad))
    phase = (np.arange(40) + 0.5) / 40
    expected = (30 - 2 * (phase - 0.5)) / (ahead * np.cos(np.asarray(GRID.elevation_rad)[wall][:, None]))
    np.testing.assert_allclose(fast[wall], expected, rtol=2e-3)


def test_ambient_light_stays_in_the_world_as_the_car_turns():
    model = SensorModel((("ambient_light", {"strength": 0.95, "heading_rad": 1.2, "width_rad": 0.15}),))
    image, painted = street()
    for heading, away in ((1.2, 0.0), (1.5, -0.3)):
        after = with_effects(model, image, painted, grid=GRID, key=jax.random.key(0), heading_rad=heading)
        lost = (~after.valid).mean(0)
        middle = np.average(np.asarray(GRID.azimuth_rad), weights=lost)
        assert middle == pytest.approx(away, abs=0.06)


def test_effects_whose_frames_do_not_say_what_they_need_are_told():
    image, painted = frame()
    light = SensorModel((("ambient_light", {"strength": 0.5}),))
    with pytest.raises(ValueError, match="do not say where the car heads"):
        with_effects(light, image, painted, grid=GRID, key=jax.random.key(0))
    for name, parameter, what in (("motion_distortion", "share", "speed"), ("emitter_drift", "rate", "time")):
        with pytest.warns(UserWarning, match=f"{name} of the sensor model does nothing here.*{what}"):
            after = with_effects(
                SensorModel(((name, {parameter: 1.0}),)), image, painted, grid=GRID, key=jax.random.key(0)
            )
        np.testing.assert_allclose(after.range_m[image.valid], 12.0, rtol=1e-5)


def test_every_effect_by_speed_or_heading_says_that_it_needs_it():
    for effect in EFFECTS.values():
        needs = {"speed", "heading"} & {*effect.covariates}
        assert needs <= {effect.needs}, effect.name


def test_a_folder_holds_frames_of_one_sensor_model(tmp_path):
    claim_effects(tmp_path, MODEL)
    claim_effects(tmp_path, MODEL)
    weaker = dataclasses.replace(MODEL, effects=MODEL.effects[:1])
    for other in (None, weaker):
        with pytest.raises(ValueError, match="give another --out"):
            claim_effects(tmp_path, other)
    plain = tmp_path / "plain"
    (plain / "polar").mkdir(parents=True)
    (plain / "polar" / "a.npz").touch()
    claim_effects(plain, None)
    with pytest.raises(ValueError, match=r"effects was \[\], now \['beam_gain', 'range_scale'\]"):
        claim_effects(plain, MODEL)


def test_a_first_frame_that_cannot_be_read_is_told_with_what_it_is_needed_for():
    with pytest.raises(ValueError, match=r"time counts from the data set's first frame, which cannot be read: .*lost"):
        begin_of(Six(boxes=lambda index: Path("lost").read_bytes()))
