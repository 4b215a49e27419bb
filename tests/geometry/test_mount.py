"""How a sensor stands, from its points alone."""

import numpy as np
import pytest

from jaxsim.geometry.beams import NoBeams
from jaxsim.geometry.mount import fit_mount
from tests.geometry.made_beams import cloud


def test_a_mounting_comes_back_from_rings_alone():
    xyz, ring, _ = cloud("hdl32e", firings=100)
    tilt = np.deg2rad(2.0)
    pose = np.array([[np.cos(tilt), 0, np.sin(tilt), 1.2], [0, 1, 0, -0.3], [-np.sin(tilt), 0, np.cos(tilt), 1.7]])
    found, off_deg = fit_mount((xyz @ pose[:, :3].T + pose[:, 3]).astype("f4"), ring, near_m=(0.0, 0.0, 1.5))
    np.testing.assert_allclose(found[:3], pose, atol=2e-3)
    assert off_deg < 0.01


def test_points_of_two_sensors_have_no_one_mounting():
    xyz, ring, _ = cloud("hdl32e", firings=60)
    mixed = np.concatenate([xyz, xyz + np.float32((0, 4, 1))])
    with pytest.raises(NoBeams, match="from no one place"):
        fit_mount(mixed, np.concatenate([ring, ring]))
