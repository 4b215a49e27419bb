"""Who is matched with whom."""

import pytest

from tests.metrics.made_detection import car, many, scores


def test_a_second_detection_of_a_car_is_false(tmp_path):
    found = [car(0, score=0.9, shift=0.05), car(0, score=0.8)]
    curve = scores(tmp_path, *many([car(0)], found))["easy", "bbox"]
    # At the threshold 0.9 only the first is there.
    assert curve.ap_r40 == pytest.approx(100)
    worse = [car(0, score=0.9, shift=0.5), car(0, score=0.8)]
    assert scores(tmp_path, *many([car(0)], worse))["easy", "bbox"].ap_r40 == pytest.approx(50)


def test_the_second_pass_prefers_overlap_where_the_first_took_the_score(tmp_path):
    # Both match; thresholds come from the higher score. At it only that one is there, so nothing is false.
    found = [car(0, score=0.9, shift=0.1), car(0, score=0.9)]
    curve = scores(tmp_path, *many([car(0)], found))["easy", "bbox"]
    assert curve.threshold.tolist() == [0.9] * 41
    assert curve.ap_r40 == pytest.approx(50)
    assert scores(tmp_path, *many([car(0)], found))["easy", "aos"].ap_r40 == pytest.approx(50)
