"""Learned laws: what they do to rays, what they refuse, and their file."""

import json
from dataclasses import replace
from itertools import pairwise

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.effects import all_rays
from jaxsim.effects.chain import SensorModel
from jaxsim.effects.learned import TABLES, Learned, curve_kind
from tests.effects.streets import clutter_of_everything

WAVE = Learned("intensity", "curve", ("azimuth",), ((-0.5, 0.0, 0.4),), (0.1, -0.2, 0.3), (0.01, 0.02, 0.03))
BEAMS = Learned("range", "table", ("row",), ((0.0, 1.0, 3.0),), (0.05, -0.1, 0.2), (0.0,) * 3)
PRODUCT = Learned(
    "drop", "product", ("range", "incidence"), ((1.0, 3.0), (0.2, 0.5, 1.0)), (0.1, 0.2, 0.3, 0.4, 0.5, 0.6), (0.0,) * 6
)


@pytest.fixture(scope="module")
def scan():
    return clutter_of_everything()


@pytest.fixture(scope="module")
def rays(scan):
    return jax.jit(all_rays)(scan)


def test_a_curve_is_linear_between_knots_and_holds_its_ends(rays):
    x, hit = np.asarray(rays.azimuth_rad, float), np.asarray(rays.hit)
    after = WAVE.apply(rays)
    change = np.asarray(after.log_intensity - rays.log_intensity)
    assert x.min() < -0.5
    assert x.max() > 0.4
    np.testing.assert_allclose(change[hit], np.interp(x, WAVE.knots[0], WAVE.values)[hit], atol=1e-5)
    assert not change[~hit].any()
    # Light is lost before it is measured: the power falls with it.
    np.testing.assert_allclose(np.asarray(after.log_power - rays.log_power), change, atol=1e-5)


def test_a_table_of_beams_and_columns_holds_a_number_for_each_pair(rays):
    values = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5)
    law = Learned("range", "table", ("row", "column"), ((1.0, 3.0), (0.0, 4.0, 5.0)), values, (0.0,) * 6)
    hit, row, column = (np.asarray(one) for one in (rays.hit, rays.row, rays.column))
    change = np.asarray(law.apply(rays).reading_m - rays.reading_m)
    wanted = np.zeros(hit.shape)
    for k, (r, c) in enumerate((r, c) for r in (1, 3) for c in (0, 4, 5)):
        wanted[(row == r) & (column == c)] = values[k]
    assert wanted[hit].any()
    np.testing.assert_allclose(change[hit], wanted[hit], atol=1e-5)


def test_a_wave_runs_over_rows_and_columns(rays):
    law = Learned("intensity", "wave", ("row", "column"), ((0.25,), (0.1,)), (0.3, -0.2), (0.0, 0.0))
    angle = 2 * np.pi * (0.25 * np.asarray(rays.row) + 0.1 * np.asarray(rays.column))
    wanted = 0.3 * np.cos(angle) - 0.2 * np.sin(angle)
    hit = np.asarray(rays.hit)
    change = np.asarray(law.apply(rays).log_intensity - rays.log_intensity)
    np.testing.assert_allclose(change[hit], wanted[hit], atol=1e-4)
    lost = 1 - np.exp(np.asarray(replace(law, channel="drop", values=(0.3, 0.2)).apply(rays).log_keep))[hit]
    height = 0.3 * np.cos(angle) + 0.2 * np.sin(angle) + np.hypot(0.3, 0.2)
    np.testing.assert_allclose(lost, height[hit], atol=1e-4)


def test_a_table_leaves_beams_that_it_does_not_hold(rays):
    hit = np.asarray(rays.hit)
    change = np.asarray(BEAMS.apply(rays).reading_m - rays.reading_m)
    wanted = np.array([0.05, -0.1, 0.0, 0.2, 0.0])[np.asarray(rays.row)]
    np.testing.assert_allclose(change[hit], wanted[hit], atol=1e-5)


def test_a_law_that_adds_changes_what_is_reported_in_its_own_unit(rays):
    law = Learned("intensity", "table", ("even rows",), ((0.0, 1.0),), (0.0, 0.05), (0.001, 0.002), adds=True)
    hit, odd = np.asarray(rays.hit), np.asarray(rays.row) % 2 == 1
    after = law.apply(rays)
    change = np.exp(np.asarray(after.log_intensity, float)) - np.exp(np.asarray(rays.log_intensity, float))
    np.testing.assert_allclose(change[hit], np.where(odd, 0.05, 0.0)[hit], atol=1e-5)
    # A black level is added behind the detector: the light that comes back is what it was.
    np.testing.assert_array_equal(after.log_power, rays.log_power)
    dark = replace(law, values=(0.0, -1.0)).apply(rays)
    assert np.isfinite(np.asarray(dark.log_intensity)[hit]).all()


def test_whether_a_law_adds_is_said_in_its_file_where_it_does(tmp_path):
    adds = Learned("intensity", "table", ("row",), ((0.0, 2.0),), (0.1, 0.2), (0.0, 0.0), adds=True)
    model = SensorModel((), {}, (WAVE, adds))
    model.save(tmp_path / "sensor.json")
    assert SensorModel.load(tmp_path / "sensor.json") == model
    assert ["adds" in entry for entry in json.loads((tmp_path / "sensor.json").read_text())["learned"]] == [False, True]
    wrong = (tmp_path / "sensor.json").read_text().replace('"adds": true', '"adds": 1')
    (tmp_path / "sensor.json").write_text(wrong)
    with pytest.raises(ValueError, match=r"no law: adds: Input should be a valid boolean$"):
        SensorModel.load(tmp_path / "sensor.json")


def test_a_periodic_law_goes_on_across_the_end_of_the_turn(rays):
    knots = tuple(np.linspace(-3.0, 3.0, 12).tolist())
    assert curve_kind("azimuth", knots) == "periodic"
    assert curve_kind("azimuth", knots[:6]) == curve_kind("range", knots) == "curve"
    assert all(curve_kind(name, (0.0, 1.0)) == "table" for name in TABLES)
    law = Learned("intensity", "periodic", ("azimuth",), (knots,), (0.0, *(0.5,) * 10, 1.0), (0.0,) * 12)
    behind = replace(rays, azimuth_rad=jnp.full_like(rays.azimuth_rad, jnp.pi))
    hit = np.asarray(rays.hit)
    np.testing.assert_allclose(np.asarray(law.height(behind))[hit], 0.5, atol=1e-4)


def test_a_product_is_bilinear_in_its_two_covariates(rays):
    hit = np.asarray(rays.hit)
    x = np.clip(np.log(np.maximum(np.asarray(rays.range_m, float), 0.5)), 1.0, 3.0)
    y = np.asarray(rays.incidence_rad, float)
    table = np.reshape(PRODUCT.values, (2, 3))
    low, high = (np.interp(y, PRODUCT.knots[1], row) for row in table)
    wanted = low + (x - 1) / 2 * (high - low)
    np.testing.assert_allclose(np.exp(np.asarray(PRODUCT.apply(rays).log_keep))[hit], 1 - wanted[hit], atol=1e-5)


def test_learned_laws_go_through_sensor_json_exactly(tmp_path):
    r = np.random.default_rng(0)
    knots = tuple(np.sort(r.normal(size=20)).tolist())
    law = Learned("intensity", "curve", ("hue",), (knots,), *(tuple(r.uniform(0, 1, 20).tolist()) for _ in range(2)))
    model = SensorModel((("beam_gain", {"gain": 0.1}),), {"range_noise": 0.01}, (law, BEAMS, PRODUCT))
    model.save(tmp_path / "sensor.json")
    assert SensorModel.load(tmp_path / "sensor.json", rows=5) == model
    assert all(a < b for a, b in pairwise(model.learned[0].knots[0]))


def test_a_sensor_model_applies_them_after_its_effects(scan, rays):
    effects = (("gamma_response", {"gamma": 0.5}),)
    both = SensorModel(effects, learned=(WAVE,)).apply(rays, scan)
    wanted = WAVE.apply(SensorModel(effects).apply(rays, scan))
    np.testing.assert_array_equal(np.asarray(both.log_intensity), np.asarray(wanted.log_intensity))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"channel": "drop", "adds": True}, "`adds` is of intensity alone"),
        ({"adds": True, "values": (0.1, 0.2, 1.5)}, "values must lie within -1 and 1"),
        ({"channel": "colour"}, "channel 'colour' is not known; known are intensity"),
        ({"kind": "spline"}, "kind 'spline' is not known; known are curve"),
        ({"covariates": ("mood",)}, "covariate 'mood' is not known; known are range"),
        ({"kind": "product"}, "a product has 2 covariates"),
        ({"knots": ((0.0, 0.0, 1.0),)}, "knots of azimuth must be finite numbers that rise, 2 or more"),
        ({"values": (0.1, 0.2)}, "2 values and 3 sd came; 3 of each are right"),
        ({"values": (0.1, 0.2, 9.0)}, "values must lie within -2 and 2 nats"),
        ({"values": (0.1, 0.2, float("nan"))}, "values must lie within"),
        ({"kind": "wave"}, "a wave has one knot of each covariate: its periods in a unit of it"),
        ({"kind": "table", "covariates": ("row",) * 3}, "a table has 1 or 2 covariates"),
        ({"sd": (0.1, -0.2, 0.1)}, "sd must lie within 0 and 2000 nats"),
        ({"sd": (0.1, 1e30, 0.1)}, "sd must lie within 0 and 2000 nats"),
        ({"kind": "table", "covariates": ("row",), "knots": ((0.0, 0.5, 1.0),)}, "in a table are whole numbers"),
    ],
)
def test_what_cannot_be_right_is_refused(change, message):
    with pytest.raises(ValueError, match=message):
        replace(WAVE, **change)


@pytest.mark.parametrize("content", ['[{"channel": "intensity"}]', "3", "[3]"])
def test_a_file_that_holds_no_law_is_refused(tmp_path, content):
    (tmp_path / "sensor.json").write_text(f'{{"effects": [], "learned": {content}}}')
    with pytest.raises(ValueError, match=r"sensor\.json"):
        SensorModel.load(tmp_path / "sensor.json")


def test_a_law_of_more_beams_than_the_sensor_has_is_refused(tmp_path):
    SensorModel(learned=(BEAMS,)).save(tmp_path / "sensor.json")
    with pytest.raises(ValueError, match="was learned of 4 beams or more; the sensor has 3"):
        SensorModel.load(tmp_path / "sensor.json", rows=3)


@pytest.mark.parametrize(
    ("covariates", "knots", "values"),
    [(("row",), ((0.0, 1.0),), (0.1, 0.2)), (("even columns",), ((0.0, 1.0),), (0.1, 0.2))],
)
def test_a_law_of_another_grids_cells_is_refused(tmp_path, scan, covariates, knots, values):
    rows, columns = len(scan.grid.elevation_rad), len(scan.grid.azimuth_rad)
    law = Learned("intensity", "table", covariates, knots, values, (0.0, 0.0)).on(scan.grid)
    assert law.cells == (rows, columns)
    SensorModel(learned=(law,)).save(tmp_path / "sensor.json")
    [again] = SensorModel.load(tmp_path / "sensor.json", rows=rows).learned
    assert again == law
    again.check(scan)
    other = replace(law, cells=(rows + 1, columns + 1))
    by_rows = covariates == ("row",)
    with pytest.raises(ValueError, match=r"learned on \d+ (beams; the sensor has|columns; these frames have) \d+"):
        _ = other.check_rows(rows) if by_rows else other.check_columns(scan.grid)
    # Directions are the same on any grid.
    assert replace(WAVE, cells=None).on(scan.grid).cells is None


def test_columns_beyond_those_of_a_grid_are_refused(scan):
    columns = len(scan.grid.azimuth_rad)
    law = Learned("intensity", "table", ("column",), ((0.0, float(columns)),), (0.1, 0.2), (0.0, 0.0))
    with pytest.raises(ValueError, match=f"learned of {columns + 1} columns or more; these have {columns}"):
        law.check(scan)


def test_a_law_of_what_frames_do_not_hold_is_refused(scan):
    law = replace(WAVE, covariates=("hue",))
    with pytest.raises(ValueError, match="learned along hue needs the frames' rgb, of which these hold nothing"):
        law.check(replace(scan, rgb=jnp.zeros_like(scan.rgb)))
    with pytest.raises(ValueError, match="needs the frames' speed"):
        replace(WAVE, covariates=("speed",)).check_known({"speed": False})
    WAVE.check(replace(scan, rgb=jnp.zeros_like(scan.rgb)))
