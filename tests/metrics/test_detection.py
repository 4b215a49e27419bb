"""Cases made by hand, in each of which one rule of the evaluation decides."""

import dataclasses
import json
import math

import numpy as np
import pytest

from jaxsim.cli.eval_detection import Detection
from jaxsim.metrics.detection import evaluate, read_detections, read_truth
from jaxsim.report.detection import detection_table, write_detection
from tests.metrics.made_detection import car, many, scores


def region(place):
    left = 90.0 * place
    return f"DontCare -1 -1 -10 {left:.2f} 90.00 {left + 80:.2f} 170.00 -1 -1 -1 -1000 -1000 -1000 -10"


def test_perfect_cars_score_all(tmp_path):
    curves = scores(tmp_path, *many([car(0), car(2)], [car(0, score=0.9), car(2, score=0.8)]))
    assert {round(c.ap_r40, 9) for c in curves.values()} == {round(c.ap_r11, 9) for c in curves.values()} == {100.0}
    assert curves["easy", "3d"].recall[-1] == 1
    assert (curves["easy", "3d"].truths, curves["easy", "3d"].detections) == (100, 100)


def test_few_cars_cannot_fill_the_41_slots(tmp_path):
    curves = scores(tmp_path, *[([car(0)], [car(0, score=0.5 + n / 100)]) for n in range(9)])
    assert curves["easy", "3d"].ap_r40 == pytest.approx(20)
    assert curves["easy", "3d"].ap_r11 == pytest.approx(300 / 11)
    table = detection_table([*curves.values(), *both_sets(curves.values())])
    assert "at most easy 20.0, moderate 20.0, hard 20.0" in table


def test_a_detection_of_nothing_halves_precision_and_one_in_a_dont_care_region_does_not(tmp_path):
    labels, found = [car(0), region(3)], [car(0, score=0.5), car(3, score=0.9, x=90)]
    curves = scores(tmp_path, *many(labels, found))
    assert curves["easy", "bbox"].ap_r40 == pytest.approx(100)
    assert curves["easy", "3d"].ap_r40 == pytest.approx(50)
    lower = [car(0), region(3).replace("DontCare", "dontcare")]
    assert scores(tmp_path, *many(lower, found))["easy", "bbox"].ap_r40 == pytest.approx(100)
    assert scores(tmp_path, *many(lower, found), rules="openpcdet")["easy", "bbox"].ap_r40 == pytest.approx(50)


def test_a_region_must_hold_more_of_a_detection_than_the_overlap_asked(tmp_path):
    for shift, average in ((0.2, 100), (0.4, 50)):
        found = [car(0, score=0.5), car(3, score=0.9, x=90, shift=shift)]
        curves = scores(tmp_path, *many([car(0), region(3)], found))
        assert curves["easy", "bbox"].ap_r40 == pytest.approx(average)


def test_overlap_must_exceed_the_limit(tmp_path):
    # Rectangles that share 7 of 10 parts have exactly the limit; in floating point 0.7 is not above 0.7.
    label = "Car 0 0 0 0 0 10 50 1.5 1.6 3.9 0 1.6 20 0"
    found = "Car 0 0 0 0 0 {} 50 1.5 1.6 3.9 0 1.6 20 0 0.9"
    assert scores(tmp_path, *many([label], [found.format(7)]))["easy", "bbox"].ap_r40 == 0
    assert scores(tmp_path, *many([label], [found.format(7.01)]))["easy", "bbox"].ap_r40 == pytest.approx(100)


@pytest.mark.parametrize(("rules", "truths"), [("official", 50), ("openpcdet", 0)])
def test_a_label_of_exactly_the_height_limit_counts_in_the_official_tool_alone(tmp_path, rules, truths):
    curves = scores(tmp_path, *many([car(0, height=40)], [car(0, height=40, score=0.9)]), rules=rules)
    assert curves["easy", "3d"].truths == truths
    assert curves["moderate", "3d"].truths == 50


def test_hidden_labels_are_ignored_and_not_missed(tmp_path):
    hard = [car(0), car(2, occluded=2), car(4, truncated=0.45), car(6, height=24), car(8, kind="Van")]
    found = [car(k, score=0.9) for k in (0, 2, 4, 8)] + [car(6, height=24, score=0.9)]
    for some in (found, found[:1]):
        curves = scores(tmp_path, *many(hard, some))
        assert curves["easy", "3d"].ap_r40 == pytest.approx(100)
        assert curves["easy", "3d"].truths == 50
    assert curves["hard", "3d"].truths == 150
    # A third is found; the score that comes last always takes a slot, the 14th after recall 0.
    assert curves["hard", "3d"].ap_r40 == pytest.approx(100 * 14 / 40)


def test_a_small_detection_of_any_class_takes_a_car_away(tmp_path):
    small = car(0, kind="Cyclist", height=39, score=0.95)
    found = [car(0, height=42, score=0.9)]
    labels = [car(0, height=42)]
    assert scores(tmp_path, *many(labels, found))["easy", "bbox"].ap_r40 == pytest.approx(100)
    # Beside a detection that counts it is left alone; where it is the only one, the car is neither found nor missed.
    both = scores(tmp_path, *many(labels, [small, *found]))
    assert both["easy", "bbox"].ap_r40 == 0  # the first pass takes the highest score, whatever it is
    alone = scores(tmp_path, *many(labels, found), *many(labels, [small]))
    assert alone["easy", "bbox"].truths == 100
    assert len(alone["easy", "bbox"].threshold) < 41
    assert alone["easy", "bbox"].recall[-1] == 1


def test_orientation_scores_by_the_cosine_and_is_left_out_where_alpha_is_unknown(tmp_path):
    turned = [car(0, alpha=math.pi / 2, score=0.9)]
    assert scores(tmp_path, *many([car(0)], turned))["easy", "aos"].ap_r40 == pytest.approx(50)
    mixed = [*many([car(0)], [car(0, score=0.9)]), ([car(0)], [car(0, score=0.9, alpha=-10)])]
    assert ("easy", "aos") not in scores(tmp_path, *mixed)
    assert ("easy", "aos") in scores(tmp_path, *mixed, rules="openpcdet")
    assert ("easy", "aos") not in scores(tmp_path, *mixed[::-1], rules="openpcdet")


def test_a_difficulty_without_labels_has_no_average(tmp_path):
    curves = scores(tmp_path, *many([car(0, occluded=1)], [car(0, score=0.9)]))
    assert math.isnan(curves["easy", "3d"].ap_r40)
    assert math.isnan(curves["easy", "3d"].ap_r11)
    assert curves["moderate", "3d"].ap_r40 == pytest.approx(100)
    table = detection_table([*curves.values(), *both_sets(curves.values())])
    assert "| easy | 0 | 50 | - |" in table
    assert "at most" not in table


def both_sets(curves):
    return [dataclasses.replace(c, overlap_set="0.5") for c in curves]


def test_float_occlusions_are_refused_by_the_official_rules_and_read_by_the_others(tmp_path):
    frames = many([car(0, occluded=0.35)], [car(0, score=0.9)])
    with pytest.raises(ValueError, match=r"occluded is 0.35 in the label of 000000.*--rules openpcdet"):
        scores(tmp_path, *frames)
    curves = scores(tmp_path, *frames, rules="openpcdet")
    assert curves["easy", "3d"].truths == 0
    assert curves["moderate", "3d"].ap_r40 == pytest.approx(100)


def test_unknown_classes_and_other_frames_are_refused(tmp_path):
    scores(tmp_path, *many([car(0)], [car(0, score=1)], copies=2))
    truth, found = read_truth(tmp_path / "label", ["000000"]), read_detections(tmp_path / "found")
    with pytest.raises(ValueError, match="1 frames of labels"):
        evaluate(truth, found)
    with pytest.raises(ValueError, match="unknown class 'Bus'; known: Car"):
        evaluate(truth, truth, classes=("Bus",))


def test_json_holds_every_curve_and_no_nan(tmp_path):
    curves = list(scores(tmp_path, *many([car(0, occluded=1)], [car(0, score=0.9)])).values())
    write_detection(tmp_path / "out", curves + both_sets(curves), about={"frames": 50})
    content = json.loads((tmp_path / "out/detection.json").read_text())
    row = next(c for c in content["curves"] if (c["difficulty"], c["metric"]) == ("easy", "3d"))
    assert (row["ap_r40"], row["labels"], row["unit"]) == (None, 0, "%")
    assert {p.name for p in (tmp_path / "out").iterdir()} == {
        "detection.json",
        "detection.md",
        "precision_recall_0.7.svg",
        "precision_recall_0.5.svg",
    }


def test_the_command_scores_a_folder(tmp_path, capsys):
    scores(tmp_path, *many([car(0)], [car(0, score=0.9)]))
    (tmp_path / "label/000099.txt").write_text(car(0))
    arguments = {"detections": tmp_path / "found", "labels": tmp_path / "label", "out": tmp_path / "out"}
    Detection(**arguments)()
    printed = capsys.readouterr().out
    assert "50 frames of 51 labelled" in printed
    assert "| easy | 50 | 50 | 100.00 | 100.00 | 100.00 | 100.00 | 100.00 | 100.00 |" in printed
    assert np.isclose(json.loads((tmp_path / "out/detection.json").read_text())["curves"][0]["ap_r40"], 100)
    (tmp_path / "val.txt").write_text("000000\n000099\n")
    with pytest.raises(ValueError, match=r"lacks the detection file of 1 of 2 frames: 000099\.txt\. A frame without"):
        Detection(**arguments, frames=tmp_path / "val.txt")()
