"""Tables, files and pictures of a detector's scores, from curves made by hand."""

import json
import math

import numpy as np

from jaxsim.metrics.detection import DIFFICULTIES, OVERLAP_SETS, PRINTED_COLUMNS, Curve
from jaxsim.report.detection import detection_table, mean_table, write_detection

METRICS = ("3d", "bev", "bbox", "aos")


def curve(difficulty: str, metric: str, overlap_set: str, *, reached: int, truths: int = 50) -> Curve:
    """Precision 1 up to a recall of `reached` fortieths, 0 beyond."""
    return Curve(
        kind="Car",
        difficulty=difficulty,
        overlap_set=overlap_set,
        metric=metric,
        min_overlap=0.7,
        precision=np.where(np.arange(41) <= reached, 1.0, 0.0),
        recall=np.linspace(0, 0.5, 21),
        threshold=np.linspace(1, 0, 21),
        truths=truths,
        detections=60,
    )


def all_curves(**known: int) -> list[Curve]:
    return [curve(d, m, o, **known) for d in DIFFICULTIES for m in METRICS for o in OVERLAP_SETS]


def test_a_row_a_difficulty_and_a_dash_where_nothing_counts():
    lines = detection_table(all_curves(reached=10)).splitlines()
    assert lines[0].startswith("| Car, AP R40 | labels | detections |")
    assert [line.split(" | ")[0][2:] for line in lines[2:5]] == list(DIFFICULTIES)
    assert " 25.00 " in lines[2]
    assert " - " in detection_table(all_curves(reached=0, truths=0))


def test_means_stand_beside_their_spread():
    metric, overlap_set = PRINTED_COLUMNS[0]
    means = {(metric, overlap_set, name): (50.0, 2.5) for name in DIFFICULTIES}
    (row,) = mean_table(means).splitlines()[2:]
    assert row.count("50.00 (2.50)") == len(DIFFICULTIES)


def test_files_hold_every_curve_and_json_has_no_nan(tmp_path):
    curves = all_curves(reached=10)
    metric, overlap_set = PRINTED_COLUMNS[0]
    means = {(metric, overlap_set, name): (math.nan, math.nan) for name in DIFFICULTIES}
    write_detection(tmp_path, curves, about={"frames": 3}, mean=("the mean of none", means))
    text = (tmp_path / "detection.json").read_text()
    assert "NaN" not in text
    content = json.loads(text)
    assert len(content["curves"]) == len(curves)
    assert content["mean"]["averages"][0]["ap_r40"] is None
    page = (tmp_path / "detection.md").read_text()
    assert page.startswith("- frames: 3\n\n")
    assert "the mean of none" in page
    drawn = sorted(tmp_path.glob("precision_recall_*.svg"))
    assert len(drawn) == len(OVERLAP_SETS)
    assert all(path.read_text().count("<polyline") > 12 for path in drawn)
