import numpy as np
import pytest

from jaxsim.metrics.depth import depth_errors, depth_scores


def test_errors_are_the_benchmarks():
    truth = np.array([[10.0, 20.0, 40.0, 5.0]], np.float32)
    guess = np.array([[11.0, 18.0, 40.0, 9.0]], np.float32)
    known, guessed = np.array([[True, True, True, True]]), np.array([[True, True, True, False]])
    errors = depth_errors(guess, guessed, truth, known)
    assert errors["mae"] == pytest.approx(1000.0)
    assert errors["rmse"] == pytest.approx(1e3 * np.sqrt(5 / 3))
    inverse = np.array([1 / 10 - 1 / 11, 1 / 18 - 1 / 20, 0]) * 1e3
    assert errors["imae"] == pytest.approx(inverse.mean())
    assert errors["irmse"] == pytest.approx(np.sqrt((inverse**2).mean()))
    assert errors["filled"] == 0.75


def test_scores_are_means_over_images_not_over_pixels():
    scores = depth_scores([dict.fromkeys(("rmse", "mae", "irmse", "imae", "filled"), value) for value in (1.0, 3.0)])
    assert scores["rmse"] == (2.0, "mm", 2)
    assert scores["imae"].unit == "1/km"


def test_bad_input_yields_no_number():
    ones, mask = np.ones((2, 2), np.float32), np.ones((2, 2), bool)
    with pytest.raises(ValueError, match="no pixel has both"):
        depth_errors(ones, ~mask, ones, mask)
    with pytest.raises(ValueError, match="guessed depths go from 0 to 0"):
        depth_errors(0 * ones, mask, ones, mask)
    with pytest.raises(ValueError, match="no image"):
        depth_scores([])
