import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxsim.geometry import UnorderedCloud, fit_beams, full_grid, preset, recover_rows, rows_by_elevation, rows_of
from tests.geometry.kitti_scans import COMPENSATED, CROPPED, FULL, OBJECT, RAW, points

SPEC = preset("hdl64e")


def azimuth(xyz):
    return np.arctan2(xyz[:, 1], xyz[:, 0])


def lines_of(spec, azimuth_deg, rho_m):
    """A cloud line by line: (rows, points) azimuths and distances along the ground, and each point's row."""
    a, rho = np.deg2rad(azimuth_deg), rho_m
    z = np.asarray(spec.origin_m)[:, None] + rho * np.tan(spec.elevation_rad)[:, None]
    xyz = np.stack([rho * np.cos(a), rho * np.sin(a), z], axis=-1).reshape(-1, 3)
    return xyz.astype(np.float32), np.repeat(np.arange(spec.rows, dtype=np.int32), a.shape[1])


@pytest.mark.parametrize("scan", FULL)
def test_a_whole_scan_has_64_lines(samples, scan):
    row = recover_rows(points(samples, scan)[:, :3])
    assert row.dtype == np.int32
    assert np.array_equal(np.unique(row), np.arange(64))
    assert set(np.unique(np.diff(row))) == {0, 1}


@pytest.mark.parametrize("scan", OBJECT)
def test_rows_equal_the_published_programs(samples, golden, scan):
    expected = np.load(golden / "rows/rows.npz")[f"row_{scan[-10:-4]}"]
    assert np.array_equal(recover_rows(points(samples, scan)[:, :3]), expected)


def test_the_motion_compensated_scan_goes_backwards_inside_its_lines(samples):
    xyz = points(samples, COMPENSATED)[:, :3]
    row = recover_rows(xyz)
    back = np.diff(azimuth(xyz) % (2 * np.pi)) < 0
    assert (back & (np.diff(row) == 0)).sum() == 952
    # Elevation alone cannot tell the lines there.
    assert (rows_by_elevation(xyz, SPEC) == row).mean() < 0.7


@pytest.mark.parametrize("name", ["ok64", "only60"])
def test_synthetic_clouds_give_the_published_rows(golden, name):
    clouds = np.load(golden / "rows/synthetic.npz")
    assert np.array_equal(recover_rows(clouds[f"{name}_points"][:, :3]), clouds[f"{name}_row"])


@pytest.mark.parametrize("name", ["flicker65", "missing_q4"])
def test_flicker_and_a_missing_quadrant_cost_no_line(golden, name):
    """The published rule finds 65 lines (row -1) and 63; each cloud has 64, of 60 points but for the one cut."""
    clouds = np.load(golden / "rows/synthetic.npz")
    xyz, published = clouds[f"{name}_points"][:, :3], clouds[f"{name}_row"]
    elevation = np.rad2deg(np.arctan2(xyz[:, 2], np.hypot(xyz[:, 0], xyz[:, 1])))
    # The clouds were made with lines at elevations of 2 degrees and down by 0.4.
    truth = np.rint((2.0 - elevation) / 0.4)
    assert np.array_equal(recover_rows(xyz), truth)
    assert not np.array_equal(published, truth)


def test_more_lines_than_the_sensor_has_are_refused(golden):
    xyz = np.load(golden / "rows/synthetic.npz")["extra66_points"][:, :3]
    with pytest.raises(UnorderedCloud, match="66 laser lines found in 3960 points, but the sensor has 64"):
        recover_rows(xyz)
    assert recover_rows(xyz, lines=66).max() == 65


def test_a_cropped_cloud_lies_on_both_sides_of_the_seam(samples):
    xyz = points(samples, CROPPED)[:, :3]
    row = recover_rows(xyz)
    assert np.array_equal(np.unique(row), np.arange(18, 64))
    for line in range(18, 64):
        left = azimuth(xyz[row == line]) >= 0
        assert left.any()
        assert not left.all()
        assert np.count_nonzero(np.diff(left.astype(int))) == 1


def test_a_cropped_cloud_finds_its_beams(samples):
    """Its lines are the sensor's first 46: with the beam table they are told, without they are the last."""
    xyz = points(samples, CROPPED)[:, :3]
    row = recover_rows(xyz, spec=SPEC)
    assert np.array_equal(np.unique(row), np.arange(46))
    assert (row == rows_by_elevation(xyz, SPEC)).mean() > 0.999


@pytest.mark.parametrize("scan", [RAW[0], OBJECT[2], COMPENSATED])
def test_dropped_lines_and_crops_find_their_beams(samples, scan):
    xyz = points(samples, scan)[:, :3]
    truth = recover_rows(xyz)
    rng = np.random.default_rng(0)
    for view in (np.pi, 0.7):
        keep = ~np.isin(truth, rng.choice(64, 12, replace=False)) & (np.abs(azimuth(xyz)) < view)
        assert np.array_equal(recover_rows(xyz[keep], spec=SPEC), truth[keep])


@pytest.mark.parametrize("scan", [RAW[0], OBJECT[1], COMPENSATED])
def test_a_line_that_ends_where_the_next_begins_is_told_by_its_beam(samples, scan):
    """Line 10 keeps its left half and line 11 its right: the azimuth grows on from one to the other."""
    xyz = points(samples, scan)[:, :3]
    truth = recover_rows(xyz)
    ahead = (np.abs(azimuth(xyz)) < 0.7) & (truth < 46)
    keep = ahead & ~((truth == 10) & (azimuth(xyz) < 0.05)) & ~((truth == 11) & (azimuth(xyz) > -0.05))
    assert np.array_equal(recover_rows(xyz[keep], spec=SPEC), truth[keep])
    assert len(np.unique(recover_rows(xyz[keep]))) == 45


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_rows_survive_lost_points_and_lost_lines(seed):
    rng = np.random.default_rng(seed)
    turn = np.sort(rng.uniform(0, 360, (64, 90)), axis=1)
    xyz, truth = lines_of(SPEC, turn, rng.uniform(3, 60, (64, 90)))
    keep = rng.uniform(size=len(xyz)) < rng.uniform(0.4, 1)
    keep &= ~np.isin(truth, rng.choice(64, 10, replace=False))
    assert np.array_equal(recover_rows(xyz[keep], spec=SPEC), truth[keep])


def test_flicker_belongs_to_the_line_whose_elevation_it_has():
    """One point of line 30 lies across the seam, once at its start and once at its end."""
    turn = np.tile(np.arange(0.1, 360, 1.0), (64, 1))
    early, late = turn.copy(), turn.copy()
    early[30, 2] = 359.95
    late[30, -2] = 0.02
    for shifted in (early, late):
        xyz, truth = lines_of(SPEC, shifted, np.full(turn.shape, 20.0))
        assert np.array_equal(recover_rows(xyz), truth)


@pytest.mark.parametrize("n", [None, 2000, 40])
def test_a_shuffled_cloud_is_refused(samples, n):
    xyz = points(samples, OBJECT[0])[:, :3]
    with pytest.raises(UnorderedCloud, match="laser line"):
        recover_rows(np.random.default_rng(1).permutation(xyz)[:n])


def test_a_cloud_in_the_order_of_time_is_refused(samples):
    xyz = points(samples, OBJECT[0])[:, :3]
    with pytest.raises(UnorderedCloud, match="in the order of time"):
        recover_rows(xyz[np.argsort(azimuth(xyz) % (2 * np.pi), kind="stable")])


def test_a_cloud_from_the_bottom_up_is_refused():
    xyz, truth = lines_of(SPEC, np.tile(np.arange(0.1, 360, 2.0), (64, 1)), np.full((64, 180), 20.0))
    with pytest.raises(UnorderedCloud, match="top line first"):
        recover_rows(xyz[np.argsort(-truth, kind="stable")])


def test_lines_of_another_sensor_are_refused():
    low = dataclasses.replace(preset("vlp16"), elevation_deg=tuple(e - 35 for e in preset("vlp16").elevation_deg))
    xyz, truth = lines_of(low, np.tile(np.arange(0.1, 360, 2.0), (16, 1)), np.full((16, 180), 20.0))
    with pytest.raises(UnorderedCloud, match="beams off those of vlp16"):
        recover_rows(xyz[truth > 2], 16, spec=preset("vlp16"))


def test_points_that_are_not_finite_are_refused():
    with pytest.raises(ValueError, match="1 of 3 points are not finite"):
        recover_rows(np.array([[1, 0, 0], [1, np.nan, 0], [1, 2, 0]], np.float32))


def test_lines_must_be_those_of_the_sensor():
    with pytest.raises(ValueError, match="lines is 32, but hdl64e has 64"):
        recover_rows(np.ones((1, 3), np.float32), 32, spec=SPEC)


def test_an_empty_cloud_has_no_rows():
    assert recover_rows(np.zeros((0, 3), np.float32)).shape == (0,)


def test_the_nearest_beam_is_seen_from_its_own_origin():
    rng = np.random.default_rng(3)
    xyz, truth = lines_of(SPEC, rng.uniform(0, 360, (64, 50)), rng.uniform(2, 80, (64, 50)))
    assert np.array_equal(rows_by_elevation(xyz, SPEC), truth)
    single = dataclasses.replace(SPEC, origin_m=(0.0,) * 64)
    assert (rows_by_elevation(xyz, single) == truth).mean() < 0.5


def test_beams_fitted_to_one_frame_tell_the_rows_of_another(samples):
    """Measured: 99.998 % or more for every pair of the nine uncompensated scans; the rest lie at the seam."""
    scans = [points(samples, scan)[:, :3] for scan in (OBJECT[0], RAW[5], OBJECT[1])]
    rows = [recover_rows(xyz) for xyz in scans]
    fitted = fit_beams(scans[0], rows[0], name="000000")
    assert fitted.name == "000000"
    assert fitted.columns == SPEC.columns
    grid = full_grid(fitted)
    for xyz, row in zip(scans[1:], rows[1:], strict=True):
        assert (np.asarray(rows_of(xyz, grid)) == row).mean() > 0.9999
    # What is left is the file's grid of 1 mm: a uniform error of half of it, 0.25 mm in the mean.
    rho = np.hypot(scans[0][:, 0], scans[0][:, 1])
    miss = scans[0][:, 2] - np.asarray(fitted.origin_m)[rows[0]] - rho * np.tan(fitted.elevation_rad)[rows[0]]
    assert np.abs(miss).mean() < 0.3e-3


def test_a_fit_gets_a_made_up_table_back_in_spite_of_strays():
    rng = np.random.default_rng(4)
    table = dataclasses.replace(
        SPEC,
        elevation_deg=tuple(e + d for e, d in zip(SPEC.elevation_deg, rng.uniform(-0.05, 0.05, 64), strict=True)),
        origin_m=tuple(h + 0.01 for h in SPEC.origin_m),
    )
    xyz, row = lines_of(table, rng.uniform(0, 360, (64, 300)), rng.uniform(3, 60, (64, 300)))
    xyz = np.round(xyz, 3)
    strays = rng.choice(len(xyz), 200, replace=False)
    xyz[strays, 2] += 0.5
    fitted = fit_beams(xyz, row)
    assert fitted.elevation_deg == pytest.approx(table.elevation_deg, abs=2e-3)
    assert fitted.origin_m == pytest.approx(table.origin_m, abs=1e-3)


def test_a_beam_with_few_points_keeps_the_presets_value():
    rng = np.random.default_rng(5)
    xyz, row = lines_of(SPEC, rng.uniform(0, 360, (64, 60)), rng.uniform(3, 60, (64, 60)))
    keep = (row != 7) | (np.cumsum(row == 7) <= 5)
    xyz[row == 7, 2] += 0.3
    fitted = fit_beams(xyz[keep], row[keep])
    assert fitted.elevation_deg[7] == SPEC.elevation_deg[7]
    assert fitted.origin_m[7] == SPEC.origin_m[7]


def test_a_compensated_scan_is_no_place_to_fit_beams(samples):
    xyz = points(samples, COMPENSATED)[:, :3]
    with pytest.raises(ValueError, match="motion was taken out"):
        fit_beams(xyz, recover_rows(xyz))


def test_a_fit_needs_a_prior_of_as_many_lines():
    xyz, row = np.ones((3, 3), np.float32), np.zeros(3, np.int32)
    with pytest.raises(ValueError, match="no preset with 40 lines"):
        fit_beams(xyz, row, 40)
    with pytest.raises(ValueError, match=r"rows are 0\.\.64"):
        fit_beams(xyz, np.array([0, 1, 64], np.int32))


def reordered(xyz, row):
    """The cloud as other programs write it: name -> positions. Each keeps its lines together, from the top."""
    angle = azimuth(xyz)
    turn = angle % (2 * np.pi)
    keys = {
        "clockwise": -turn,
        "from atan2's seam": angle,
        "clockwise from it": -angle,
        "from the rear": (turn + np.pi) % (2 * np.pi),
    }
    return {name: np.lexsort((key, row)) for name, key in keys.items()}


@pytest.mark.parametrize("cropped", [False, True])
@pytest.mark.parametrize("scan", [RAW[0], OBJECT[1], COMPENSATED])
def test_other_orders_get_the_right_lines_or_are_refused(samples, scan, cropped):
    xyz = points(samples, scan)[:, :3]
    truth = recover_rows(xyz, spec=SPEC)
    ahead = np.abs(azimuth(xyz)) < np.deg2rad(42)
    answered = 0
    for name, order in reordered(xyz, truth).items():
        order = order[ahead[order]] if cropped else order
        try:
            row = recover_rows(xyz[order], spec=SPEC)
        except UnorderedCloud:
            continue
        answered += 1
        assert (row == truth[order]).mean() > 0.999, name
    assert answered == 0 or scan != COMPENSATED  # where motion was taken out, what is not known is refused


@pytest.mark.parametrize("scan", [RAW[0], COMPENSATED])
def test_a_mirrored_scan_gets_the_right_lines_or_is_refused(samples, scan):
    xyz = points(samples, scan)[:, :3]
    truth = recover_rows(xyz, spec=SPEC)
    try:
        row = recover_rows(xyz * np.array([1, -1, 1], np.float32), spec=SPEC)
    except UnorderedCloud:
        return
    assert scan != COMPENSATED
    assert (row == truth).mean() > 0.999


def test_top_lines_that_lack_on_a_full_circle_cost_no_other_line(samples):
    xyz = points(samples, RAW[0])[:, :3]
    truth = recover_rows(xyz, spec=SPEC)
    kept = truth >= 6
    np.testing.assert_array_equal(recover_rows(xyz[kept], spec=SPEC), truth[kept])


def test_a_compensated_scan_of_another_sensors_beams_is_refused(samples):
    xyz = points(samples, COMPENSATED)[:, :3]
    low = dataclasses.replace(SPEC, elevation_deg=tuple(e - 3 for e in SPEC.elevation_deg))
    with pytest.raises(UnorderedCloud, match="lie two beams of hdl64e or more from the laser line"):
        recover_rows(xyz, spec=low)
