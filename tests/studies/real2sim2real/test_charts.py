"""Charts of what clouds hold, and of the last checkpoints."""

import json
from dataclasses import replace

import numpy as np
import pytest

from jaxsim.metrics.cloud_checks import REST, count_clouds
from jaxsim.studies.real2sim2real.charts import (
    check_tables,
    checked_kinds,
    class_chart,
    drop_picture,
    epochs_chart,
    intensity_chart,
    write_checks,
)
from jaxsim.studies.real2sim2real.scores import epochs_on_real
from tests.report.drawn import elements, points, texts
from tests.studies.real2sim2real.made import COUNTS, clouds, street


def test_the_drop_maps_carry_their_key():
    """Ninety points on one car leave most directions empty: the map's usual colour is the key's right end."""
    picture = drop_picture({"real": clouds(0.4)})
    key, corner = picture[-1], picture[30, 0]
    assert (key[-1] == corner).all()
    assert (key[0] != corner).any()


def test_the_chart_draws_a_line_for_each_kind():
    drawn = intensity_chart({kind: clouds(value) for kind, value in COUNTS.items()}, "Car")
    assert [text for text in texts(drawn) if text in COUNTS] == list(COUNTS)
    assert len(elements(drawn, "polyline")) > len(COUNTS)


def test_a_class_chart_draws_range_height_and_intensity_of_its_own_points():
    """All points of a car at 10 m, at one intensity: the range has its peak there, intensity one bin."""
    counts = {"real": count_clouds([street(("Car", 10, 400), intensity=0.32)])}
    drawn = class_chart(counts, "Car")
    said = texts(drawn)
    assert [words for words in said if words.endswith(("m", "cars"))] == [
        "range on cars, m", "height above the LiDAR on cars, m", "intensity on cars",
    ]  # fmt: skip
    lines = [line for line in map(points, elements(drawn, "polyline")) if len(line) > 2]
    assert len(lines) == 3
    in_range, _, intensity = lines
    peak = in_range[in_range[:, 1].argmin(), 0]
    first, last = in_range[0, 0], in_range[-1, 0]
    assert (peak - first) / (last - first) == pytest.approx((10 - 1) / 18, abs=0.06)  # bins of 2 m, axis to 20 m
    full = intensity[:, 1] < intensity[:, 1].max() - 1
    assert full.sum() == 1
    elsewhere = texts(class_chart(counts, REST))
    assert "range elsewhere, m" in elsewhere


def test_each_kind_has_a_line_over_the_checkpoints_and_a_thin_one_a_seed(scored):
    drawn = epochs_chart(epochs_on_real(scored))
    lines = [line for line in elements(drawn, "polyline") if len(points(line)) == 3]
    assert [line.get("stroke-width") for line in lines].count("2") == len(COUNTS)
    assert [line.get("stroke-width") for line in lines].count("0.5") == 2 * len(COUNTS)
    thick = {line.get("stroke"): points(line).mean(0)[1] for line in lines if line.get("stroke-width") == "2"}
    assert len(thick) == len(COUNTS)
    assert epochs_chart(epochs_on_real(replace(scored, config=replace(scored.config, seeds=(7,))))) is None


def test_each_class_has_its_table_and_a_band_only_where_objects_are():
    real = count_clouds([street(("Car", 10, 40), ("Pedestrian", 14.5, 30), ("Pedestrian", 20, 20), ("Cyclist", 60, 9))])
    raw = count_clouds([street(("Car", 10, 80), ("Pedestrian", 14.5, 10))])
    tables = check_tables({"real": real, "raw_64": raw}, "Car")
    assert list(tables) == ["Whole scenes", "Car", "Pedestrian", "Cyclist"]
    heads, rows = tables["Car"]
    assert [head for head in heads if head.startswith("on one")] == ["on one, 0-15 m"]
    assert [row[:3] for row in rows] == [["real", "1", "40"], ["raw_64", "1", "80"]]
    heads, rows = tables["Pedestrian"]
    assert [head for head in heads if head.startswith("on one")] == ["on one, 0-15 m", "on one, 15-30 m"]
    assert [row[1:4] for row in rows] == [["2", "30", "20"], ["1", "10", "-"]]
    heads, rows = tables["Cyclist"]
    assert [head for head in heads if head.startswith("on one")] == ["on one, 45-80 m"]
    assert [row[2] for row in rows] == ["9", "-"]
    assert rows[1][3:] == ["-", "-", "-"]  # no cyclist, no distance of distributions


def test_the_checks_stand_without_any_detector(tmp_path):
    counts = {name: count_clouds([street(("Car", 10, 40), ("Van", 30, 30))]) for name in ("real", "raw_64")}
    assert checked_kinds(tmp_path) == ()
    pictures = write_checks(tmp_path, counts, "Car", pictures={"clouds": np.zeros((8, 8, 3), np.uint8)})
    assert checked_kinds(tmp_path) == ("real", "raw_64")
    assert set(pictures) == {"clouds", "drops", "intensity", "on_car", "on_van", "elsewhere"}
    assert {path.stem for path in (tmp_path / "pictures").iterdir()} == set(pictures)
    plain = json.loads((tmp_path / "clouds.json").read_text())
    assert plain["classes"]["Van"]["raw_64"]["points_30_45"] == 30
    assert plain["classes"]["Van"]["raw_64"]["points_45_80"] is None
    assert "Van:" in (tmp_path / "clouds.md").read_text()
