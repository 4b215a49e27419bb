"""Result files and labels that cannot be scored."""

import math

import pytest

from jaxsim.metrics.detection import read_detections
from jaxsim.metrics.detection.files import frame_list, frames_with_results
from tests.metrics.made_detection import car


def test_files_that_cannot_be_scored_are_named(tmp_path):
    found = tmp_path / "found"
    found.mkdir()
    with pytest.raises(ValueError, match="holds no NUMBER"):
        frames_with_results(found)
    (found / "data").mkdir()
    (found / "data/000000.txt").write_text("")
    with pytest.raises(ValueError, match="its data/ has some"):
        frames_with_results(found)
    (found / "000000.txt").write_text("")
    with pytest.raises(ValueError, match=r"lacks the detection file of 2 of 3 frames: 000001.txt, 000007.txt"):
        read_detections(found, ["000000", "000001", "000007"])
    assert len(read_detections(found).frame) == 0
    with pytest.raises(ValueError, match="no list"):
        frame_list(tmp_path / "val.txt")
    for line, message in (
        (car(0), "line 2 has 15 columns .*a detection has 16"),
        (car(0, score=0.5) + " 1", "line 2 has 17 columns"),
        (car(0, score="nan"), "line 2: column 16 is nan"),
        (car(0, x=math.nan, score=0.5), "line 2: column 12 is nan"),
        (car(0, x=math.inf, score=0.5), "line 2: column 12 is inf"),
        (car(0, height=-60.0, score=0.5), "line 2: the image box is .* must be left, top, right, bottom"),
        (car(0, score="high"), "line 2: columns 2 to 16 are numbers: 'high' is no number"),
    ):
        (found / "000000.txt").write_text(f"{car(1, score=0.4)}\n{line}\n")
        with pytest.raises(ValueError, match=message):
            read_detections(found)


def test_each_value_is_measured_and_not_their_sum(tmp_path):
    words = car(0, score=0.5).split()
    words[4:8] = ["0", "0", "60000", "60000"]
    (tmp_path / "000000.txt").write_text(" ".join(words))
    assert read_detections(tmp_path).bbox_px.tolist() == [[0, 0, 60000, 60000]]
