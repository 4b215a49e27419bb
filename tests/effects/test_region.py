"""Effects act where their region says, and nowhere else."""

import json
from dataclasses import replace

import jax
import numpy as np
import pytest

from jaxsim.effects import EFFECTS, all_rays
from jaxsim.effects.chain import SensorModel
from jaxsim.effects.region import Region, within
from jaxsim.effects.street import small_street

pytestmark = pytest.mark.usefixtures("standard_promotion")
GAIN = ("random_dropout", {"probability": 0.5})


@pytest.fixture(scope="module")
def street(standard_promotion):
    scan = small_street()
    frames = scan.range_m.shape[0]
    return replace(scan, time_s=10.0 * np.arange(frames, dtype=np.float32), tags={"night": np.arange(frames) == 0})


def lost(street, region):
    """Which rays the effect reaches."""
    model = SensorModel((GAIN,), regions={"random_dropout": region})
    rays = all_rays(street)
    return np.asarray(model.apply(rays, street).log_keep < rays.log_keep - 0.1), rays


def test_a_sector_may_run_across_the_rear(street):
    reached, rays = lost(street, Region(azimuth_rad=(3.0, 3.5)))
    azimuth = np.asarray(rays.azimuth_rad)
    expected = (azimuth >= 3.0) | (azimuth <= 3.5 - 2 * np.pi)
    assert np.array_equal(reached, expected & np.asarray(rays.hit) | reached & ~np.asarray(rays.hit) & expected)


def test_a_span_of_time_ends_before_its_end(street):
    reached, rays = lost(street, Region(time_s=(None, 10.0)))
    assert not reached[np.asarray(rays.time_s) >= 10.0].any()
    assert reached[np.asarray(rays.time_s) < 10.0].any()


@pytest.mark.parametrize(("region", "some"), [(Region(tag="night"), True), (Region(tag="rain"), False)])
def test_a_tag_reaches_the_frames_that_have_it(street, region, some):
    reached, rays = lost(street, region)
    assert reached[np.asarray(rays.frame) == 0].any() == some
    assert not reached[np.asarray(rays.frame) > 0].any()


def test_drives_by_name_are_not_applied(street):
    assert not lost(street, Region(scenes=("drive_1",)))[0].any()


def test_rays_outside_come_back_as_they_were(street):
    rays = all_rays(street)
    law = within(EFFECTS["range_falloff"], Region(azimuth_rad=(0.0, 1.0)), np.ones(street.range_m.shape[0], bool))
    values = EFFECTS["range_falloff"].values(
        EFFECTS["range_falloff"].starts[0] if EFFECTS["range_falloff"].starts else {}, 1
    )
    after = law.apply(values, rays)
    outside = ~((np.asarray(rays.azimuth_rad) >= 0) & (np.asarray(rays.azimuth_rad) <= 1.0))
    for was, now in zip(jax.tree.leaves(rays), jax.tree.leaves(after), strict=True):
        if np.ndim(was) >= outside.ndim:
            assert np.array_equal(np.asarray(was)[outside], np.asarray(now)[outside])
    assert law.plain_name == "range_falloff"
    assert law.name != "range_falloff"


def test_sensor_json_keeps_where(tmp_path):
    region = Region(azimuth_rad=(0.5, 1.25), time_s=(None, 40.0))
    model = SensorModel((GAIN,), regions={"random_dropout": region})
    model.save(tmp_path / "sensor.json")
    content = json.loads((tmp_path / "sensor.json").read_text())
    assert content["effects"][0]["where"] == {"azimuth_rad": [0.5, 1.25], "time_s": [None, 40.0]}
    assert SensorModel.load(tmp_path / "sensor.json").regions == {"random_dropout": region}


@pytest.mark.parametrize(
    ("where", "words"),
    [
        ({}, "nothing is said"),
        ({"time_s": [None, None]}, "nothing is said"),
        ({"azimuth_rad": [1.0, 0.5]}, "counter-clockwise"),
        ({"azimuth_rad": [100, 101]}, "give radians, -pi..pi, no degrees"),
        ({"time_s": [40, 30]}, "must end after it begins"),
        ({"night": True}, "it may hold azimuth_rad, time_s, tag, scenes"),
        ({"azimuth_rad": 3.0}, "is not understood"),
        ({"azimuth_rad": [True, 2.0]}, "is not understood"),
        ({"azimuth_rad": ["0.1", 2.0]}, "is not understood"),
        ({"azimuth_rad": [0.1, 2.0, 3.0]}, "is not understood"),
        ({"time_s": [None, 10**400]}, "is too large for a whole number"),
        ({"time_s": [0.0, 1e30]}, "no radians or seconds"),
        ({"tag": ["night"]}, "is not understood"),
        ({"scenes": "drive"}, "is not understood"),
        ({"azimut_rad": [0.1, 2.0], "tag": "a"}, "did you mean azimuth_rad"),
    ],
)
def test_a_region_that_cannot_be_is_refused(tmp_path, where, words):
    entry = {"name": "random_dropout", "parameters": {"probability": 0.1}, "where": where}
    (tmp_path / "sensor.json").write_text(json.dumps({"effects": [entry]}))
    with pytest.raises(ValueError, match=words):
        SensorModel.load(tmp_path / "sensor.json")


def test_steps_of_a_whole_recording_have_no_part():
    entry = ("intensity_quantization", {"step": 0.01})
    with pytest.raises(ValueError, match="has no part"):
        SensorModel((entry,), regions={"intensity_quantization": Region(tag="night")})
