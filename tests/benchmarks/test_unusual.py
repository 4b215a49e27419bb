"""The benchmark of folders out of the ordinary: what is done to their frames, and what counts as right."""

import json

import numpy as np
import pytest

from benchmarks.blind import unusual
from benchmarks.blind.unusual import KINDS, make


def frame():
    """A pole 5 m away before a wall at 20 m, sky above."""
    r = np.full((6, 40), 20.0)
    r[0] = 0
    r[2:, 18:21] = 5.0
    return {"range": r, "intensity": np.where(r > 0, 0.3, 0)}


@pytest.mark.parametrize("kind", ["edge_angle", "edge_kernel"])
def test_edges_lose_returns_and_nothing_else_does(kind):
    simulated = frame()
    lost = np.zeros((6, 40))
    for seed in range(200):
        measured = frame()
        KINDS[kind].edit(measured, simulated, np.random.default_rng(seed))
        lost += (measured["range"] == 0) & (simulated["range"] > 0)
        assert ((measured["range"] > 0) == (measured["intensity"] > 0)).all()
    assert lost[3, 18] / 200 == pytest.approx(0.6, abs=0.15)
    assert not lost[3, 5:12].any()
    # The border of the image is no edge, nor is the other end of a column.
    assert not lost[-1, 5:12].any()


def test_photons_fall_with_the_power_that_is_said():
    measured = {"range": np.array([[1.0, 8.0, 16.0]]), "intensity": np.full((1, 3), 0.5)}
    KINDS["photons"].edit(measured, measured, np.random.default_rng(0))
    near, at, far = measured["intensity"][0]
    assert far / at == pytest.approx(2**-2.9, rel=0.01)
    assert near < 0.6 * at


@pytest.mark.parametrize(("kind", "gone"), [("drop_bare", "semantic"), ("unrelated", ""), ("no_speed", "speed")])
def test_a_case_is_two_folders_without_what_is_not_given(tmp_path, monkeypatch, kind, gone):
    small = unusual.make_case
    monkeypatch.setattr(unusual, "make_case", lambda at, **kw: small(at, **kw, scenes=3, rows=8, columns=64))
    make(KINDS[kind], tmp_path / "case", "ideal", 7)
    with np.load(tmp_path / "case" / "simulated" / "0000.npz") as simulated:
        assert gone not in simulated.files
    with np.load(tmp_path / "case" / "measured" / "0000.npz") as measured:
        assert measured["range"].dtype == np.float32
        assert ((measured["range"] > 0) >= (measured["intensity"] > 0)).all()
    facts = json.loads((tmp_path / "case" / "measured" / "grid.json").read_text())["frames"]["0000"]
    assert gone not in facts


def test_missing_noise_is_right_where_its_level_is():
    def verdict(value, *names):
        level = {"name": "range_noise", "missing": {"value": value, "low": value}}
        return {"levels": [level], "effects": [{"name": name} for name in names]}

    right = KINDS["noise_4cm"].right
    assert right(verdict(0.041))
    assert right(verdict(0.041, "range_noise"))
    assert not right(verdict(0.02))
    assert not right(verdict(0.041, "range_walk"))


def test_sealed_seeds_are_refused(tmp_path):
    with pytest.raises(SystemExit):
        unusual.main([str(tmp_path), "--seed", "10000"])
