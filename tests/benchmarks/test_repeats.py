"""The benchmarks of what repeats and of learned laws: their laws, their notes of hidden ones, their tables."""

import numpy as np
import pytest

from benchmarks.blind import learned, repeats
from benchmarks.blind.hidden.outside import OUTSIDE
from benchmarks.blind.plan import Job
from jaxsim.data.polar_frames import frame_names
from jaxsim.discover import read_comparison
from jaxsim.effects import all_rays
from jaxsim.effects.learned import Learned
from tests.effects.streets import clutter_of_everything

LAWS = (
    Learned("intensity", "wave", ("row", "column"), ((0.25,), (0.1,)), (0.3, -0.2), (0.0, 0.0)),
    Learned("intensity", "table", ("row",), ((1.0, 3.0),), (0.2, -0.1), (0.0, 0.0)),
    Learned("intensity", "table", ("even rows", "even columns"), ((0.0, 1.0),) * 2, (0.1, 0.2, 0.3, 0.4), (0.0,) * 4),
    Learned("intensity", "table", ("row", "column"), ((2.0,), (1.0, 5.0)), (0.2, -0.1), (0.0, 0.0)),
)


@pytest.mark.parametrize("law", LAWS, ids=lambda law: " ".join((law.kind, *law.covariates)))
def test_a_law_on_the_grid_is_what_it_does_to_rays(law):
    rays = all_rays(clutter_of_everything())
    change = np.asarray(law.apply(rays).log_intensity - rays.log_intensity)
    hit = np.asarray(rays.hit)
    shape = change.shape[-2:]
    wanted = np.broadcast_to(repeats.law_on_grid(law, shape), change.shape)
    np.testing.assert_allclose(change[hit], wanted[hit], atol=1e-4)


@pytest.mark.parametrize("name", ["ripple", "parity", "columns", "aslant", "cells"])
def test_every_pattern_is_one_of_sensor_coordinates_of_some_size(name):
    row, column = np.mgrid[:48, :384]
    pattern = repeats.PATTERNS[name](row, column)
    assert pattern.shape == (48, 384)
    assert 0.02 < pattern.std() < 0.2


def test_the_table_counts_answers_and_p_values():
    row = {"simulator": "ideal", "nuisance": "exact", "pattern": "", "code": "c", "p": 0.01, "answered": True}
    one = {"channel": "range", "scale": "row", "along": "row", "size": [0.004, 0.003, 0.005]}
    rows = [row | {"key": "a", "repeats": [one]}, row | {"key": "b", "repeats": [], "p": 0.3, "answered": False}]
    found = {"answered": True, "share": 0.98, "slope": 1.01, "learned": [one], "pattern": "ripple", "repeats": [one]}
    text = repeats.summary([*rows, row | {"key": "c"} | found])
    assert "| ideal | exact | 2 | 50 % (1 of 2;" in text
    assert "| 0.50 | 0.50 | 1.00 | range 0.0040 |" in text
    assert "| ideal | ripple | yes | 0.98 | 1.01 | row row 0.004 (0.003 to 0.005) |" in text


def test_what_the_hidden_law_did_is_noted_and_leaves_the_case_as_it_is(tmp_path):
    job = Job("outside:azimuth_periodic_range_bias", 4.0, "exact", 0)
    kind = OUTSIDE["azimuth_periodic_range_bias"]
    noted = learned.make_noted(tmp_path / "case", job, 5, scenes=10, rows=8, columns=24)
    assert OUTSIDE["azimuth_periodic_range_bias"] is kind
    assert noted.shape == (10, 8, 24)
    compared = read_comparison(tmp_path / "case" / "simulated", tmp_path / "case" / "measured")
    assert len(frame_names(tmp_path / "case" / "measured")) == 10
    law = learned.truth_law(noted, "range", compared.scan)
    rays = all_rays(compared.scan)
    off = np.asarray(compared.measured.range_m) - np.asarray(law.apply({}, rays).reading_m)
    plain = np.asarray(compared.measured.range_m) - np.asarray(rays.reading_m)
    both = np.asarray(rays.hit) & np.asarray(compared.measured.valid) & (np.abs(plain) < 1)
    assert np.abs(off[both]).mean() < 0.5 * np.abs(plain[both]).mean()


def test_shares_of_the_hidden_gain_are_counted():
    row = {"kind": "hue_gain", "code": "c", "learned": ["learned intensity along hue angle"], "truth": 10.0}
    text = learned.summary([row | {"key": "a", "gained": 8.5}, row | {"key": "b", "gained": 1.0, "learned": []}])
    assert "1 of 2 reach 80 %" in text
    assert "| hue_gain | intensity along hue angle | 8.5 | 10.0 | 85 % |" in text
    assert "| hue_gain | nothing | 1.0 | 10.0 | 10 % |" in text
