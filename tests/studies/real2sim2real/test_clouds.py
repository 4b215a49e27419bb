"""Tables of what clouds hold."""

import json

import numpy as np

from jaxsim.metrics.cloud_checks import count_clouds
from jaxsim.studies.real2sim2real.clouds import check_tables, checked_kinds, write_checks
from tests.studies.real2sim2real.made import street


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
