"""The table of drives that were never seen: its parts, on numbers made up."""

import numpy as np
import pytest

from benchmarks.studies.unseen_drives import by_drive, coverage_of, scatter
from configs.kitti_drives import FOLDS

SCENES = ["2011_09_26_drive_0002_sync", "2011_09_26_drive_0001_sync", "2011_09_26_drive_0002_sync"]


def test_a_drives_error_is_that_of_its_cells():
    sums = [{"absolute": a, "cells": n} for a, n in ((1.0, 10.0), (3.0, 10.0), (5.0, 20.0))]
    assert by_drive(sums, SCENES) == {"0001": pytest.approx(0.3), "0002": pytest.approx(0.2)}


def test_coverage_counts_cells_and_tells_the_drives_apart():
    covered = np.array([[80.0, 100.0, 20.0], [50.0, 100.0, 10.0], [100.0, 100.0, 30.0]])
    text = coverage_of(covered, SCENES)
    assert text.startswith("90 % intervals cover 76.7 % (")
    assert "50.0 to 90.0 % by drive; their mean width is 0.200" in text


def test_every_drive_is_a_dot_below_the_line_where_the_network_is_nearer():
    errors = {"0001": 0.08, "0002": 0.1}
    picture = scatter(errors, {"0001": 0.1, "0002": 0.1}, {"0001": 3, "0002": 1}).svg("drives")
    assert picture.count("<circle") == 2
    assert "0001" in picture


def test_every_drive_is_left_out_once():
    drives = [drive for fold in FOLDS for drive in fold.split(",")]
    assert len(drives) == len({*drives}) == 15
