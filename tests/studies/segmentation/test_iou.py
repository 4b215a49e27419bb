"""Shares of cells against their definition."""

import numpy as np
import pytest

from jaxsim.studies.segmentation.iou import INTENSITIES, class_iou, confusion, mean_iou, worth


def test_confusions_and_iou_equal_their_definition():
    random = np.random.default_rng(0)
    label, told = random.integers(0, 4, (2, 5, 7))
    told = np.maximum(told, 1)
    found = class_iou(confusion(label, told, 5))
    for k in (1, 2, 3):
        true, guess = label == k, (told == k) & (label > 0)
        assert found[k - 1] == pytest.approx((true & guess).sum() / (true | guess).sum())
    assert np.isnan(found[3])


def test_a_class_that_is_not_there_is_not_averaged_whoever_is_told_to_be_one():
    right = np.diag([0, 10, 10, 0])
    slip = right - np.diag([0, 0, 1, 0])
    slip[2, 3] = 1
    assert mean_iou(class_iou(right)[None]) == 1
    assert mean_iou(class_iou(slip)[None]) == pytest.approx((1 + 9 / 10) / 2)


def test_the_worth_is_the_share_of_the_gain():
    rows = {"none": [[0.2, 0.4]], "simulated": [[0.5, 0.5]], "measured": [[0.6, 0.6]]}
    assert worth({k: np.array(x) for k, x in rows.items()}) == pytest.approx(2 / 3)
    assert np.isnan(worth({k: np.array(rows["none"]) for k in INTENSITIES}))
