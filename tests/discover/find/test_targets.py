"""Targets with counts known by hand."""

import numpy as np
import pytest

from jaxsim.data.cityscapes import IDS
from jaxsim.discover.find.targets import compare_objects, mean_over_scenes
from jaxsim.discover.model.evidence import Measured
from jaxsim.discover.read import Comparison
from jaxsim.effects.scan import scan_of
from jaxsim.frame import PolarGrid, PolarImage

ROWS, COLUMNS, SCENES = 16, 64, 6
CAR, ROAD = IDS["car"], IDS["road"]
GRID = PolarGrid(
    np.linspace(0.5, -0.5, COLUMNS).astype("f4"), np.linspace(0.1, -0.2, ROWS).astype("f4"), np.zeros(ROWS, "f4")
)
LOST = slice(0, 2)
"""Columns of each car that its measured side lacks: 2 of 10."""


@pytest.fixture(scope="module")
def fidelity():
    images, rasters, sensed = [], [], []
    for scene in range(SCENES):
        semantic, instance = np.full((ROWS, COLUMNS), ROAD), np.zeros((ROWS, COLUMNS), int)
        range_m, intensity = np.full((ROWS, COLUMNS), 20.0), np.full((ROWS, COLUMNS), 0.2)
        for number, left in ((1, 2), (2, 40)):
            car = np.s_[4:10, left : left + 10]
            semantic[car], instance[car], range_m[car], intensity[car] = CAR, number, 10.0 + number, 0.5
        valid, measured, away = np.ones((ROWS, COLUMNS), bool), intensity.copy(), range_m.copy()
        for left in (2, 40):
            valid[4:10, left : left + 10][:, LOST] = False
            # And a column whose rays went past the car: not its points.
            away[4:10, left + 9] = 40.0
        measured[semantic == CAR] *= 0.8 if scene % 2 else 1.25
        images.append(PolarImage(range_m.astype("f4"), intensity.astype("f4"), np.ones((ROWS, COLUMNS), bool)))
        rasters.append({"semantic": semantic, "instance": instance})
        sensed.append((np.where(valid, away, 0), np.where(valid, measured, 0), valid))
    names = tuple(f"{k:02d}" for k in range(SCENES))
    range_m, intensity, valid = (np.array(side) for side in zip(*sensed, strict=True))
    scan = scan_of(GRID, images, rasters)
    found = compare_objects(Comparison(scan, Measured(range_m, intensity, valid), names, names))
    return {one.kind: one for one in found}


def test_points_of_a_car_are_those_that_end_on_it(fidelity):
    car = fidelity["car"]
    assert car.targets == 2 * SCENES
    # 60 simulated, 42 measured.
    assert car.points.value == pytest.approx(100 * 18 / 42)
    assert car.points_more.value == pytest.approx(100 * 18 / 42)
    assert car.points.low == pytest.approx(car.points.high)


def test_absolute_errors_do_not_cancel_and_signed_ones_do(fidelity):
    car = fidelity["car"]
    assert car.intensity.value == pytest.approx(100 * (0.25 + 0.2) / 2, rel=1e-4)
    assert car.intensity_more.value == pytest.approx(100 * (0.25 - 0.2) / 2, rel=1e-4)
    assert car.intensity.low < car.intensity.value < car.intensity.high


def test_an_absolute_error_is_nowhere_below_0():
    """One scene of many with poles far off spreads the interval of their mean."""
    scenes = [np.array([share]) for share in (0.01, 0.01, 0.02, 0.9)]
    assert mean_over_scenes(scenes).low < 0
    assert mean_over_scenes(scenes, least=0.0).low == 0
    assert mean_over_scenes(scenes, least=0.0).high == mean_over_scenes(scenes).high


def test_what_has_no_number_is_seen_by_patches(fidelity):
    road = fidelity["road, patches"]
    assert road.targets == SCENES * 4
    assert road.points.value == 0
    assert road.intensity.value == pytest.approx(0, abs=1e-3)


def test_frames_without_classes_have_no_targets():
    image = PolarImage(
        np.full((ROWS, COLUMNS), 9, "f4"), np.full((ROWS, COLUMNS), 0.3, "f4"), np.ones((ROWS, COLUMNS), bool)
    )
    names = tuple("abcdef")
    measured = Measured(*(np.stack([leaf] * 6) for leaf in (image.range_m, image.intensity, image.valid)))
    assert compare_objects(Comparison(scan_of(GRID, [image] * 6), measured, names, names)) == ()
