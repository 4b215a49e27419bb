"""Pictures of rasters and clouds."""

import cv2
import numpy as np
import pytest

from jaxsim.report.pictures import NOTHING, beside, colour_classes, colour_scalar, draw_cloud, save_picture, strip


def test_cells_without_a_value_are_grey_and_the_others_follow_the_scale():
    value = np.array([[0.0, 1.0, 0.5]])
    rgb = colour_scalar(value, np.array([[True, True, False]]), low=0, high=1)
    assert rgb[0, 2].tolist() == NOTHING.tolist()
    assert rgb[0, 0].tolist() != rgb[0, 1].tolist()


def test_classes_have_cityscapes_colours():
    rgb = colour_classes(np.array([[7, 26]]), np.array([[True, True]]))
    assert rgb[0].tolist() == [[128, 64, 128], [0, 0, 142]]


def test_panels_share_a_width_and_pictures_a_height():
    panel = np.zeros((4, 8, 3), np.uint8)
    assert strip([("one", panel), ("two", panel)], width=80).shape == (2 * (26 + 40), 80, 3)
    assert beside([panel, panel[:2]]).shape == (4, 24, 3)


def test_points_ahead_are_drawn_and_those_behind_are_not():
    empty = draw_cloud(np.zeros((0, 4), np.float32))
    ahead = draw_cloud(np.float32([[20, 0, -1, 0.5]]))
    behind = draw_cloud(np.float32([[-60, 0, -1, 0.5]]))
    assert (ahead != empty).any()
    assert (behind == empty).all()


def test_a_picture_is_read_back_as_it_was_and_an_unknown_format_is_refused(tmp_path):
    rgb = np.arange(48, dtype=np.uint8).reshape(4, 4, 3)
    path = save_picture(tmp_path / "new" / "a.png", rgb)
    np.testing.assert_array_equal(cv2.imread(str(path))[..., ::-1], rgb)
    with pytest.raises((OSError, cv2.error)):
        save_picture(tmp_path / "a.nothing", rgb)
    assert not (tmp_path / "a.nothing").exists()
