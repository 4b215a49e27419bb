"""The table of drives that were never seen: its parts, on numbers made up."""

import numpy as np
import pytest

from benchmarks.studies.unseen_drives import FACTORS, Coverage, by_drive, scatter
from configs.kitti_drives import FOLDS

SCENES = ["2011_09_26_drive_0002_sync", "2011_09_26_drive_0001_sync", "2011_09_26_drive_0002_sync"]


def test_a_drives_error_is_that_of_its_cells():
    sums = [{"absolute": a, "cells": n} for a, n in ((1.0, 10.0), (3.0, 10.0), (5.0, 20.0))]
    assert by_drive(sums, SCENES) == {"0001": pytest.approx(0.3), "0002": pytest.approx(0.2)}


def judged(scenes: list[str], shares: list[float], *, width: float = 0.2) -> dict:
    """Frames of 100 measurements, of which so many lie inside at factor 1 and 5 more with each step of the factor."""
    steps = np.arange(len(FACTORS)) - np.argmin(np.abs(FACTORS - 1))
    inside = [np.clip(100 * share + 5 * steps, 0, 100).astype(int).tolist() for share in shares]
    return {"scenes": scenes, "covered": inside, "counts": [100] * len(scenes), "widths": [100 * width] * len(scenes)}


def test_coverage_counts_cells_and_tells_the_drives_apart():
    coverage = Coverage()
    coverage.add(0, judged(SCENES, [0.8, 0.5, 1.0]))
    text = coverage.told()
    assert text.startswith("90 % intervals cover 76.7 % (")
    assert "50.0 to 90.0 % by drive, with a mean width of 0.200" in text
    assert "other folds" not in text


def test_each_fold_is_widened_by_what_the_others_ask_for():
    coverage = Coverage()
    # Alone, the first would ask for 1.1 and the second for 1.3; each takes the other's.
    coverage.add(0, judged(["a_drive_0001_sync"], [0.8]))
    coverage.add(1, judged(["a_drive_0002_sync"], [0.6]))
    text = coverage.told()
    assert "With the quantiles of each fold 1.10 to 1.30 times as far" in text
    # 80 + 6 x 5, which is all, and 60 + 2 x 5.
    assert "ask for, 85.0 % (" in text
    assert "70.0 to 100.0 % by drive, with a mean width of 0.240" in text
    assert text.endswith("All drives together ask for 1.20")


def test_every_drive_is_a_dot_below_the_line_where_the_network_is_nearer():
    errors = {"0001": 0.08, "0002": 0.1}
    picture = scatter(errors, {"0001": 0.1, "0002": 0.1}, {"0001": 3, "0002": 1}).svg("drives")
    assert picture.count("<circle") == 2
    assert "0001" in picture


def test_every_drive_is_left_out_once():
    drives = [drive for fold in FOLDS for drive in fold.split(",")]
    assert len(drives) == len({*drives}) == 15
