"""A folder of clouds for a detector."""

import numpy as np
import pytest

from jaxsim.detect.results import Detected
from jaxsim.detect.steps import Network
from jaxsim.evaluate.cloud_folder import (
    AT_LIDAR,
    CloudFolder,
    clouds_in,
    detect_folder,
    read_points,
    write_detections,
)
from jaxsim.evaluate.detector import LearnedDetector
from jaxsim.files import files_in
from tests.detect.tiny import EXPERIMENT


def test_broken_clouds_are_named(tmp_path):
    with pytest.raises(ValueError, match="there is no such folder"):
        clouds_in(tmp_path / "none")
    with pytest.raises(ValueError, match=r"it holds no \.bin or \.npz"):
        clouds_in(tmp_path)
    (tmp_path / "a.bin").write_bytes(b"")
    with pytest.raises(ValueError, match=r"a\.bin is empty"):
        read_points(tmp_path / "a.bin")
    np.savez(tmp_path / "b.npz", xyz=np.ones((4, 3)))
    with pytest.raises(ValueError, match="3 columns, no intensity"):
        read_points(tmp_path / "b.npz")
    np.savez(tmp_path / "c.npz", points=np.ones((4, 3)))
    with pytest.raises(ValueError, match="no array xyz"):
        read_points(tmp_path / "c.npz")
    np.savez(tmp_path / "a.npz", xyz=np.ones((4, 3)))
    with pytest.raises(ValueError, match="a twice"):
        clouds_in(tmp_path)


def test_clouds_are_read_in_metres_with_their_intensity(tmp_path):
    points = np.float32([[1, 2, 3, 0.5], [4, 5, 6, 0.25]])
    points.tofile(tmp_path / "a.bin")
    np.savez(tmp_path / "b.npz", xyz=points[:, :3], intensity=points[:, 3])
    assert [path.name for path in clouds_in(tmp_path)] == ["a.bin", "b.npz"]
    for path in clouds_in(tmp_path):
        np.testing.assert_array_equal(read_points(path), points)


def test_without_a_calibration_boxes_are_written_as_seen_from_the_lidar_without_a_rectangle(tmp_path):
    folder = CloudFolder(tmp_path)
    assert folder.view("a") is AT_LIDAR
    assert folder.labelled("a", AT_LIDAR, "Car") is None
    with pytest.raises(ValueError, match="give --images"):
        folder.image("a")
    found = Detected(np.float32([[10, 2, -1, 4, 1.6, 1.5, 0]]), np.float32([0.9]))
    write_detections(tmp_path / "a.txt", found, "Car", view=AT_LIDAR)
    words = (tmp_path / "a.txt").read_text().split()
    assert words[4:8] == ["0", "0", "0", "0"]
    assert [float(word) for word in words[11:14]] == pytest.approx([-2, 1.75, 10], abs=0.01)


def test_a_missing_calibration_is_told_once_the_other_clouds_are_done(samples, tmp_path, monkeypatch):
    monkeypatch.setattr(
        "jaxsim.evaluate.cloud_folder.make_find",
        lambda _: lambda network, points: (Detected(np.zeros((0, 7), np.float32), np.zeros(0, np.float32)), {}),
    )
    folder = CloudFolder(tmp_path / "clouds", samples / "kitti_object/training/calib")
    folder.clouds.mkdir()
    for name in ("000000", "000001", "none"):
        np.float32([[1, 2, 3, 0.5]]).tofile(folder.clouds / f"{name}.bin")
    detector = LearnedDetector(EXPERIMENT, Network({}, {}))
    with pytest.raises(ValueError, match=r"^detect: 1 of 3 pieces of work failed, the others are done; .*none\.txt"):
        detect_folder(folder, detector, tmp_path / "out")
    assert [path.name for path in files_in(tmp_path / "out/results", ".txt")] == ["000000.txt", "000001.txt"]
