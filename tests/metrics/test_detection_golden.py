"""Every precision that the official tool and OpenPCDet gave, on the golden label and detection files."""

import json
import zipfile

import numpy as np
import pytest

from jaxsim.metrics.detection import DIFFICULTIES, OVERLAP_SETS, SCORED, evaluate, read_detections, read_truth
from jaxsim.metrics.detection.files import frames_with_results


def scored(golden, folder, case, rules):
    with zipfile.ZipFile(golden / "kitti_eval" / f"{case}.zip") as archive:
        archive.extractall(folder)
    names = frames_with_results(next(folder.rglob("label_2")))
    truth = read_truth(next(folder.rglob("label_2")), names)
    return evaluate(truth, read_detections(next(folder.rglob("detections")), names), rules=rules)


@pytest.mark.parametrize("rules", ["official", "openpcdet"])
@pytest.mark.parametrize("case", ["main", "edge", "tiny"])
def test_precisions_are_those_of_both_tools(golden, tmp_path, case, rules):
    curves = scored(golden, tmp_path, case, rules)
    expected = np.load(golden / "kitti_eval" / f"{case}_precision.npz")
    published = json.loads((golden / "kitti_eval" / "ap.json").read_text())[case][rules]
    assert len(curves) == 3 * 3 * 2 * 4
    for curve in curves:
        place = (
            list(SCORED).index(curve.kind),
            list(DIFFICULTIES).index(curve.difficulty),
            list(OVERLAP_SETS).index(curve.overlap_set),
        )
        where = f"{curve.kind} {curve.difficulty} {curve.overlap_set} {curve.metric}"
        theirs = expected[f"{rules}_{curve.metric}"][place]
        if rules == "official" and not expected["official_class_evaluated"][place[0], place[2]].any():
            assert not curve.precision.any()
            continue
        assert curve.precision == pytest.approx(theirs, abs=1e-6), where
        table = published[curve.metric].get(f"{curve.kind} set{curve.overlap_set}")
        if curve.truths:
            k = place[1]
            assert (curve.ap_r11, curve.ap_r40) == pytest.approx((table["R11"][k], table["R40"][k]), abs=2e-6), where
