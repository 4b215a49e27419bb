"""Which rays are compared, and at which angles."""

from dataclasses import replace

import jax
import numpy as np
import pytest

from jaxsim.discover.model.evidence import BLURRED, STEEPEST_RAD, gather
from tests.discover.conftest import device, toy

COLUMNS = np.broadcast_to(np.arange(0, 60, 4), (6, 15))
FRAMES = np.arange(6)


@pytest.fixture(scope="module")
def frames():
    return toy()


def test_angles_of_either_side_must_be_moderate(frames):
    scan, measured = frames
    given = np.full_like(scan.incidence_rad, 0.3)
    given[:, :, 4] = STEEPEST_RAD + 0.1
    ev = gather(*device(scan, measured), frame=FRAMES, column=COLUMNS, unit=FRAMES, given_rad=jax.numpy.asarray(given))
    compared = np.asarray(ev.compared)
    assert not compared[:, 1].any()  # the second column that is looked at
    assert compared[:, 2].any()
    np.testing.assert_allclose(np.asarray(ev.given_rad)[:, 2], 0.3)


def test_readings_that_rounding_blurs_are_not_compared(frames):
    scan, measured = frames
    step = 0.05
    rounded = replace(measured, intensity=(np.round(measured.intensity / step) * step).astype(np.float32))
    fine, coarse = (
        gather(*device(scan, given), frame=FRAMES, column=COLUMNS, unit=FRAMES) for given in (measured, rounded)
    )
    predicted = np.exp(np.asarray(fine.rays.log_intensity))
    dark = np.asarray(fine.compared) & (predicted < BLURRED * step)
    assert dark.any()
    assert not np.asarray(coarse.compared)[dark].any()
    bright = np.asarray(fine.compared) & (predicted > BLURRED * step)
    assert np.asarray(coarse.compared)[bright].all()
