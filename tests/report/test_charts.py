"""Charts: colours, ticks, and what lies where."""

import numpy as np
import pytest

from jaxsim.discover.verdict import Interval
from jaxsim.frame import PolarGrid
from jaxsim.report.canvas import data_uri
from jaxsim.report.charts import (
    azimuth_ticks,
    colour_limit,
    curve_chart,
    diverging,
    draw_maps,
    interval_chart,
    root_mean_square,
    ticks,
)
from tests.report import results


def test_before_and_after_share_one_colour_scale():
    weak, strong = np.full((4, 6), 0.1), np.full((4, 6), 0.4)
    chart = draw_maps([("before", strong), ("after", weak)], results.grid(), unit="m")
    assert chart is not None
    svg = chart.svg("maps")
    assert svg.index(data_uri(diverging(strong, 0.4))) < svg.index(data_uri(diverging(weak, 0.4)))


def test_a_root_mean_square_is_of_what_is_finite():
    assert root_mean_square(np.array([3.0, -4.0, np.nan])) == pytest.approx(np.sqrt(12.5))
    assert np.isnan(root_mean_square(np.array([np.nan])))


def test_few_strong_cells_do_not_let_a_quiet_map_look_loud():
    quiet = np.full((20, 50), -0.003)
    quiet[3, :3] = 1.0
    limit = colour_limit([quiet])
    assert limit == pytest.approx(np.sqrt(np.mean(quiet**2)))
    assert diverging(quiet, limit)[0, 0].min() > 225


def test_colours_are_white_at_zero_and_grey_where_nothing_is_known():
    rgb = diverging(np.array([[-1.0, 0.0, 1.0, np.nan]]), 1.0)[0]
    assert rgb[0, 2] > rgb[0, 0]
    assert rgb[2, 0] > rgb[2, 2]
    assert (rgb[1] == 250).all()
    assert (rgb[3] == 176).all()


def test_azimuth_is_written_where_its_column_is():
    azimuth = np.deg2rad(np.arange(39.5, -40, -1.0))
    places = {text: place for place, text in azimuth_ticks(PolarGrid(azimuth, np.zeros(1), np.zeros(1)))}
    assert places["0"] == pytest.approx(0.5)
    assert places["20"] == pytest.approx(0.25)
    assert places["−20"] == pytest.approx(0.75)


def test_ticks_are_round_and_whole_where_they_count_things():
    assert ticks(-0.23, 0.23) == [-0.2, -0.1, 0.0, 0.1, 0.2]
    assert all(value == int(value) for value in ticks(0, 15, 7, whole=True))
    assert ticks(3.0, 3.0) == [3.0]


def test_a_chart_without_a_finite_value_is_none():
    nothing = np.full(4, np.nan)
    x = np.arange(4.0)
    labels = {"x_label": "x", "y_label": "y"}
    assert curve_chart(x, [("before", nothing, "#000000")], np.zeros(4), **labels) is None
    assert interval_chart([Interval(np.nan, np.nan, np.nan, "m")], neutral=0.0, **labels) is None
    assert draw_maps([("before", np.full((2, 3), np.nan))], results.grid(), unit="m") is None


def test_categories_are_points_with_bars_and_lines_break_at_gaps():
    x, y = np.arange(5.0), np.array([0.1, 0.2, np.nan, 0.3, 0.2])
    lines = [("before", y, "#d55e00")]
    labels = {"x_label": "x", "y_label": "y"}
    joined = curve_chart(x, lines, np.full(5, 0.05), **labels).svg("joined")
    apart = curve_chart(x, lines, np.full(5, 0.05), joined=False, **labels).svg("apart")
    assert joined.count("<polygon") == 2
    assert apart.count("<polygon") == 0
    assert joined.count("<circle") == apart.count("<circle") == 4


def test_a_chart_is_a_table_too_and_its_points_answer_where_it_has_a_name():
    x = np.array([0.0, 1.0, 5.0])
    lines = [("before", np.array([0.1, -0.2, np.nan]), "#d55e00")]
    chart = curve_chart(x, lines, np.full(3, 0.05), x_label="x (m)", y_label="y", name="curve 0")
    assert chart.rows[0] == ("x (m)", "before", "half of the 90 % band")
    assert [row[:2] for row in chart.rows[1:]] == [("0", "0.100"), ("1", "−0.200"), ("5", "–")]
    svg = chart.svg("it")
    assert 'aria-label="x 5"' in svg
    assert [svg.count(f'data-chart="curve 0" data-index="{k}"') for k in range(4)] == [1, 1, 1, 0]
    assert "target" not in curve_chart(x, lines, np.full(3, 0.05), x_label="x", y_label="y").svg("it")
