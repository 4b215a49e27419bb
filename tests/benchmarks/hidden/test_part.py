"""Effects that are hidden in a part of a case act there alone."""

import json

import numpy as np
import pytest

from benchmarks.blind.hidden import make_case
from benchmarks.blind.hidden.frames import make_grid
from benchmarks.blind.hidden.part import KINDS, draw_part
from benchmarks.blind.regimes import cells, cells_of, f1

SMALL = {"scenes": 8, "rows": 12, "columns": 48, "nuisance": "exact", "severity": 8.0, "seed": 5}


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "everywhere"])
def test_rays_outside_read_what_they_do_without_the_effect(tmp_path, kind):
    key = make_case(tmp_path / "case", effect="beam_range_bias", part=kind, **SMALL)
    grid = json.loads((tmp_path / "case" / "measured" / "grid.json").read_text())
    inside = cells(key.part, grid)
    assert 0.1 < inside.mean() < 0.7
    off = []
    for name in grid["frames"]:
        with (
            np.load(tmp_path / "case" / "measured" / f"{name}.npz") as m,
            np.load(tmp_path / "case" / "simulated" / f"{name}.npz") as s,
        ):
            seen = (m["range"] > 0) & (s["range"] > 0) & (s["range"] < 30)
            off.append(np.where(seen, m["range"] - s["range"], np.nan))
    by_row = [np.nanmedian(np.where(where[:, None], np.stack(off), np.nan), (0, 2)) for where in (inside, ~inside)]
    bias = np.array(key.effects[0]["parameters"]["bias_m"], float)
    known = np.isfinite(bias) & np.isfinite(by_row[0]) & np.isfinite(by_row[1])
    assert np.corrcoef(by_row[0][known], bias[known])[0, 1] > 0.9
    assert np.std(by_row[1][known]) < 0.3 * np.std(by_row[0][known])


def test_other_tags_than_the_one_that_matters_are_there(tmp_path):
    make_case(tmp_path / "case", effect="beam_gain", part="tag", **SMALL)
    grid = json.loads((tmp_path / "case" / "simulated" / "grid.json").read_text())
    assert {tag for one in grid["frames"].values() for tag in one["tags"]} == {"night", "rain", "wet"}


def test_a_part_that_is_not_known_is_refused():
    rng = np.random.default_rng(0)
    with pytest.raises(ValueError, match="choose one of everywhere, time, tag, scenes, sector"):
        draw_part("moon", rng, 8, make_grid(rng, 8, 24, full_turn=True))


def test_cells_of_an_answer_and_of_the_truth_are_counted_alike():
    grid = {
        "azimuth": [3.0, 1.0, -1.0, -3.0],
        "frames": {
            str(k): {"scene": f"drive_{k:03d}", "time": 5.0 + 10 * k, "tags": ["wet"] * (k > 1)} for k in range(4)
        },
    }
    later = cells({"scenes": [2, 3], "azimuth": None}, grid)
    assert np.array_equal(cells_of({"time_s": [15.0, None]}, grid), later)
    assert np.array_equal(cells_of({"tag": "wet"}, grid), later)
    assert np.array_equal(cells_of({"scenes": ["drive_002", "drive_003"]}, grid), later)
    rear = cells({"scenes": [0, 1, 2, 3], "azimuth": [2.5, 3.8]}, grid)
    assert np.array_equal(cells_of({"azimuth_rad": [2.5, 3.8]}, grid), rear)
    assert rear[0].tolist() == [True, False, False, True]
    assert f1(later, later) == 1
    assert f1(np.full((4, 4), True), later) == pytest.approx(2 / 3)
