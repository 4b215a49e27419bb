import numpy as np
import pytest

from jaxsim.metrics.depth import benchmark_errors, depth_errors, depth_scores, interpolate_background


def test_errors_are_the_benchmarks():
    truth = np.array([[10.0, 20.0, 40.0, 5.0]], np.float32)
    guess = np.array([[11.0, 18.0, 40.0, 9.0]], np.float32)
    known, guessed = np.array([[True, True, True, True]]), np.array([[True, True, True, False]])
    errors = depth_errors(guess, guessed, truth, known=known)
    assert errors["mae"] == pytest.approx(1000.0)
    assert errors["rmse"] == pytest.approx(1e3 * np.sqrt(5 / 3))
    inverse = np.array([1 / 10 - 1 / 11, 1 / 18 - 1 / 20, 0]) * 1e3
    assert errors["imae"] == pytest.approx(inverse.mean())
    assert errors["irmse"] == pytest.approx(np.sqrt((inverse**2).mean()))
    assert errors["filled"] == 0.75


def devkit(depth, valid):
    """The devkit's loops, pixel by pixel: along the rows, then at the columns' ends."""
    image = [[float(d) if v else None for d, v in zip(*row, strict=True)] for row in zip(depth, valid, strict=True)]
    for row in image:
        seen = [u for u, d in enumerate(row) if d is not None]
        for u in range(len(row)):
            left, right = [s for s in seen if s <= u][-1:], [s for s in seen if s >= u][:1]
            if seen:
                row[u] = min(row[s] for s in left + right)
    for u in range(len(image[0])):
        seen = [v for v, row in enumerate(image) if row[u] is not None]
        for v, row in enumerate(image):
            if seen and v < seen[0]:
                row[u] = image[seen[0]][u]
            elif seen and v > seen[-1]:
                row[u] = image[seen[-1]][u]
    return np.array([[0 if d is None else d for d in row] for row in image]), np.array(
        [[d is not None for d in row] for row in image]
    )


@pytest.mark.parametrize(("seed", "share"), [(0, 0.3), (1, 0.05), (2, 0.02), (3, 0.0), (4, 1.0)])
def test_holes_are_filled_as_the_devkit_fills_them(seed, share):
    rng = np.random.default_rng(seed)
    valid = rng.random((12, 17)) < share
    depth = np.where(valid, rng.uniform(1, 80, valid.shape), np.nan).astype(np.float32)
    dense, known = interpolate_background(depth, valid)
    expected, filled = devkit(depth, valid)
    np.testing.assert_array_equal(known, filled)
    np.testing.assert_array_equal(dense, expected.astype(np.float32))
    np.testing.assert_array_equal(dense[valid], depth[valid])


def test_the_benchmark_scores_holes_by_the_nearer_neighbour():
    truth = np.array([[10.0, 20.0, 40.0, 5.0], [8.0, 8.0, 8.0, 8.0]], np.float32)
    guess = np.array([[11.0, 0.0, 38.0, 0.0], [0.0, 0.0, 0.0, 0.0]], np.float32)
    known = np.array([[True, True, True, True], [False, False, False, True]])
    errors = benchmark_errors(guess, guess > 0, truth, known=known)
    # 11 for the 20, 38 for the 5 at the row's end, and 38 below it.
    assert errors["mae"] == pytest.approx(1e3 * np.mean([1, 9, 2, 33, 30]))
    assert errors["filled"] == pytest.approx(2 / 5)
    assert depth_errors(guess, guess > 0, truth, known=known)["mae"] == pytest.approx(1500)


def test_scores_are_means_over_images_not_over_pixels():
    scores = depth_scores([dict.fromkeys(("rmse", "mae", "irmse", "imae", "filled"), value) for value in (1.0, 3.0)])
    assert scores["rmse"] == (2.0, "mm", 2)
    assert scores["imae"].unit == "1/km"


def test_bad_input_yields_no_number():
    ones, mask = np.ones((2, 2), np.float32), np.ones((2, 2), bool)
    with pytest.raises(ValueError, match="no pixel has both"):
        depth_errors(ones, ~mask, ones, known=mask)
    with pytest.raises(ValueError, match="guessed depths go from 0 to 0"):
        depth_errors(0 * ones, mask, ones, known=mask)
    rows = np.array([[True, True], [False, False], [True, True]])
    with pytest.raises(ValueError, match="2 known pixels lie in rows where nothing is guessed"):
        benchmark_errors(np.ones((3, 2), np.float32), rows, np.ones((3, 2), np.float32), known=np.ones((3, 2), bool))
    with pytest.raises(ValueError, match="no image"):
        depth_scores([])
