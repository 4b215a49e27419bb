"""Counts on clouds whose answers are known by hand."""

import numpy as np
import pytest

from jaxsim.metrics.cloud_checks import classes_in, compare_clouds, count_clouds, distribution_distance, drop_map

CAR = np.array([[10.0, 0.0, -1.0, 4.0, 2.0, 1.5, 0.3]])


def cloud(on_car: int, elsewhere: int, *, intensity: float, seed: int = 0):
    """Points inside the car's box, and points on a road far from it."""
    rng = np.random.default_rng(seed)
    near = CAR[0, :3] + rng.uniform(-0.5, 0.5, (on_car, 3))
    road = np.column_stack([rng.uniform(20, 30, elsewhere), rng.uniform(-8, 8, elsewhere), np.full(elsewhere, -1.7)])
    return np.column_stack([np.concatenate([near, road]), np.full(on_car + elsewhere, intensity)]).astype(np.float32)


def counts(*clouds):
    return count_clouds((points, CAR, ("Car",)) for points in clouds)


def test_points_on_objects_are_counted_by_distance():
    real, other = (
        counts(cloud(120, 300, intensity=0.4), cloud(80, 300, intensity=0.4)),
        counts(cloud(30, 100, intensity=0)),
    )
    table = compare_clouds(real, {"raw": other}, "Car")
    assert list(table) == ["real", "raw"]
    assert (table["real"]["points"], table["raw"]["points"]) == (400, 130)
    assert (table["real"]["points_0_15"], table["raw"]["points_0_15"]) == (100, 30)
    assert np.isnan(table["raw"]["points_15_30"])


def test_distances_are_in_the_quantitys_own_unit():
    """All points moved by one value: the Wasserstein distance is that value, to a bin."""
    real, other = counts(cloud(50, 200, intensity=0.4)), counts(cloud(50, 200, intensity=0.1))
    assert distribution_distance(real, other, "Car", quantity="intensity") == pytest.approx(0.3, abs=0.011)
    assert distribution_distance(real, other, "rest", quantity="intensity") == pytest.approx(0.3, abs=0.011)
    assert distribution_distance(real, other, "Car", quantity="range") == 0
    assert np.isnan(distribution_distance(real, other, "Pedestrian", quantity="range"))
    raised = cloud(50, 0, intensity=0.4) + np.float32([0, 0, 0.2, 0])
    assert distribution_distance(
        counts(cloud(50, 0, intensity=0.4)), counts(raised), "Car", quantity="height"
    ) == pytest.approx(0.2, abs=0.06)


def test_a_drop_map_says_where_nothing_returns():
    """A wall ahead of half the columns: those return in every scene, the others never."""
    azimuth = np.radians(np.repeat(np.arange(0.25, 45, 0.5), 60))
    elevation = np.radians(np.tile(np.linspace(-15.9, 3.9, 60), 90))
    wall = 20 * np.column_stack(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)]
    )
    points = np.column_stack([wall, np.full(len(wall), 0.2)]).astype(np.float32)
    nothing = np.zeros((0, 7))
    empty = drop_map(count_clouds([(points, nothing, ()), (points, nothing, ())]))
    rows, columns = empty.shape
    assert (rows, columns) == (42, 168)
    assert empty[:, : columns // 2].mean() < 0.05  # left of ahead comes first
    assert empty[:, columns // 2 :].min() == 1


def test_a_scene_without_objects_counts_as_rest():
    table = compare_clouds(count_clouds([(cloud(0, 40, intensity=0.5), np.zeros((0, 7)), ())]), {}, "Car")
    assert table["real"]["points"] == 40
    assert np.isnan(table["real"]["points_0_15"])
    assert table["real"]["rest_intensity"] == 0


def test_objects_beyond_45_m_are_counted_too_but_not_those_that_the_range_cut():
    far = np.array([[60.0, 0.0, -1.0, 4.0, 2.0, 1.5, 0.3], [30.0, 30.0, -1.0, 4.0, 2.0, 1.5, 0.3]])
    rng = np.random.default_rng(0)
    points = np.concatenate([box[:3] + rng.uniform(-0.5, 0.5, (12, 3)) for box in far])
    points = np.column_stack([points, np.full(24, 0.5)]).astype(np.float32)
    scene = points, far, ("Car", "Car")
    whole = compare_clouds(count_clouds([scene]), {}, "Car")["real"]
    assert (whole["objects"], whole["points_45_80"], whole["points_30_45"]) == (2, 12, 12)
    cut = points[points[:, 1] < 20], far, ("Car", "Car")
    row = compare_clouds(count_clouds([cut], range_m=np.array([0.0, -20, -3, 70, 20, 1])), {}, "Car")["real"]
    assert (row["objects"], row["points_45_80"]) == (1, 12)
    assert np.isnan(row["points_30_45"])


def test_a_class_of_which_no_object_was_counted_has_no_distance():
    """The range cuts the only object, of which points are left."""
    scene = cloud(40, 50, intensity=0.5), CAR, ("Car",)
    cut = count_clouds([scene], range_m=np.array([0.0, -20, -3, 9.9, 20, 1]))
    row = compare_clouds(count_clouds([scene]), {"raw": cut}, "Car")["raw"]
    assert row["objects"] == 0
    assert np.isnan([row["range_m"], row["height_m"], row["intensity"]]).all()
    assert row["rest_intensity"] == 0


def test_classes_are_those_of_any_cloud_the_asked_one_first():
    def one(*kinds):
        return count_clouds([(cloud(5, 5, intensity=0.5), np.repeat(CAR, len(kinds), axis=0), kinds)])

    clouds = {"real": one("Van", "Pedestrian", "Pedestrian"), "raw": one("Car", "Cyclist", "Cyclist", "Cyclist")}
    assert classes_in(clouds, "Car") == ("Car", "Cyclist", "Pedestrian", "Van")
    assert classes_in({"real": one("Van")}, "Car") == ("Car", "Van")
