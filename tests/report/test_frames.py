"""A frame as a picture: a panel for what went in, what was predicted and what was measured."""

import numpy as np
import pytest

from jaxsim.frame import Painted, Pair, PolarImage
from jaxsim.report import pair_picture, simulated_picture
from jaxsim.report.frames import input_panels, intensity_panel
from jaxsim.report.pictures import NOTHING

SHAPE = (8, 48)


@pytest.fixture
def pair() -> Pair:
    rng = np.random.default_rng(0)
    raster = rng.uniform(0.1, 0.6, SHAPE).astype(np.float32)
    classes = np.full(SHAPE, 7, np.int32)
    everywhere = np.ones(SHAPE, bool)
    rgb = rng.uniform(0, 1, (*SHAPE, 3)).astype(np.float32)
    painted = Painted(30 * raster, 29 * raster, rgb, classes, classes, everywhere, ~everywhere)
    return Pair(painted, raster, raster, raster, PolarImage(30 * raster, raster, everywhere))


def test_cells_without_a_return_are_grey():
    intensity = np.full(SHAPE, 0.3, np.float32)
    valid = np.ones(SHAPE, bool)
    valid[0] = False
    panel = intensity_panel(intensity, valid)
    assert (panel[0] == NOTHING).all()
    assert not (panel[1] == NOTHING).all(axis=-1).any()


def test_classes_are_a_panel_where_the_camera_knows_them(pair: Pair):
    assert len(input_panels(pair.painted)) == 3
    unknown = pair.painted.replace(semantic=np.zeros(SHAPE, np.int32))
    assert len(input_panels(unknown)) == 2


def test_prediction_measurement_and_difference_lie_below_the_input(pair: Pair):
    picture = pair_picture(pair, np.asarray(pair.target), title="step 3")
    simulated = simulated_picture(pair.measured, pair.painted, title="frame")
    height = simulated.shape[0] // 4
    assert picture.shape[0] == 6 * height
    # Prediction and measurement are the same here, so their panels are, below their titles.
    np.testing.assert_array_equal(picture[3 * height + 26 : 4 * height], picture[4 * height + 26 : 5 * height])
