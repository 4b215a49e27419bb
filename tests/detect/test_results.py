"""Detections as KITTI writes them."""

import numpy as np

from jaxsim.cloud.kitti_tree import label_lines
from jaxsim.detect.results import Detected, outlines, result_lines
from jaxsim.detect.scenes import scene_of_frame
from tests.detect.tiny import VIEW


def test_result_lines_are_the_labels_of_the_same_boxes(kitti):
    found = scene_of_frame(kitti[2], "Car", in_image=True)
    lines = result_lines(Detected(found.boxes[found.target], np.array([0.75], np.float32)), "Car", found.view)
    label = next(line for line in label_lines(found.labels) if line.startswith("Car "))
    (result,) = (line.split() for line in lines)
    wanted = label.split()
    assert result[0] == "Car"
    assert result[1:3] == ["-1", "-1"]
    assert result[15] == "0.7500"
    np.testing.assert_allclose(np.float64(result[8:15]), np.float64(wanted[8:]), atol=2e-3)
    np.testing.assert_allclose(float(result[3]), float(wanted[3]), atol=2e-2)
    np.testing.assert_allclose(np.float64(result[4:8]), np.float64(wanted[4:8]), atol=4)  # drawn by hand


def test_a_box_behind_the_camera_has_no_outline():
    boxes = np.array([[-5.0, 0, 0, 4, 2, 1.5, 0], [1.0, 0, -1, 4, 2, 1.5, 0.3]])
    behind, around = outlines(boxes, VIEW)
    assert behind.tolist() == [0, 0, 0, 0]
    assert np.isfinite(around).all()
    assert (around[:2] <= around[2:]).all()
    assert outlines(np.zeros((0, 7)), VIEW).shape == (0, 4)
