"""Effects planted on given frames."""

import json
from dataclasses import asdict

import numpy as np
import pytest

from benchmarks.blind.hidden.frames import make_grid
from benchmarks.blind.hidden.replay import OUTSIDE_HERE, Scan, incidence_of, list_plantable, plant_on, simulated_of
from benchmarks.blind.hidden.simulator import SIMULATORS


@pytest.fixture(scope="module")
def road():
    """A flat road 1.8 m below the sensor and a wall 20 m away, four times; every tenth ray says nothing."""
    grid = make_grid(np.random.default_rng(0), 24, 96, False)
    rng = np.random.default_rng(1)
    down = np.where(grid.elevation < 0, 1.8 / np.maximum(-np.sin(grid.elevation), 1e-6), np.inf)[:, None]
    wall = 20 / (np.cos(grid.elevation[:, None]) * np.cos(grid.azimuth)[None])
    scans = []
    for k in range(4):
        r = np.where(rng.random(wall.shape) < 0.1, 0, np.minimum(down, wall))
        scans.append(Scan(r, np.where(r > 0, rng.uniform(0.1, 0.4, r.shape), 0), 0.5 * k))
    return grid, scans


def _ratio(road, effect, severity, seed=3):
    grid, scans = road
    measured, key = plant_on(scans, grid, effect=effect, severity=severity, seed=seed)
    both = [(m["range"] > 0) & (s.range_m > 0) for m, s in zip(measured, scans, strict=True)]
    with np.errstate(divide="ignore", invalid="ignore"):
        logs = [np.where(b & (m["intensity"] > 0), np.log(m["intensity"] / s.intensity), np.nan)
                for m, s, b in zip(measured, scans, both, strict=True)]  # fmt: skip
    return np.stack(logs), measured, key


def test_nothing_planted_leaves_noise_alone(road):
    logs, measured, key = _ratio(road, "none", 1.0)
    assert key.effects == []
    assert np.nanstd(logs) < 0.3
    off = np.concatenate([(m["range"] - s.range_m)[m["range"] > 0] for m, s in zip(measured, road[1], strict=True)])
    assert 0.008 < off.std() < 0.025
    lost = np.mean([(m["range"] > 0).sum() / (s.range_m > 0).sum() for m, s in zip(measured, road[1], strict=True)])
    assert 0.97 < lost < 1


def test_a_beam_gain_is_read_beam_by_beam(road):
    logs, _, key = _ratio(road, "beam_gain", 6.0)
    by_row = np.nanmean(logs, axis=(0, 2))
    seen = np.isfinite(by_row)
    assert np.corrcoef(by_row[seen], np.array(key.effects[0]["parameters"]["gain"])[seen])[0, 1] > 0.97


def test_where_nothing_was_nothing_comes_back_unless_clutter_does(road):
    for effect, some in (("beam_gain", False), ("interference", True)):
        _, measured, _ = _ratio(road, effect, 8.0)
        new = sum(((m["range"] > 0) & (s.range_m == 0)).sum() for m, s in zip(measured, road[1], strict=True))
        assert bool(new) == some


def test_incidence_is_that_of_the_road(road):
    grid, _ = road
    full = np.minimum(
        np.where(grid.elevation < 0, 1.8 / np.maximum(-np.sin(grid.elevation), 1e-6), np.inf)[:, None],
        np.full((1, len(grid.azimuth)), 1e9),
    )
    angle = incidence_of(full, grid)
    rows = slice(len(grid.elevation) // 2, -1)
    want = np.pi / 2 + grid.elevation[rows]
    inside = want < np.deg2rad(84)
    np.testing.assert_allclose(np.median(angle[rows], axis=1)[inside], want[inside], atol=0.01)


def test_every_effect_that_can_be_planted_is_and_the_key_is_plain(road):
    grid, scans = road
    assert {"beam_gain", "range_walk", "sector_occlusion"} <= set(list_plantable())
    for effect in (*list_plantable(), *(f"outside:{name}" for name in OUTSIDE_HERE)):
        measured, key = plant_on(scans, grid, effect=effect, severity=4.0, seed=0)
        assert len(measured) == 4
        assert all(np.isfinite(m["range"]).all() and np.isfinite(m["intensity"]).all() for m in measured)
        json.dumps(asdict(key))


def test_effects_that_move_rays_or_need_classes_are_refused(road):
    grid, scans = road
    for effect in ("extrinsic_rotation", "material_dropout", "beam_gian", "outside:speed_drop"):
        with pytest.raises(
            ValueError, match=r"cannot be planted on given frames; choose one of none, incidence_cosine"
        ):
            plant_on(scans, grid, effect=effect, severity=2.0, seed=0)
    with pytest.raises(ValueError, match="the grid is"):
        plant_on([Scan(np.ones((3, 4)), np.ones((3, 4)), 0.0)], grid, effect="none", severity=1.0, seed=0)


def test_a_noisy_simulator_and_its_sensor_read_alike_and_independently(road):
    grid, scans = road
    errors = SIMULATORS["noisy"]
    measured, _ = plant_on(scans, grid, effect="none", severity=1.0, seed=5, simulator=errors)
    simulated = [simulated_of(scan, errors, seed=5, number=k) for k, scan in enumerate(scans)]
    for sides in (simulated, measured):
        steps = np.concatenate([side["intensity"].ravel() for side in sides]) / errors.step
        np.testing.assert_allclose(steps, np.round(steps), atol=1e-6)
        off = [s["range"] - scan.range_m for s, scan in zip(sides, scans, strict=True)]
        there = [(s["range"] > 0) & (scan.range_m > 0) for s, scan in zip(sides, scans, strict=True)]
        spread = np.std(np.concatenate([o[t] for o, t in zip(off, there, strict=True)]))
        assert spread == pytest.approx(errors.range_sd_m, rel=0.1)
    both = np.concatenate(
        [((a["range"] > 0) & (b["range"] > 0)).ravel() for a, b in zip(simulated, measured, strict=True)]
    )
    noises = [
        np.concatenate([(s["range"] - scan.range_m).ravel() for s, scan in zip(sides, scans, strict=True)])[both]
        for sides in (simulated, measured)
    ]
    assert abs(np.corrcoef(*noises)[0, 1]) < 0.1
    assert all(
        (s["range"] == scan.range_m).all()
        for s, scan in zip(
            (simulated_of(scan, SIMULATORS["ideal"], seed=5, number=0) for scan in scans), scans, strict=True
        )
    )
