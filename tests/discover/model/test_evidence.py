"""Which rays are compared, and at which angles."""

from dataclasses import replace

import jax
import numpy as np
import pytest

from jaxsim.discover.model.cast import cast
from jaxsim.discover.model.evidence import BLURRED, STEEPEST_RAD, gather
from jaxsim.discover.model.surfaces import with_planes
from tests.discover.toy import device, toy

COLUMNS = np.broadcast_to(np.arange(0, 60, 4), (6, 15))
FRAMES = np.arange(6)


@pytest.fixture(scope="module")
def frames():
    return toy()


def noisy(scan, degrees: float, seed: int = 3):
    noise = np.random.default_rng(seed).normal(0, np.deg2rad(degrees), np.shape(scan.incidence_rad))
    return replace(scan, incidence_rad=np.clip(scan.incidence_rad + noise, 0, np.pi / 2).astype(np.float32))


def test_a_plane_shows_its_own_angle_where_the_simulators_normals_are_noisy(frames):
    scan, _ = frames
    (noised,) = device(noisy(scan, 3.0))
    better = np.asarray(with_planes(noised).incidence_rad)
    given = np.asarray(noised.incidence_rad)
    # The road is one plane; the last row and the rows beside the wall have no neighbour on one side.
    road = np.asarray(scan.semantic) == 7
    inner = road & np.roll(road, 1, axis=1) & np.roll(road, -1, axis=1)
    inner[:, [0, -1]] = False
    assert inner.sum() > 1000
    assert np.abs(better - scan.incidence_rad)[inner].max() < 2e-3
    assert np.abs(given - scan.incidence_rad)[inner].max() > 0.05


def test_what_is_no_plane_keeps_the_simulators_angle(frames):
    scan, _ = frames
    rough = np.random.default_rng(5).uniform(0.9, 1.1, np.shape(scan.range_m)).astype(np.float32)
    (bumpy,) = device(replace(scan, range_m=scan.range_m * rough))
    kept = np.asarray(with_planes(bumpy).incidence_rad) == np.asarray(bumpy.incidence_rad)
    assert kept.mean() > 0.95


def test_angles_of_either_side_must_be_moderate(frames):
    scan, measured = frames
    given = np.full_like(scan.incidence_rad, 0.3)
    given[:, :, 4] = STEEPEST_RAD + 0.1
    ev = gather(*device(scan, measured), FRAMES, COLUMNS, FRAMES, given_rad=jax.numpy.asarray(given))
    compared = np.asarray(ev.compared)
    assert not compared[:, 1].any()  # the second column that is looked at
    assert compared[:, 2].any()
    np.testing.assert_allclose(np.asarray(ev.given_rad)[:, 2], 0.3)


def test_readings_that_rounding_blurs_are_not_compared(frames):
    scan, measured = frames
    step = 0.05
    rounded = replace(measured, intensity=(np.round(measured.intensity / step) * step).astype(np.float32))
    fine, coarse = (gather(*device(scan, given), FRAMES, COLUMNS, FRAMES) for given in (measured, rounded))
    predicted = np.exp(np.asarray(fine.rays.log_intensity))
    dark = np.asarray(fine.compared) & (predicted < BLURRED * step)
    assert dark.any()
    assert not np.asarray(coarse.compared)[dark].any()
    bright = np.asarray(fine.compared) & (predicted > BLURRED * step)
    assert np.asarray(coarse.compared)[bright].all()


def test_rays_that_were_cast_with_other_frames_give_the_same_evidence(frames):
    scan, measured = device(*frames)
    alone = gather(scan, measured, FRAMES[1:], COLUMNS[1:], FRAMES[1:])
    rays = cast(scan, FRAMES, COLUMNS).part(FRAMES > 0)
    shared = gather(scan, measured, FRAMES[1:], COLUMNS[1:], FRAMES[1:], rays=rays)
    for one, other in zip(jax.tree.leaves(alone), jax.tree.leaves(shared), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-5, atol=1e-5)
