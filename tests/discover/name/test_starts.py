"""Starts read off readings that were made to show them."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.discover.model.null import fit_null
from jaxsim.discover.name.starts import starts_of
from tests.discover.toy import toy


@pytest.fixture(scope="module")
def problem(evidence, scan):
    problem, _ = fit_null(scan, evidence, np.ones(6, np.float32))
    return problem


@pytest.fixture(scope="module")
def scan():
    return toy()[0]


def changed(problem, **fields):
    return replace(problem, ev=problem.ev.replace(**{k: jnp.asarray(v) for k, v in fields.items()}))


def test_nothing_to_read(problem):
    assert starts_of(problem) == {}


def test_a_ceiling_is_where_readings_pile_up(problem):
    ev = problem.ev
    top = float(np.quantile(np.asarray(ev.log_intensity)[np.asarray(ev.returned)], 0.95))
    found = starts_of(changed(problem, log_intensity=np.minimum(ev.log_intensity, top)))
    assert found["saturation"][0]["ceiling"] == pytest.approx(np.exp(top), rel=1e-4)


def test_a_gate_is_the_nearest_return(problem):
    ev = problem.ev
    near = np.asarray(ev.rays.range_m) < 7.0
    assert (near & np.asarray(ev.rays.hit)).sum() >= 5
    found = starts_of(changed(problem, returned=np.asarray(ev.returned) & ~near))
    assert 6.5 <= found["range_gate"][0]["minimum_m"] < 8.0
    assert all("maximum_m" not in start for start in found["range_gate"])


def test_a_hidden_sector_is_where_all_frames_lose(problem):
    ev = problem.ev
    azimuth = np.asarray(ev.rays.azimuth_rad)
    found = starts_of(changed(problem, returned=np.asarray(ev.returned) & (np.abs(azimuth - 0.8) > 0.3)))
    widths = [start["width_rad"] for start in found["sector_occlusion"]]
    assert found["sector_occlusion"][0]["azimuth_rad"] == pytest.approx(0.8, abs=0.15)
    assert min(widths) < 0.6 < max(widths)
