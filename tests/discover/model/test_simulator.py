from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.discover.find.division import Division
from jaxsim.discover.model.evidence import AFTER_KINDS, gather
from jaxsim.discover.model.simulator import DETAIL_SD, SLOPE_SD, filled, meant, reliability, trend
from jaxsim.discover.rules import RULES
from jaxsim.effects import scan_of
from jaxsim.frame import PolarImage
from tests.discover.noisy_street import COLUMNS, comparison, disturbed, grid, scan, sensed, street

NOISY = {"share": 0.06, "constant": 0.008, "range_m": 0.015, "loss": 0.01, "step": 1 / 255}


def as_meant(simulated, measured, frames=4):
    frames_, truth = scan(simulated, frames)
    other = sensed(truth, measured)
    result = meant(frames_, range_m=other.range_m, intensity=other.intensity, valid=other.valid)
    return frames_, result, {k: np.stack([t[k] for t in truth]) for k in truth[0]}


def test_an_ideal_simulator_means_the_very_frames():
    frames, result, _ = as_meant(None, NOISY)
    assert result.scan is frames
    assert result.ranges is None
    assert result.intensities is None
    assert result.measured_noise.range_m == pytest.approx(0.015, rel=0.1)


def test_lost_rays_are_put_back_between_their_neighbours():
    frames, truth = scan({"loss": 0.02}, 2)
    hit = np.stack([t["hit"] for t in truth])
    lost = hit & ~np.asarray(frames.hit)
    back = filled(frames)
    found = lost & np.asarray(back.hit)
    assert found.sum() > 0.8 * lost.sum()
    assert not (np.asarray(back.hit) & ~hit).any()
    error = (np.asarray(back.range_m) - np.stack([t["range"] for t in truth]))[found]
    assert np.median(np.abs(error)) < 0.02


def test_the_measured_follows_what_is_meant_and_not_what_is_read():
    """Errors in variables: the slope on the noisy reading shrinks, that on the meant one does not."""
    frames, result, truth = as_meant(NOISY, {"share": 0.05})
    wall = (truth["semantic"] == 11) & truth["hit"] & np.asarray(result.intensities.trusted)
    wall &= truth["incidence"] < np.deg2rad(75)
    true = np.log(truth["intensity"][wall])
    read = np.log(np.maximum(np.asarray(frames.intensity)[wall], 1e-4))
    told = np.log(np.asarray(result.scan.intensity)[wall])
    # Within a window the cosine hardly changes: what is left is texture and noise.
    cosine = np.log(np.cos(truth["incidence"][wall]))
    detail = true - cosine
    slope_read = np.polyfit(read - cosine, detail, 1)[0]
    slope_told = np.polyfit(told - cosine, detail, 1)[0]
    assert slope_read < 0.85
    assert slope_told == pytest.approx(1, abs=0.1)
    assert np.std(told - true) < 0.6 * np.std(read - true)


def test_reliability_is_the_share_that_is_not_noise():
    rng = np.random.default_rng(3)
    true, noise = rng.normal(0, 0.2, 40_000), rng.normal(0, 0.1, 40_000)
    kind = np.where(np.arange(40_000) % 2, 7, 11)
    true[kind == 7] = 0
    detail = true + noise
    share = reliability(
        detail, np.full(40_000, 0.01), rng.uniform(0.1, 0.4, 40_000), semantic=kind, where=np.ones(40_000, bool)
    )
    assert np.mean(share[kind == 11]) == pytest.approx(0.8, abs=0.02)
    assert np.mean(share[kind == 7]) < 0.05


def test_the_trend_is_the_law_of_class_angle_and_range():
    rng = np.random.default_rng(4)
    n = 5000
    incidence, range_m = rng.uniform(0, 1.3, n), rng.uniform(3, 60, n)
    kind, surface = rng.choice([7, 11], n), rng.integers(0, 50, n)
    level = rng.normal(0, 0.2, 50)[surface] + np.log(np.cos(incidence)) - 2 * np.log(range_m) + 0.3 * (kind == 7)
    noisy = level + rng.normal(0, 0.1, n)
    told = trend(noisy, semantic=kind, surface=surface, incidence_rad=incidence, range_m=range_m)
    assert np.std(told - level) < 0.03


def test_rays_that_the_simulators_constant_noise_hides_are_not_compared_although_the_sensor_has_none():
    steepest = []
    for noise in ({}, {"constant": 0.008}):
        ev, road = road_of(comparison(noise, {}))
        steepest.append(float(np.asarray(ev.rays.incidence_rad)[road].max()))
    # Up to 80 degrees, and where the road, 0.15 of the cosine, lies above five times the noise.
    assert steepest[0] > np.deg2rad(79)
    assert 0.15 * np.cos(steepest[1]) == pytest.approx(0.008 / RULES.compared_noise, rel=0.1)


def test_noise_does_not_choose_the_brighter_of_the_dark_rays():
    noise = {"constant": 0.008, "share": 0.06, "range_m": 0.015}
    both = comparison(noise, noise)
    # Angles with noise, which the simulator's own intensities follow.
    given = both.scan.incidence_rad
    noisy = given + np.random.default_rng(9).normal(0, np.deg2rad(2.3), given.shape).astype(np.float32)
    light = both.scan.intensity * np.cos(noisy) / np.maximum(np.cos(given), 0.05)
    ev, road = road_of(replace(both, scan=replace(both.scan, incidence_rad=np.abs(noisy), intensity=np.abs(light))))
    angle = np.asarray(ev.rays.incidence_rad)
    off = np.asarray(ev.rays.log_intensity) - np.log(0.15 * np.cos(angle))
    # The steepest tenth of those that are compared lies at the border below which none are.
    steep = road & (angle > np.quantile(angle[road], 0.9))
    assert steep.sum() > 100
    assert off[steep].std() > 0.03
    assert off[steep].mean() == pytest.approx(off[road & ~steep].mean(), abs=0.02)


def road_of(both):
    """The evidence of the scenes to find in, and which of its rays are of the road and compared."""
    division = Division.of(both)
    ev, _ = division.evidence(division.parts.find)
    return ev, np.asarray(ev.compared) & (np.asarray(ev.rays.semantic) == 7)


CHECKERED_RAD = 0.8
"""Walls that are seen more steeply have windows, of one cell each."""


@pytest.fixture(scope="module")
def checkered():
    return beside_checkered()


def beside_checkered(dark: float = 0.0):
    """Evidence beside a simulator with noise of streets whose walls have windows where they are seen steeply; and the
    true ln I of its rays. A share `dark` of the walls there is nearly black: the simulator reads it as 0 or a step."""
    rng, truth = np.random.default_rng(5), [street(k) for k in range(4)]
    for frame in truth:
        odd = np.indices(frame["hit"].shape).sum(0) % 2 == 1
        windows = (frame["semantic"] == 11) & (frame["incidence"] < CHECKERED_RAD)
        frame["intensity"] = frame["intensity"] * np.exp(np.where(windows, np.where(odd, 0.5, -0.5), 0))
        black = np.kron(rng.random((6, COLUMNS // 8)) < dark, np.ones((4, 8), bool))
        frame["intensity"][windows & black] = 0.002
    images = []
    for frame in truth:
        range_m, intensity, kept = disturbed(frame, rng, share=0.15, constant=0.003 * (dark > 0), step=(dark > 0) / 255)
        images.append(PolarImage(range_m.astype("f4"), intensity.astype("f4"), kept))
    more = [{"semantic": frame["semantic"], "incidence": frame["incidence"].astype("f4")} for frame in truth]
    frames = jax.tree.map(jnp.asarray, scan_of(grid(), images, more))
    measured = jax.tree.map(jnp.asarray, sensed(truth, {"share": 0.05}))
    result = meant(frames, range_m=measured.range_m, intensity=measured.intensity, valid=measured.valid)
    columns = np.broadcast_to(np.arange(0, COLUMNS, 3), (4, COLUMNS // 3))
    which = np.arange(4)
    ev = gather(result.scan, measured, frame=which, column=columns, scene=which, simulator=result)
    light = np.stack([frame["intensity"] for frame in truth])[which[:, None, None], np.arange(24), columns[..., None]]
    return ev, np.log(np.maximum(light, 1e-4))


@pytest.mark.parametrize("dark", [0.0, 0.1])
def test_smoothing_over_windows_darkens_no_angle(checkered, dark):
    """What is smoothed lies above the mean of its logarithms by half of the variance that noise hides. Readings of 0
    have none: their floor would pass for a trend."""
    ev, light = beside_checkered(dark) if dark else checkered
    wall = np.asarray(ev.compared) & (np.asarray(ev.rays.semantic) == 11)
    steep = np.asarray(ev.given_rad) < CHECKERED_RAD
    off = light - np.asarray(ev.rays.log_intensity)
    assert off[wall & steep].mean() - off[wall & ~steep].mean() == pytest.approx(0, abs=0.03)


def test_beside_a_noisy_simulator_slopes_of_classes_and_of_detail_are_free(checkered):
    ev, _ = checkered
    details = ev.after_kinds - AFTER_KINDS
    sd = 1 / np.sqrt(np.asarray(ev.ridge))[-details:]
    # Of the road and of walls, for others are not there; of bright and dark detail and of surfaces.
    np.testing.assert_allclose(sd, [SLOPE_SD] * 2 + [DETAIL_SD] * 3, rtol=1e-5)
    columns = np.asarray(ev.features)[..., -details:]
    road = np.asarray(ev.compared) & (np.asarray(ev.rays.semantic) == 7)
    assert (columns[road][:, 1] == 0).all()
    assert (columns[..., 1] != 0).any()
