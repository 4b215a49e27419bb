"""Pictures and the page of clouds that a detector has looked at."""

import numpy as np

from jaxsim.detect.results import Detected
from jaxsim.evaluate.cloud_folder import AT_LIDAR, CloudFolder, write_detections
from jaxsim.report.detected import write_detected
from tests.detect.tiny import EXPERIMENT


def test_what_result_files_hold_is_drawn_and_turned(tmp_path):
    rng = np.random.default_rng(0)
    boxes = np.array([[10, 2, -1, 4, 2, 1.5, 0.3]], np.float32)
    clouds, out = tmp_path / "clouds", tmp_path / "out"
    clouds.mkdir()
    for name in ("a", "b"):
        rng.uniform(0, 1, (50, 4)).astype(np.float32).tofile(clouds / f"{name}.bin")
        found = Detected(boxes, np.array([0.7], np.float32))
        write_detections(out / "results" / f"{name}.txt", found, "Car", view=AT_LIDAR)
    folder = CloudFolder(clouds)
    page = write_detected(folder, [clouds / "a.bin"], out, experiment=EXPERIMENT, sentence="Cars in two clouds.")
    assert page == out / "clouds.html"
    assert "Cars in two clouds." in page.read_text()
    assert [path.name for path in (out / "pictures").iterdir()] == ["a_above.png"]
