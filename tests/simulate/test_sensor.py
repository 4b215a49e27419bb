"""The learned sensor on a renderer's views and on plain arrays."""

from dataclasses import replace

import numpy as np
import pytest

from configs.kitti_drives import experiment as drives
from jaxsim.config import PrepareConfig
from jaxsim.data.vkitti2 import VirtualKitti2
from jaxsim.simulate.sensor import load
from tests.untrained import untrained_run


def test_the_map_over_the_image_is_what_the_command_predicts_and_ends_at_the_crop(step_run, virtual):
    sensor = load(step_run)
    view = VirtualKitti2(virtual.root, scenes=("Scene01",))[0].camera
    intensity = sensor.intensity_map(view)
    assert intensity.shape == (375, 1242)
    assert not intensity[:23].any()
    assert not intensity[:, :13].any()
    assert not intensity[:, -13:].any()
    assert intensity[23:, 13:-13].any()
    assert intensity.max() <= np.float32(0.99)


def test_plain_arrays_give_a_cloud_and_must_be_like_the_runs_images(step_run, virtual):
    view = VirtualKitti2(virtual.root, scenes=("Scene01",))[0].camera
    sensor = load(step_run)
    arrays = {"rgb": view.rgb, "depth_m": view.depth_m, "semantic": view.semantic, "instance": view.instance}
    cloud = sensor.simulate(**arrays, camera=view.camera)
    assert np.asarray(cloud.valid).sum() > 500
    with pytest.raises(ValueError, match=r"621 x 375, an aspect ratio of 1\.66"):
        sensor.simulate(**{name: raster[:, :621] for name, raster in arrays.items()}, camera=view.camera)


def test_a_unet_looks_as_often_as_it_is_asked_to_and_tells_that_it_is_another_sensor(step_run, tmp_path):
    prepare = PrepareConfig(inputs=("depth", "incidence", "row"), network_size=(16, 24), depth="given")
    experiment = replace(drives, prepare=prepare, generator=replace(drives.generator, filters=4))
    four = load(untrained_run(tmp_path / "unet", experiment))
    once = four.looking(1)
    inputs = np.random.default_rng(0).uniform(-1, 1, (1, 16, 24, 15)).astype(np.float32)
    mean, plain = (np.asarray(sensor.generate(sensor.params, inputs)) for sensor in (four, once))
    assert mean.shape == plain.shape
    assert np.abs(mean - plain).max() > 1e-3
    assert once.fingerprint != four.fingerprint
    assert four.looking(4).fingerprint == four.fingerprint
    with pytest.raises(ValueError, match="a unet looks several ways, imaginaire does not; leave looks out"):
        load(step_run).looking(2)
