"""The learned sensor on a renderer's views and on plain arrays."""

import numpy as np
import pytest

from jaxsim.data.vkitti2 import VirtualKitti2
from jaxsim.simulate.sensor import load


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
