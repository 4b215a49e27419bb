"""Nulls scatter as the data do, and nothing that scenes share is missing; the bar is what they gain at most."""

from dataclasses import replace
from types import SimpleNamespace

import jax
import numpy as np
import pytest

from jaxsim.discover.model.evidence import gather
from jaxsim.discover.model.fit import fit, on_top
from jaxsim.discover.model.null_model import fit_null
from jaxsim.discover.model.random_effects import conditional_residuals
from jaxsim.discover.name import null_draws
from jaxsim.discover.name.null_draws import bootstrap, draw_nulls
from jaxsim.discover.name.select import Bars
from jaxsim.discover.rules import RULES
from jaxsim.effects import EFFECTS
from jaxsim.effects.rays import FLOOR
from tests.discover.name.made import candidate
from tests.discover.name.made import problem as bare_problem
from tests.discover.toy import device, toy

pytestmark = pytest.mark.long

FRAMES, COLUMNS = 8, 60
ALL_BLOCKS = np.ones(FRAMES, np.float32)
SCENES = 11
STEADY = np.array([4.0, 5, 3, 6, 4, 5, 2, 4, 3, 5, 6])
"""45 nats in all, none more than the third largest."""
SPLIT = np.array([1, -1, 1, 1, -1, 1, 1, -1, 1, 1, -1])


@pytest.fixture(scope="module")
def problem():
    """The null of a sensor whose beams' gains differ, which the null does not know."""
    scan, measured = device(*toy(FRAMES, columns=COLUMNS, gain=0.3))
    frames = np.arange(FRAMES)
    columns = np.broadcast_to(np.arange(0, COLUMNS, 2), (FRAMES, COLUMNS // 2))
    return fit_null(scan, gather(scan, measured, frame=frames, column=columns, scene=frames))


def of_rows(problem):
    """Mean of what is left of ln I in each row, and its scatter in all."""
    left = np.asarray(conditional_residuals(problem.ev, problem.equations, ALL_BLOCKS)[0])
    on = np.asarray(problem.ev.compared)
    rows = np.array([left[..., k][on[..., k]].mean() for k in range(on.shape[-1]) if on[..., k].sum() > 50])
    return rows.std(), left[on].std()


def test_a_seed_gives_one_draw(problem):
    first, again, other = (bootstrap(problem, problem, seed) for seed in (1, 1, 2))
    for one, same in zip(jax.tree.leaves(first), jax.tree.leaves(again), strict=True):
        np.testing.assert_array_equal(one, same)
    assert (np.asarray(first.range_m) != np.asarray(other.range_m)).mean() > 0.9


def test_a_draw_has_the_losses_gain_and_noise_of_the_data(problem):
    ev, drawn = problem.ev, bootstrap(problem, problem, 3)
    hit = np.asarray(ev.rays.hit)
    lost, again = (1 - np.asarray(one.returned)[hit].mean() for one in (ev, drawn))
    assert again == pytest.approx(lost, abs=0.008)
    level = [
        np.median(np.asarray(one.log_intensity - ev.rays.log_intensity)[np.asarray(one.compared)])
        for one in (ev, drawn)
    ]
    assert level[1] == pytest.approx(level[0], abs=0.06)
    refitted = fit_null(problem.scan, drawn)
    for name in ("intensity", "range_"):
        assert float(getattr(refitted.noise, name)) == pytest.approx(float(getattr(problem.noise, name)), abs=0.2)


def test_nulls_lack_the_effect_and_scatter_as_the_data_do_with_it_in_place(problem):
    gains = EFFECTS["beam_gain"]
    added = on_top(gains, problem, fit(gains, problem).z)
    explained = fit_null(added.scan, added.ev)
    before, noisy = of_rows(problem)
    _, scatter = of_rows(explained)
    assert before > 0.15
    assert scatter < 0.7 * noisy
    for seed in range(3):
        null = fit_null(problem.scan, bootstrap(problem, explained, seed))
        after, still = of_rows(null)
        assert after < 0.15 * before
        assert still == pytest.approx(scatter, rel=0.15)


def test_what_belongs_together_in_a_scene_stays_together(problem):
    """A stain of one street, in no model: each draw has it, brighter or darker."""
    stain = np.zeros(problem.ev.edge.shape, np.float32)
    stain[2, 5:20] = np.asarray(problem.ev.compared)[2, 5:20] * 0.5 * (-1) ** np.arange(15)[:, None]
    ev = replace(problem.ev, log_intensity=problem.ev.log_intensity + stain)
    stained = fit_null(problem.scan, ev)
    left = np.asarray(conditional_residuals(stained.ev, stained.equations, ALL_BLOCKS)[0])
    on = stain != 0
    size = (left * np.sign(stain))[on].mean()
    assert size > 0.2
    for seed in range(3):
        drawn = fit_null(problem.scan, bootstrap(stained, stained, seed))
        again = (np.asarray(conditional_residuals(drawn.ev, drawn.equations, ALL_BLOCKS)[0]) * np.sign(stain))[
            on
        ].mean()
        assert abs(again) == pytest.approx(size, rel=0.3)


def test_weak_readings_are_zeros_only_where_the_sensor_reports_zeros(problem):
    ev = problem.ev
    assert (
        np.asarray(bootstrap(problem, problem, 0).log_intensity)[np.asarray(ev.returned)] > np.log(FLOOR) + 1e-3
    ).mean() > 0.98
    dark = np.asarray(ev.log_intensity) < np.quantile(np.asarray(ev.log_intensity), 0.2)
    lowest = float(np.asarray(ev.log_intensity)[~dark].min())
    read = np.where(dark, np.log(FLOOR), np.asarray(ev.log_intensity)).astype(np.float32)
    dim = replace(problem, ev=replace(ev, log_intensity=read, lowest=np.float32(lowest)))
    drawn = bootstrap(dim, problem, 0)
    values = np.asarray(drawn.log_intensity)[np.asarray(drawn.returned)]
    zero = values <= np.log(FLOOR) + 1e-3
    assert zero.mean() > 0.05
    assert (values[~zero] >= lowest).all()


@pytest.fixture
def nulls_that_gain(monkeypatch):
    """Lets each null in turn have these candidates and curves."""

    def given(*rounds):
        rest = iter(rounds)
        monkeypatch.setattr(null_draws, "bootstrap", lambda *_: None)
        monkeypatch.setattr(null_draws, "fit_null", lambda *_, clutter: next(rest))
        monkeypatch.setattr(null_draws, "dependences_of", lambda *_: [])
        monkeypatch.setattr(null_draws, "rank_effects", lambda null, effects: null[0])
        monkeypatch.setattr(null_draws, "free_curves", lambda null, dependences: [(None, curve) for curve in null[1]])
        bare = bare_problem(scan=None, ev=SimpleNamespace(scene=np.arange(SCENES)), clutter=False)
        return draw_nulls(bare, bare, (), count=len(rounds))

    return given


def test_the_bar_is_the_most_that_scenes_agree_on_in_any_null(nulls_that_gain):
    found = nulls_that_gain(
        ([candidate("gamma_response", STEADY), candidate("oren_nayar", 9 * STEADY * SPLIT)], []),
        ([candidate("oren_nayar", STEADY / 2)], [candidate("beam_gain", 2 * STEADY)]),
        ([candidate("saturation", -STEADY)], []),
    )
    assert found.effects == ("gamma_response", "oren_nayar", "")
    assert np.array(found.gains) * SCENES == pytest.approx([45, 22.5, 0])
    assert found.answered == 2
    assert (found.bar * SCENES, found.free_bar * SCENES) == pytest.approx((45, 90))


def test_nulls_that_gain_little_leave_the_standing_bar(nulls_that_gain):
    found = nulls_that_gain(([candidate("gamma_response", STEADY / 10)], []), ([], []))
    assert found.answered == 0
    assert (found.bar * SCENES, found.free_bar * SCENES) == pytest.approx((Bars().effect, RULES.bar_nats))
