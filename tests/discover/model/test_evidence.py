"""Which rays are compared, and at which angles."""

from dataclasses import replace

import jax
import numpy as np
import pytest

from jaxsim.discover.model.evidence import angle_scores, gather
from jaxsim.discover.rules import RULES
from tests.discover.toy import device, toy

COLUMNS = np.broadcast_to(np.arange(0, 60, 4), (6, 15))
FRAMES = np.arange(6)


@pytest.fixture(scope="module")
def frames():
    return toy()


def test_angles_of_either_side_must_be_moderate(frames):
    scan, measured = frames
    given = np.full_like(scan.incidence_rad, 0.3)
    given[:, :, 4] = RULES.compared_below_rad + 0.1
    ev = gather(*device(scan, measured), frame=FRAMES, column=COLUMNS, scene=FRAMES, given_rad=jax.numpy.asarray(given))
    compared = np.asarray(ev.compared)
    assert not compared[:, 1].any()  # the second column that is looked at
    assert compared[:, 2].any()
    np.testing.assert_allclose(np.asarray(ev.given_rad)[:, 2], 0.3)


def test_readings_that_rounding_blurs_are_not_compared(frames):
    scan, measured = frames
    step = 0.05
    rounded = replace(measured, intensity=(np.round(measured.intensity / step) * step).astype(np.float32))
    fine, coarse = (
        gather(*device(scan, given), frame=FRAMES, column=COLUMNS, scene=FRAMES) for given in (measured, rounded)
    )
    predicted = np.exp(np.asarray(fine.rays.log_intensity))
    dark = np.asarray(fine.compared) & (predicted < RULES.compared_steps * step)
    assert dark.any()
    assert not np.asarray(coarse.compared)[dark].any()
    bright = np.asarray(fine.compared) & (predicted > RULES.compared_steps * step)
    assert np.asarray(coarse.compared)[bright].all()


def test_surfaces_at_the_end_of_the_sensors_scale_are_not_compared(frames):
    scan, measured = frames
    wall = np.asarray(scan.semantic) == 11
    bright = replace(measured, intensity=np.where(wall, np.minimum(2.2 * measured.intensity, 1), measured.intensity))
    before, cut = (
        np.asarray(gather(*device(scan, given), frame=FRAMES, column=COLUMNS, scene=FRAMES).compared)
        for given in (measured, bright)
    )
    wall = wall[FRAMES[:, None, None], np.arange(16)[None, None], COLUMNS[:, :, None]]
    assert before[wall].mean() > 0.7
    # Most of the wall reads 1; those that noise left a little below say nothing of it either.
    assert not cut[wall].any()
    np.testing.assert_array_equal(cut[~wall], before[~wall])


def test_intensities_of_classes_whose_surfaces_are_others_are_not_compared_but_where_they_are_most(frames):
    scan, measured = device(*frames)
    semantic = np.asarray(scan.semantic)[FRAMES[:, None, None], np.arange(16)[None, None], COLUMNS[:, :, None]]
    of = {
        apart: np.asarray(gather(scan, measured, frame=FRAMES, column=COLUMNS, scene=FRAMES, apart=apart).compared)
        for apart in ((), (11,), tuple(range(34)))
    }
    wall = semantic == 11
    assert of[()][wall].any()
    assert not of[(11,)][wall].any()
    np.testing.assert_array_equal(of[(11,)][~wall], of[()][~wall])
    np.testing.assert_array_equal(of[tuple(range(34))], of[()])


def test_angles_with_noise_stand_for_what_is_common():
    """Against angles that are known: of those that seem to be 60 degrees, the true ones are, in the mean, elsewhere."""
    rng = np.random.default_rng(0)
    sd, shape = np.deg2rad(3.0), (8, 100, 1000)
    # A road, of which grazing angles are many, and walls of a broad hump.
    road = np.arange(shape[1])[None, :, None] % 2 == 0
    true = np.where(road, np.deg2rad(85) - rng.exponential(0.2, shape), rng.normal(0.6, 0.2, shape))
    true = np.clip(true, 0.2, None)
    seen = true + rng.normal(0, sd, shape)
    semantic = np.broadcast_to(np.where(road, 7, 11), shape)
    expected = sd**2 * angle_scores(seen, hit=np.ones(shape, bool), semantic=semantic)
    for kind, low, high in ((road, 0.7, 1.3), (~road, 0.3, 1.0)):
        for middle in np.arange(low, high, 0.1):
            near = (np.abs(seen - middle) < 0.02) & kind
            shift = (true - seen)[near].mean()
            assert shift == pytest.approx(expected[near].mean(), abs=0.003)


def test_no_row_is_moved_as_a_whole():
    """Each row sees level ground at an angle of its own: noise scatters angles about it, in the lowest row too, beyond
    which there is no ground."""
    rng = np.random.default_rng(1)
    rows = np.deg2rad(np.linspace(75, 55, 21))
    shape, sd = (8, len(rows), 500), np.deg2rad(3.0)
    true = np.broadcast_to(rows[None, :, None], shape)
    seen = true + rng.normal(0, sd, shape)
    scores = angle_scores(seen, hit=np.ones(shape, bool), semantic=np.full(shape, 7))
    # Rays of one and the same angle are noise of nothing, wherever it lies between steps.
    exact = angle_scores(true, hit=np.ones(shape, bool), semantic=np.full(shape, 7))
    assert np.abs(exact).max() < 0.1 * np.abs(scores).mean()
    # Within a row the expected true angle is the row's own; over the row the shifts cancel.
    below = seen < true
    for row in (0, 10, 20):
        assert abs(scores[:, row].mean()) < 0.05 * np.abs(scores[:, row]).mean()
        assert scores[:, row][below[:, row]].mean() > 5 > -5 > scores[:, row][~below[:, row]].mean()
