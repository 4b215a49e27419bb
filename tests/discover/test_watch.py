"""A sensor over days: what was put in is found and nothing else is."""

import numpy as np
import pytest

from jaxsim.discover.rules import RULES
from jaxsim.discover.watch import Apart, changes, measure_names, measures, watch_days
from jaxsim.frame import PolarGrid, PolarImage
from tests.discover.made_watch import GRID, day, drives, dying_beam

ROWS, COLUMNS, SCENES = 8, 96, 10
ROAD = np.asarray(GRID.elevation_rad) <= -RULES.watch_road_rad


def table(seed):
    """What a folder of `day` is asked, without its files."""
    return np.array([measures(image, ROAD) for _, _, image in drives(seed)]).reshape(SCENES, 3, -1).mean(1)


def dirty_window(intensity, valid):
    width = COLUMNS // RULES.watch_sectors
    intensity[:, 5 * width : 6 * width] *= 0.75
    valid[:, 5 * width : 6 * width] &= np.random.default_rng(9).random((ROWS, width)) < 0.6
    return intensity, valid


def test_a_dying_beam_and_dirt_are_found_where_they_are_and_nothing_else(tmp_path):
    monday = day(tmp_path / "monday", 0)
    days = watch_days(monday, [day(tmp_path / "beam", 2, dying_beam), day(tmp_path / "dirt", 3, dirty_window)])
    beam, dirt = ({(c.what.split(" (")[0], c.channel) for c in one.changes} for one in days)
    assert beam == {("row 3", "intensity")}
    assert {("sector 5", "intensity"), ("sector 5", "returns")} <= dirt
    (change,) = days[0].changes
    assert change.low < np.log(0.7) < change.high


def test_unchanged_days_seldom_show_a_change():
    names = measure_names(GRID)
    shown = [bool(changes(table(2 * k), table(2 * k + 1), names)) for k in range(40)]
    # One in twenty is what is promised; seven of forty would come once in two hundred times.
    assert sum(shown) < 7


@pytest.mark.parametrize(("then", "now"), [(30, 4), (100, 6), (8, 8), (4, 4)])
@pytest.mark.parametrize("law", ["normal", "skewed"])
def test_few_scenes_against_many_seldom_show_a_change_whatever_their_law(then, now, law):
    rng = np.random.default_rng(0)
    names = [(f"row {k}", "returns") for k in range(150)]

    def scenes(count):
        drawn = rng.normal(size=(count, 150)) if law == "normal" else 1 - 0.02 * rng.exponential(size=(count, 150))
        return np.where(rng.random(drawn.shape) < 0.01, np.nan, drawn)  # a row that saw nothing

    shown = [bool(changes(scenes(then), scenes(now), names)) for _ in range(40)]
    assert sum(shown) < 7


def test_an_interval_reaches_as_far_as_what_it_leaves_is_chance():
    rng = np.random.default_rng(0)
    numbers, chosen, limit = rng.normal(size=(30, 3)), np.arange(30) < 8, 2.5
    numbers[:8] += [0.5, 2, 9]
    numbers[3, 1] = np.nan
    apart = Apart.of(numbers)
    difference = np.nanmean(numbers[:8], 0) - np.nanmean(numbers[8:], 0)
    np.testing.assert_allclose(apart.differences(chosen[None])[0][0], difference, rtol=1e-6)
    for end in (-1, 1):
        shift = difference + end * apart.half_width(chosen, limit)
        _, strength = Apart.of(numbers - np.outer(chosen, shift)).differences(chosen[None])
        np.testing.assert_allclose(strength[0], limit, rtol=1e-6)


@pytest.mark.parametrize("dead", [(), (5,), (1, 3, 5)])
def test_beams_that_are_dead_where_every_ray_returns_are_found(dead):
    def full(seed, *rows):
        valid = np.ones((ROWS, COLUMNS), bool)
        valid[list(rows)] = False
        intensity = np.random.default_rng(seed).uniform(0.1, 0.6, (ROWS, COLUMNS)).astype("f4")
        return measures(PolarImage(np.where(valid, 20, 0).astype("f4"), intensity * valid, valid), ROAD)

    before = np.array([full(k) for k in range(8)])
    today = np.array([full(8 + k, *dead) for k in range(8)])
    found = changes(before, today, measure_names(GRID))
    rows = {(one.what, one.channel): one.value for one in found if one.what != "all"}
    assert rows == {(f"row {row}", "returns"): -1.0 for row in dead}
    # The dead rows come first: they are stronger than what they do to the whole frame.
    assert [one.what for one in found[: len(dead)]] == [f"row {row}" for row in dead]


def test_a_grid_of_few_columns_has_as_many_sectors():
    few = RULES.watch_sectors - 5
    names = measure_names(PolarGrid(GRID.azimuth_rad[:few], GRID.elevation_rad, GRID.origin_m))
    seen = np.ones((ROWS, few), bool)
    asked = measures(PolarImage(np.full(seen.shape, 20, "f4"), np.full(seen.shape, 0.3, "f4"), seen), ROAD)
    assert len(names) == len(asked) == 2 * (1 + ROWS + few) + 1
    assert np.isfinite(asked).all()


@pytest.mark.parametrize("unit", [1 / 3.28, 0.97])
def test_ranges_that_are_of_another_unit_or_scale_show_on_the_road(tmp_path, unit):
    monday, tuesday = day(tmp_path / "monday", 0), day(tmp_path / "tuesday", 1, unit=unit)
    (told,) = watch_days(monday, [tuesday])
    (change,) = [one for one in told.changes if one.channel == "range"]
    assert change.what == "the road"
    assert change.low < -np.log(unit) < change.high
    day(tmp_path / "kilometres", 1, unit=1000)
    with pytest.raises(ValueError, match=r"kilometres frame .* ranges are metres"):
        watch_days(monday, [tmp_path / "kilometres"])
