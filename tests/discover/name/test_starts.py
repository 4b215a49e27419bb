"""Starts and borders that are read off the measurement."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.discover.model.null_model import fit_null
from jaxsim.discover.name.starts import sector_between, starts_of
from tests.discover.toy import toy


@pytest.fixture(scope="module")
def problem(evidence, scan):
    problem = fit_null(scan, evidence)
    return problem


@pytest.fixture(scope="module")
def scan():
    return toy()[0]


def changed(problem, **fields):
    return replace(problem, ev=problem.ev.replace(**{k: jnp.asarray(v) for k, v in fields.items()}))


def without(problem, hidden):
    """The problem with all echoes lost from cells of which `hidden` says so, by azimuth and elevation (r n)."""
    grid = problem.scan.grid
    at = np.broadcast_arrays(np.asarray(grid.azimuth_rad)[None], np.asarray(grid.elevation_rad)[:, None])
    hits, lost = np.asarray(problem.ev.cell_hits), np.asarray(problem.ev.cell_lost)
    return changed(problem, cell_lost=np.where(hidden(*at), hits, lost).astype(np.int32))


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


def test_a_wave_along_the_range_has_the_length_and_the_phase_that_errors_have(problem):
    ev = problem.ev
    turns = 0.55 * np.asarray(ev.rays.range_m)
    read = np.asarray(ev.range_m) + 0.03 * np.sin(2 * np.pi * turns) - 0.02 * np.cos(2 * np.pi * turns)
    start = starts_of(changed(problem, range_m=read.astype(np.float32)))["cyclic_range_error"][0]
    # A quarter of a turn at most from the nearest to the farthest ray.
    reach = np.ptp(np.asarray(ev.rays.range_m)[np.asarray(ev.smooth)])
    assert start["cycles_per_m"] == pytest.approx(0.55, abs=float(0.25 / reach))
    assert np.hypot(start["sine_m"], start["cosine_m"]) == pytest.approx(np.hypot(0.03, 0.02), rel=0.3)


def test_ranges_that_are_the_same_on_both_sides_have_no_wave(problem):
    assert "cyclic_range_error" not in starts_of(changed(problem, range_m=problem.ev.rays.reading_m))


def test_a_hidden_sector_is_where_all_frames_lose(problem):
    found = starts_of(without(problem, lambda azimuth, elevation: np.abs(azimuth - 0.8) <= 0.3))
    widths = [start["width_rad"] for start in found["sector_occlusion"]]
    assert found["sector_occlusion"][0]["azimuth_rad"] == pytest.approx(0.8, abs=0.15)
    assert min(widths) < 0.6 < max(widths)


def test_a_hidden_sector_ends_where_rows_above_it_return(problem):
    rows = np.sort(np.asarray(problem.scan.grid.elevation_rad))

    def hidden(azimuth, elevation):
        return (np.abs(azimuth - 0.8) <= 0.3) & (elevation < rows[len(rows) // 2])

    found = starts_of(without(problem, hidden))["sector_occlusion"]
    low = [start for start in found if "below_rad" in start]
    assert low
    assert low[0]["azimuth_rad"] == pytest.approx(0.8, abs=0.15)
    assert low[0]["below_rad"] == pytest.approx(rows[len(rows) // 2 - 1 : len(rows) // 2 + 1].mean(), abs=1e-5)


@pytest.mark.parametrize("after", [5, 14])
def test_a_hidden_sector_behind_the_car_is_one(problem, after):
    """The columns about 5 and 6 fifteenths of the turn, or on both sides of the seam."""
    step = 2 * np.pi / 15
    middle = np.pi - (after + 0.5) * step
    columns = np.asarray(problem.scan.grid.azimuth_rad)
    ended = starts_of(without(problem, lambda azimuth, _: np.abs(np.angle(np.exp(1j * (azimuth - middle)))) <= 0.3))
    hidden = (np.abs(np.angle(np.exp(1j * (columns - middle)))) <= 0.3).sum()
    start = ended["sector_occlusion"][0]
    assert -np.pi <= start["azimuth_rad"] <= np.pi
    assert abs(np.angle(np.exp(1j * (start["azimuth_rad"] - middle)))) < 0.03
    assert start["width_rad"] == pytest.approx(hidden * 2 * np.pi / len(columns), abs=0.01)


def test_a_sector_is_known_to_the_cells_beside_its_borders(problem):
    """Its values lie anywhere between the last cell that is hidden and the first that is not."""
    azimuth = np.asarray(problem.scan.grid.azimuth_rad)
    rows = np.unique(np.asarray(problem.scan.grid.elevation_rad)[(np.asarray(problem.ev.cell_hits) > 0).any(1)])
    low = float(rows[8:10].mean())
    lost = without(problem, lambda azimuth, elevation: (np.abs(azimuth - 0.8) <= 0.3) & (elevation < low))
    values = {"azimuth_rad": 0.82, "width_rad": 0.58, "below_rad": low}
    between = sector_between(lost, values)
    columns = np.unique(azimuth)
    inside = columns[np.abs(columns - 0.8) <= 0.3]
    outside = columns[columns < inside[0]].max(), columns[columns > inside[-1]].min()
    assert between["below_rad"] == pytest.approx((rows[8], rows[9]), abs=1e-6)
    assert between["width_rad"] == pytest.approx((inside[-1] - inside[0], outside[1] - outside[0]), abs=1e-5)
    middles = (inside[0] + outside[1]) / 2, (outside[0] + inside[-1]) / 2
    assert between["azimuth_rad"] == pytest.approx((min(middles), max(middles)), abs=1e-5)
    everywhere = without(problem, lambda azimuth, _: np.abs(azimuth - 0.8) <= 0.3)
    assert sector_between(everywhere, values | {"below_rad": np.pi / 2})["below_rad"][1] == pytest.approx(np.pi / 2)


def test_a_hidden_sector_of_a_window_across_the_cut_is_one(problem):
    """Azimuths of a window need not lie within -pi and pi."""
    grid = problem.scan.grid
    within = np.abs(np.asarray(grid.azimuth_rad)) < 2.0
    hidden = without(problem, lambda azimuth, _: np.abs(azimuth - 0.8) <= 0.3).ev
    evidence = hidden.replace(cell_hits=hidden.cell_hits[:, within], cell_lost=hidden.cell_lost[:, within])
    window = grid.replace(azimuth_rad=grid.azimuth_rad[within] - np.pi)
    behind = replace(problem, ev=evidence, scan=problem.scan.replace(grid=window))
    start = starts_of(behind)["sector_occlusion"][0]
    assert abs(np.angle(np.exp(1j * (start["azimuth_rad"] - (0.8 - np.pi))))) < 0.15
    assert start["width_rad"] == pytest.approx(0.6, abs=0.3)
