"""Fits climb the likelihood that they say, and stay where they are told to."""

import jax
import numpy as np
import pytest

from jaxsim.discover.model.evidence import gather
from jaxsim.discover.model.fit import Objective, best_starts, channels_of, fit, in_place, on_top, partway, score_at
from jaxsim.discover.model.null_model import fit_null
from jaxsim.discover.model.parameters import to_values, to_z
from jaxsim.effects import EFFECTS
from tests.discover.toy import device, toy

pytestmark = pytest.mark.usefixtures("standard_promotion")
FRAMES = np.arange(3)


@pytest.fixture(scope="module")
def problem(standard_promotion):
    scan, measured = device(*toy(frames=3, seed=2))
    ev = gather(scan, measured, frame=FRAMES, column=np.broadcast_to(np.arange(0, 60, 3), (3, 20)), scene=FRAMES)
    return fit_null(scan, ev)


@pytest.mark.long
def test_the_gradient_is_that_of_finite_differences(problem):
    objective = Objective(EFFECTS["range_scale"], problem)
    x, step = objective.first + 0.1, 0.02
    slopes = []
    for k in range(len(x)):
        away = np.zeros(len(x))
        away[k] = step
        slopes.append((objective(x + away).loss - objective(x - away).loss) / (2 * step))
    np.testing.assert_allclose(objective(x).gradient, slopes, rtol=0.03, atol=0.3)


@pytest.mark.long
def test_the_way_to_a_fit_begins_at_the_null_and_ends_at_the_fit(problem):
    effect = EFFECTS["range_scale"]
    end = fit(effect, problem)
    null = score_at(effect, problem, z=to_z(effect, {}, 16), noise=problem.noise)
    np.testing.assert_allclose(partway(effect, problem, fit=end, share=0.0), null, rtol=1e-5)
    np.testing.assert_allclose(partway(effect, problem, fit=end, share=1.0), end.score, rtol=1e-4)
    assert end.score.sum() >= null.sum() - 0.1


def test_a_fixed_effect_stays_where_it_begins(problem):
    effect = EFFECTS["range_quantization"]
    start = dict.fromkeys(effect.parameters, 0.05)
    z = fit(effect, problem, starts=(start,), fixed=True, steps=5).z
    for name, value in to_values(effect, z).items():
        assert value == pytest.approx(0.05, rel=1e-4), name


def test_each_part_of_the_blocks_has_the_start_that_is_likeliest_there(problem):
    effect = EFFECTS["range_scale"]
    starts = ({"scale": 0.01}, {}, {"scale": -0.005})
    parts = np.array([[1, 0, 0], [0, 1, 1], [1, 1, 1]], np.float32)
    scores = np.stack(
        [score_at(effect, problem, z=to_z(effect, one, 16), noise=problem.noise).sum(-1) for one in starts]
    )
    expected = [starts[k] for k in (parts @ scores.T).argmax(-1)]
    assert best_starts(effect, problem, starts, parts=parts) == expected == [{}, {}, {}]
    assert best_starts(effect, problem, starts[::2], parts=parts) == [
        starts[::2][k] for k in (parts @ scores[::2].T).argmax(-1)
    ]
    assert best_starts(effect, problem, starts[:1], parts=parts) == [starts[0]] * 3


def test_channels_that_an_effect_leaves_alone_count_nothing(problem):
    for name in ("beam_gain", "range_scale"):
        effect = EFFECTS[name]
        score = fit(effect, problem, steps=1).score
        assert ((score != 0).any(0) == [c in channels_of(effect) for c in ("intensity", "range", "drop")]).all()


def test_a_walk_follows_the_reported_intensity_where_there_is_one_and_the_predicted_in_a_simulation(problem):
    walk, ev = EFFECTS["range_walk"], problem.ev
    z = to_z(walk, {"amplitude_m": 0.2, "intensity": 0.3}, ev.rays.row.shape[-1])
    predicted, returned = np.exp(ev.rays.log_intensity), np.asarray(ev.returned)
    reported = np.where(returned, np.exp(ev.log_intensity), predicted)
    assert np.abs(reported - predicted)[returned].max() > 0.05
    hit = np.asarray(ev.rays.hit)
    for simulated, light in ((False, reported), (True, predicted)):
        after = on_top(walk, problem, z, simulated=simulated).ev.rays
        moved = np.asarray(after.reading_m - ev.rays.reading_m)
        np.testing.assert_allclose(moved[hit], (0.2 * np.exp(-light / 0.3))[hit], atol=1e-4)
        np.testing.assert_array_equal(after.log_intensity, ev.rays.log_intensity)


def test_another_place_of_the_sensor_is_told_as_a_frame_s_own_pose_is(problem):
    effect, ev = EFFECTS["extrinsic_translation"], problem.ev
    z = to_z(effect, {"x_m": 0.02, "y_m": -0.03, "z_m": 0.01}, ev.rays.row.shape[-1])
    along = np.where(ev.rays.hit, np.asarray(ev.pose[..., :3]) @ [0.02, -0.03, 0.01], 0)
    for simulated in (False, True):
        after = on_top(effect, problem, z, simulated=simulated).ev.rays
        np.testing.assert_allclose(after.reading_m - ev.rays.reading_m, along, atol=1e-4)
        # What stands beside a ray, and whether it meets anything, hangs on the frame's own pose as much.
        for name in ("hit", "beside_m", "log_intensity"):
            np.testing.assert_array_equal(getattr(after, name), getattr(ev.rays, name))
        assert after.origin_slope is None
    # The pose takes up what is common to all frames: no reading is off by more for it, the prior alone tells.
    null = score_at(effect, problem, z=to_z(effect, {}, 16), noise=problem.noise)
    moved = score_at(effect, problem, z=z, noise=problem.noise)
    assert np.abs(moved - null).max() < 3
    assert np.abs(moved - null).max() > 1e-3


def test_the_objective_takes_and_gives_the_tree_of_z_and_noise(problem):
    objective = Objective(EFFECTS["beam_gain"], problem)
    z, noise = objective.restore(objective.start({"gain": 0.1}))
    np.testing.assert_allclose(to_values(EFFECTS["beam_gain"], z)["gain"], 0.1, rtol=1e-5)
    assert objective.own == 16
    for one, other in zip(jax.tree.leaves(noise), jax.tree.leaves(problem.noise), strict=True):
        assert one == other


def test_effects_are_put_in_place_in_physical_order(problem):
    names = ("beam_gain", "range_falloff")
    z = {name: fit(EFFECTS[name], problem).z for name in names}
    light = [
        in_place(problem, [(EFFECTS[name], z[name]) for name in order]).ev.rays.log_intensity
        for order in (names, names[::-1])
    ]
    np.testing.assert_array_equal(*light)
