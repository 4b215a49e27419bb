"""Intervals hold the truth, and no more than they must."""

from dataclasses import replace

import numpy as np
import pytest

from jaxsim.discover.add import effect_on_rays, intervals, may_never_act
from jaxsim.discover.find.levels import made_by
from jaxsim.discover.model.evidence import Measured, gather
from jaxsim.discover.model.fit import fit, on_top
from jaxsim.discover.model.noise import MOST
from jaxsim.discover.model.null_model import Refit, fit_null, implied_level
from jaxsim.discover.model.parameters import to_z
from jaxsim.discover.rules import RULES
from jaxsim.effects import EFFECTS
from jaxsim.effects.rays import REFERENCE_M
from tests.discover.name.made import candidate, step
from tests.discover.toy import device, toy

pytestmark = pytest.mark.usefixtures("standard_promotion")
FRAMES = np.arange(9)  # as many as of `judged_toy`, whose programs are compiled for many files


def fitted(effect: str, scan, measured):
    scan, measured = device(scan, measured)
    columns = np.broadcast_to(np.arange(0, 60, 2), (len(FRAMES), 30))
    ev = gather(scan, measured, frame=FRAMES, column=columns, scene=FRAMES)
    problem = fit_null(scan, ev)
    return problem, fit(EFFECTS[effect], problem, steps=80)


@pytest.mark.long
def test_beams_gains_lie_in_their_intervals():
    spread, inside = 0.2, []
    for seed in range(4, 8):
        scan, measured = toy(frames=len(FRAMES), gain=spread, seed=seed)
        truth = np.random.default_rng(seed).normal(0, spread, 16)  # toy draws them first
        problem, found = fitted("beam_gain", scan, measured)
        each = intervals(EFFECTS["beam_gain"], problem, found)["gain"]
        middle = np.mean([one.value for one in each]) - truth.mean()
        inside += [one.low <= true + middle <= one.high for one, true in zip(each, truth, strict=True)]
        # Intervals that hold everything would say nothing.
        assert np.median([one.high - one.low for one in each]) < 0.2 * RULES.interval_widening
    assert np.mean(inside) >= 0.85


def test_a_rate_at_its_bound_does_not_blow_an_interval_up():
    share = 0.06
    scan, measured = toy(frames=len(FRAMES), seed=7)
    lost = np.random.default_rng(8).random(np.shape(measured.valid)) < share
    problem, found = fitted("random_dropout", scan, replace(measured, valid=measured.valid & ~lost))
    assert float(found.noise.drop) == pytest.approx(MOST["drop"], abs=1.0)
    one = intervals(EFFECTS["random_dropout"], problem, found)["probability"]
    assert one.low < share + 0.01
    assert one.high > share - 0.01
    assert one.high - one.low < 0.04


@pytest.mark.parametrize("off", [0.3, -0.4])
def test_a_threshold_on_power_is_held_whatever_the_simulators_reflectances_are(off):
    scan, measured = toy(frames=len(FRAMES), seed=9)
    power = np.log(np.maximum(scan.intensity, 1e-3)) - 2 * np.log(np.maximum(scan.range_m, 0.1) / REFERENCE_M)
    power = power + off
    threshold, width = np.quantile(power, 0.3), 0.4
    kept = np.random.default_rng(10).random(power.shape) < 1 / (1 + np.exp(-(power - threshold) / width))
    light = np.clip(measured.intensity * np.exp(off) / 1.2, 0, 1).astype(np.float32)
    problem, found = fitted("snr_dropout", scan, replace(measured, intensity=light, valid=measured.valid & kept))
    one = intervals(EFFECTS["snr_dropout"], problem, found)["threshold"]
    assert one.low <= threshold <= one.high
    # Of the simulator's own power the threshold is another, which the interval holds too.
    assert one.low <= threshold - off <= one.high
    assert one.high - one.low < abs(off) + 1


def test_a_surface_is_as_bright_as_its_rays_say_also_where_rays_are_lost():
    scan, measured = toy(frames=len(FRAMES), seed=11)
    road = scan.semantic == 7
    light = measured.intensity * np.where(road, np.exp(-0.3), np.exp(0.2)) / 1.2
    lost = np.random.default_rng(12).random(road.shape) < 0.5
    valid = measured.valid & ~lost
    problem, _ = fitted("random_dropout", scan, Measured(measured.range_m, light.astype(np.float32), valid))
    level, hit = implied_level(problem.ev, problem.equations), np.asarray(problem.ev.rays.hit)
    kind = np.asarray(problem.ev.rays.semantic)
    gone = hit & ~np.asarray(problem.ev.returned)
    assert np.mean(level[gone & (kind == 7)]) == pytest.approx(-0.3, abs=0.05)
    assert np.mean(level[gone & (kind == 11)]) == pytest.approx(0.2, abs=0.05)
    assert not level[~hit].any()


def test_what_an_effect_does_is_told_whatever_nuisances_take_up():
    problem, found = fitted("range_scale", *toy(frames=len(FRAMES), seed=4))

    def does(name, values):
        z = to_z(EFFECTS[name], values, 16)
        return effect_on_rays(problem, Refit(EFFECTS[name], problem, replace(found, z=z)))

    [(channel, dims)] = does("gamma_response", {"gamma": 1.3}).items()
    rays = problem.ev.rays
    expected = np.expm1(0.3 * np.asarray(rays.log_intensity))[np.asarray(rays.hit)]
    assert channel == "intensity"
    assert (dims.value, dims.low) == pytest.approx((expected.mean(), np.quantile(expected, 0.05)), abs=1e-4)
    assert does("random_dropout", {"probability": 0.2})["drop"].value == pytest.approx(0.2, abs=1e-4)
    assert does("range_offset", {"offset_m": 0.03})["range"].high == pytest.approx(0.03, abs=1e-4)
    assert does("range_noise", {"sd_m": 0.02}) == {}


@pytest.mark.parametrize(("frames", "never"), [(range(len(FRAMES)), False), ((3,), True)])
def test_what_one_scene_alone_shows_may_never_act(frames, never):
    scan, measured = toy(frames=len(FRAMES), seed=4)
    valid = np.array(measured.valid)
    lost = np.random.default_rng(1).random(valid.shape) < 0.1
    of = np.isin(FRAMES, frames)
    valid[of] &= ~lost[of]
    problem, found = fitted("random_dropout", scan, replace(measured, valid=valid))
    chosen = replace(step(candidate("random_dropout", 9, "drop")), fit=found)
    assert may_never_act(chosen, problem) == never
    # It has no probability, however large its interval.
    assert not may_never_act(replace(chosen, chosen=candidate("beam_gain", 9)), problem)


def test_a_step_that_was_read_off_is_known_to_what_the_readings_tell():
    scan, measured = toy(frames=len(FRAMES), seed=4)
    step = 1 / 64
    measured = replace(measured, intensity=(np.round(measured.intensity / step) * step).astype(np.float32))
    problem, found = fitted("intensity_quantization", scan, measured)
    found = replace(found, z=to_z(EFFECTS["intensity_quantization"], {"step": step}, 16))
    told = intervals(EFFECTS["intensity_quantization"], problem, found)["step"]
    assert told.low < step < told.high
    # One wrong by this much is off by a fiftieth of a step at the largest reading.
    largest = float(measured.intensity[measured.valid].max())
    assert (told.high - told.value) * largest / step == pytest.approx(0.02 * step, rel=0.1)


def test_what_effects_make_of_a_level_is_read_off_the_rays_that_they_leave():
    problem, _ = fitted("range_scale", *toy(frames=len(FRAMES), seed=4))
    # What the simulator itself loses, no effect does.
    before = problem.ev.replace(rays=problem.ev.rays.replace(log_keep=problem.ev.rays.log_keep - 0.03))
    problem = replace(problem, ev=before)
    assert made_by(before, problem.ev) == pytest.approx({"range_noise": 0, "random_loss": 0}, abs=1e-6)
    both = {"random_dropout": {"probability": 0.2}, "range_noise": {"sd_m": 0.02}}
    for name, values in both.items():
        problem = on_top(EFFECTS[name], problem, to_z(EFFECTS[name], values, 16))
    rays = problem.ev.rays
    made = made_by(before, problem.ev)
    assert made["random_loss"] == pytest.approx(0.2, abs=1e-4)
    assert made["range_noise"] == pytest.approx(float(np.median(np.asarray(rays.noise_m)[np.asarray(rays.hit)])))
    assert made["range_noise"] > 0
    # A sector that is hidden loses all there, and nothing at random.
    sector = to_z(EFFECTS["sector_occlusion"], {"azimuth_rad": 0.0, "width_rad": 1.0}, 16)
    hidden = on_top(EFFECTS["sector_occlusion"], replace(problem, ev=before), sector)
    assert made_by(before, hidden.ev)["random_loss"] == 0
