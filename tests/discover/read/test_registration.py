"""What a registration says of time and speed."""

import numpy as np
import pytest

from jaxsim.discover.read.registration import other_moments, speeds_read
from tests.discover.made_register import found

pytestmark = pytest.mark.usefixtures("standard_promotion")
FRAMES = 12
NAMES = [f"s{k}" for k in range(FRAMES)]


def test_a_scan_that_the_car_distorts_tells_its_speed():
    driven = np.linspace(0, 1.8, FRAMES)
    one = found(np.zeros(6), driven=driven)
    speeds = one.speeds(NAMES)
    assert speeds is not None
    np.testing.assert_allclose([speeds[name] for name in NAMES], 10 * driven, atol=0.5)
    assert one.sure == ()
    assert "12 drives were registered at" in speeds_read(speeds)


def test_frames_of_other_moments_are_told_with_their_seconds():
    speed = np.linspace(0, 14, FRAMES)
    poses = np.zeros((FRAMES, 6))
    poses[:, 0] = 0.3 * speed
    one = found(poses)
    assert one.early_or_late
    np.testing.assert_allclose(one.frames[:, 0], 0.3 * speed, atol=0.05)
    assert one.apart_s(speed) == pytest.approx(0.3, abs=0.01)
    assert one.apart_s(np.zeros(FRAMES)) is None
    assert "0.30 s later by their speeds" in other_moments(one, speed)
