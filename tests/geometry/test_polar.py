from dataclasses import replace

import jax
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxsim.frame import Cloud, Painted, PolarGrid, PolarImage
from jaxsim.geometry import (
    azimuth_of,
    camera_window,
    column_of,
    directions,
    full_grid,
    pad_cloud,
    pad_points,
    points_to_polar,
    polar_to_points,
    preset,
    recover_rows,
    resample,
    room_for,
    rows_by_elevation,
    rows_of,
    scan_on_window,
    scatter_nearest,
    spans_turn,
    window_grid,
    with_neighbours,
)
from jaxsim.geometry.polar import exact_column
from tests.effects.streets import grid_of
from tests.geometry.kitti_scans import CROP, OBJECT, RAW, cropped_camera, points

SPEC = preset("hdl64e")
WINDOW = window_grid(SPEC, 0.6, -0.5, columns=32, rows=(10, 18))
GRIDS = {
    "turn": full_grid(preset("vlp16"), 48),
    "window": WINDOW,
    "rear": window_grid(SPEC, np.pi + 0.4, np.pi - 0.4, columns=16, rows=(0, 8)),
}


@pytest.mark.parametrize(("turn_rad", "closes"), [(2 * np.pi, True), (np.pi, False), (2 * np.pi - 0.2, False)])
def test_a_grid_spans_the_turn_where_its_last_column_is_followed_by_the_first(turn_rad, closes):
    assert bool(spans_turn(grid_of(turn_rad))) == closes


def test_azimuths_that_were_rounded_span_the_turn_all_the_same():
    grid = grid_of(columns=512)
    # To a tenth of a degree, of steps of 0.7.
    rounded = np.deg2rad(np.round(np.rad2deg(grid.azimuth_rad), 1)).astype(np.float32)
    assert bool(spans_turn(grid.replace(azimuth_rad=rounded)))


def cloud_of(xyz, row, intensity=None, valid=None):
    n = xyz.shape[:-1]
    intensity = np.zeros(n, np.float32) if intensity is None else intensity
    return Cloud(xyz, intensity, np.ones(n, bool) if valid is None else valid, row)


def random_cloud(rng, n, rows):
    """Points in the grid's rows and out of them, some on the same spot, some invalid or not finite."""
    xyz = rng.uniform(-20, 20, (n, 3)).astype(np.float32)
    xyz[n // 2 : n // 2 + 8] = xyz[:8]
    xyz[rng.integers(0, n, 3)] = [[np.nan, 1, 1], [1, np.inf, 1], [0, 0, 0]]
    row = rng.integers(-1, rows + 1, n).astype(np.int32)
    row[n // 2 : n // 2 + 8] = row[:8]
    return cloud_of(xyz, row, rng.uniform(size=n).astype(np.float32), rng.uniform(size=n) > 0.1)


def polar_oracle(cloud, grid):
    """Slow and plain: one point after the other, in float64. Also which points lie on no cell's border."""
    azimuth = np.asarray(grid.azimuth_rad, np.float64)
    step = (azimuth[0] - azimuth[-1]) / (len(azimuth) - 1)
    shape = (len(grid.elevation_rad), len(azimuth))
    nearest, winner = np.full(shape, np.inf), np.zeros(shape, int)
    clear = np.ones(len(cloud.xyz_m), bool)
    for i, (point, row) in enumerate(zip(np.asarray(cloud.xyz_m, np.float64), cloud.row, strict=True)):
        if not (cloud.valid[i] and np.isfinite(point).all() and point.any() and 0 <= row < shape[0]):
            continue
        turns = (azimuth[0] + step / 2 - np.arctan2(point[1], point[0])) % (2 * np.pi) / step
        column = int(turns)
        clear[i] = abs(turns - round(turns)) > 1e-3 and abs(turns - 2 * np.pi / step) > 1e-3
        distance = np.linalg.norm(point - [0, 0, grid.origin_m[row]])
        if column < shape[1] and distance < nearest[row, column]:
            nearest[row, column], winner[row, column] = distance, i
    return nearest, winner, clear


@pytest.mark.parametrize("name", GRIDS)
@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_the_raster_equals_one_point_after_the_other(name, seed):
    grid = GRIDS[name]
    cloud = random_cloud(np.random.default_rng(seed), 400, len(grid.elevation_rad))
    *_, clear = polar_oracle(cloud, grid)
    cloud = cloud.replace(valid=cloud.valid & clear)
    nearest, expected, _ = polar_oracle(cloud, grid)
    image, winner = points_to_polar(cloud, grid)
    valid = np.isfinite(nearest)
    assert np.array_equal(image.valid, valid)
    assert np.asarray(image.range_m)[valid] == pytest.approx(nearest[valid], rel=1e-6)
    # Points on the same spot: the first wins. Points equally far to float32 may swap, at random they do not occur.
    assert np.array_equal(np.asarray(winner)[valid], expected[valid])
    assert np.array_equal(np.asarray(image.intensity)[valid], cloud.intensity[expected[valid]])
    assert not np.asarray(image.range_m)[~valid].any()
    assert not np.asarray(winner)[~valid].any()


def test_nearest_point_wins_a_cell():
    ray = np.asarray(directions(WINDOW))[3, 5]
    xyz = (np.array([30.0, 10.0, 20.0])[:, None] * ray + [0, 0, WINDOW.origin_m[3]]).astype(np.float32)
    image, winner = points_to_polar(cloud_of(xyz, np.full(3, 3, np.int32)), WINDOW)
    assert np.argwhere(image.valid).tolist() == [[3, 5]]
    assert winner[3, 5] == 1
    assert image.range_m[3, 5] == pytest.approx(10.0, rel=1e-6)


def test_point_0_can_win():
    xyz = np.array([[10, 0, 0]], np.float32)
    image, winner = points_to_polar(cloud_of(xyz, np.zeros(1, np.int32)), WINDOW)
    assert image.valid.sum() == 1
    assert np.asarray(winner)[image.valid].tolist() == [0]


def test_of_equally_near_points_the_first_wins():
    rng = np.random.default_rng(0)
    range_m = rng.integers(1, 4, 5000).astype(np.float32)
    row, column = (rng.integers(0, size, 5000).astype(np.int32) for size in (6, 7))
    winner, valid = scatter_nearest(range_m, row, column, inside=np.ones(5000, bool), shape=(6, 7))
    assert valid.all()
    for r, c in np.ndindex(6, 7):
        here = np.flatnonzero((row == r) & (column == c))
        assert winner[r, c] == here[np.argmin(range_m[here])]


def test_points_outside_are_left_out():
    row = np.array([-1, 0, 2, 0, 0, 1], np.int32)
    column = np.array([0, -1, 0, 3, 1, 2], np.int32)
    inside = np.array([True, True, True, True, False, True])
    winner, valid = scatter_nearest(np.ones(6, np.float32), row, column, inside=inside, shape=(2, 3))
    assert np.argwhere(valid).tolist() == [[1, 2]]
    assert winner[1, 2] == 5


@pytest.mark.parametrize("lead", [(2,), (2, 3)])
def test_a_batch_is_its_frames(lead):
    rng = np.random.default_rng(1)
    frames = [random_cloud(rng, 300, 8) for _ in range(int(np.prod(lead)))]
    batch = jax.tree.map(lambda *leaves: np.stack(leaves).reshape(*lead, *leaves[0].shape), *frames)
    images = points_to_polar(batch, WINDOW)
    back = polar_to_points(images[0], WINDOW)
    assert images[1].shape == (*lead, 8, 32)
    for i, frame in zip(np.ndindex(lead), frames, strict=True):
        one = points_to_polar(frame, WINDOW)
        for whole, part in zip(jax.tree.leaves(images), jax.tree.leaves(one), strict=True):
            assert np.array_equal(whole[i], part)
        for whole, part in zip(jax.tree.leaves(back), jax.tree.leaves(polar_to_points(one[0], WINDOW)), strict=True):
            assert np.array_equal(whole[i], part)


def test_an_empty_cloud_gives_an_empty_raster():
    image, _ = points_to_polar(cloud_of(np.zeros((0, 3), np.float32), np.zeros(0, np.int32)), WINDOW)
    assert image.valid.shape == (8, 32)
    assert not image.valid.any()


def test_a_cloud_without_rows_is_refused():
    with pytest.raises(ValueError, match=r"set cloud\.row"):
        points_to_polar(cloud_of(np.ones((1, 3), np.float32), None), WINDOW)


@pytest.mark.parametrize("angle", [np.pi, -np.pi, np.nextafter(np.float32(np.pi), 0), -3.1415925, 0.0])
@pytest.mark.parametrize("columns", [2048, 2007, 900, 360])
def test_no_azimuth_falls_out_of_a_whole_turn(angle, columns):
    """Of some numbers of columns float32 rounds the cut to the last one, of others to before the first."""
    grid = full_grid(SPEC, columns)
    xyz = np.array([[np.cos(angle), np.sin(angle), 0]], np.float32) * 10
    image, _ = points_to_polar(cloud_of(xyz, np.zeros(1, np.int32)), grid)
    assert image.valid.sum() == 1


def test_columns_count_from_cell_centres_and_wrap():
    grid = full_grid(SPEC, 360)
    deg = np.deg2rad(np.array([179.5, 0.5, -0.5, -179.5, 180.5, 0.0], np.float32))
    assert column_of(deg, grid) == pytest.approx([0, 179, 180, 359, 359, 179.5], abs=1e-3)
    assert column_of(np.float32(0.6), WINDOW) == pytest.approx(-0.5, abs=1e-4)
    assert column_of(np.float32(-0.5), WINDOW) == pytest.approx(31.5, abs=1e-4)
    rear = GRIDS["rear"]
    assert column_of(np.float32(np.pi - 0.1), rear) == pytest.approx(9.5, abs=1e-4)
    assert column_of(np.float32(-np.pi + 0.1), rear) == pytest.approx(5.5, abs=1e-4)


def test_columns_of_host_arrays_keep_their_precision():
    fine = replace(WINDOW, azimuth_rad=np.asarray(WINDOW.azimuth_rad, np.float64))
    azimuth = np.linspace(-4, 4, 99)
    column = exact_column(azimuth, fine)
    assert column.dtype == np.float64
    np.testing.assert_allclose(column, column_of(azimuth.astype(np.float32), WINDOW), atol=1e-3)


def test_the_fast_azimuth_is_the_arctangent():
    rng = np.random.default_rng(2)
    xy = rng.normal(size=(2, 200_000)) * 10 ** rng.uniform(-6, 6, 200_000)
    xy[:, :8] = [[1, 1, 0, -1, -1, -1, 0, 1], [0, 1, 1, 1, 0, -1, -1, -1]]
    x, y = xy.astype(np.float32)
    truth = np.arctan2(y.astype(np.float64), x.astype(np.float64))
    assert np.abs(azimuth_of(x, y) - truth).max() < 3e-7
    assert azimuth_of(np.float32(0), np.float32(0)) == 0


@pytest.mark.parametrize("scan", OBJECT)
def test_the_raster_of_a_scan_equals_the_published_programs(samples, golden, scan):
    """Row by file order, column by azimuth, nearest wins; a few points on a border of cells may differ."""
    data, name = points(samples, scan), scan[-10:-4]
    rows = np.load(golden / "rows/rows.npz")
    cloud = cloud_of(data[:, :3], rows[f"row_{name}"].astype(np.int32))
    filled = {"000000": (106_536, 55_831), "000001": (111_803, 57_832), "000002": (117_337, 60_630)}[name]
    for columns, expected in zip((2048, 1024), filled, strict=True):
        image, winner = points_to_polar(cloud, full_grid(SPEC, columns))
        assert abs(int(image.valid.sum()) - expected) <= 5
    if name == "000002":
        published = rows["winner_index_unfold1024_000002"]
        assert (np.where(image.valid, winner, -1) != published).sum() <= 5
        azimuth = azimuth_of(data[:, 0], data[:, 1])
        column = np.floor(np.asarray(column_of(azimuth, full_grid(SPEC, 2048))) + 0.5)
        assert (column % 2048 != rows["col2048_000002"]).sum() <= 6


@pytest.mark.parametrize("scan", [RAW[0], RAW[5], *OBJECT])
def test_the_camera_window_leaves_no_sampling_gaps(samples, scan):
    """Where two successive points of a line lie a step apart or less, the cell between them is filled.

    372 columns: 99.85-99.94 % of such cells; 456, the sensor's own step, would leave 2.5 % empty.
    """
    data = points(samples, scan)
    row = recover_rows(data[:, :3])
    window = camera_window(cropped_camera(samples, scan), CROP, SPEC, columns=372)
    image, _ = points_to_polar(cloud_of(data[:, :3], row), window)
    azimuth = np.arctan2(data[:, 1], data[:, 0])
    covered = np.zeros(image.valid.shape, bool)
    for line in range(len(covered)):
        along = np.sort(azimuth[row == line])
        right = np.clip(np.searchsorted(along, window.azimuth_rad), 1, len(along) - 1)
        between = (window.azimuth_rad > along[0]) & (window.azimuth_rad < along[-1])
        covered[line] = between & (along[right] - along[right - 1] < np.deg2rad(1.5 * 0.1794))
    assert covered.mean() > 0.7
    assert np.asarray(image.valid)[covered].mean() > 0.998


@pytest.mark.parametrize("name", GRIDS)
@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_points_go_back_to_their_cells(name, seed):
    grid, rng = GRIDS[name], np.random.default_rng(seed)
    shape = (len(grid.elevation_rad), len(grid.azimuth_rad))
    image = PolarImage(
        rng.uniform(0.5, 120, shape).astype(np.float32),
        rng.uniform(size=shape).astype(np.float32),
        rng.uniform(size=shape) > 0.3,
    )
    cloud = polar_to_points(image, grid)
    again, winner = points_to_polar(cloud, grid)
    valid = image.valid
    assert np.array_equal(again.valid, valid)
    assert np.asarray(again.range_m)[valid] == pytest.approx(image.range_m[valid], rel=1e-6)
    assert np.array_equal(np.asarray(again.intensity)[valid], image.intensity[valid])
    assert np.array_equal(np.asarray(winner)[valid], np.arange(valid.size).reshape(shape)[valid])


def test_points_lie_on_their_beams():
    rng = np.random.default_rng(6)
    range_m = rng.uniform(1, 100, (8, 32)).astype(np.float32)
    image = PolarImage(range_m, range_m / 100, range_m > 20)
    e, a = (np.asarray(x, np.float64) for x in (WINDOW.elevation_rad[:, None], WINDOW.azimuth_rad))
    x, y = range_m * np.cos(e) * np.cos(a), range_m * np.cos(e) * np.sin(a)
    z = WINDOW.origin_m[:, None] + range_m * np.sin(e) + 0 * a
    for rays in (None, directions(WINDOW)):
        cloud = polar_to_points(image, WINDOW, rays=rays)
        assert cloud.xyz_m == pytest.approx(np.stack([x, y, z], -1).reshape(-1, 3), abs=2e-5)
        assert np.array_equal(cloud.row, np.repeat(np.arange(8), 32))
        assert np.array_equal(cloud.valid, image.valid.ravel())
        assert np.array_equal(cloud.intensity, image.intensity.ravel())
    assert np.linalg.norm(directions(WINDOW), axis=-1) == pytest.approx(1.0, abs=1e-6)


def test_range_has_the_gradient_of_the_winning_point():
    xyz = np.array([[10, 1, 0], [20, 2, 0], [0, 0, 0]], np.float32)
    cloud = cloud_of(xyz, np.zeros(3, np.int32), valid=np.array([True, True, False]))
    grid = PolarGrid(WINDOW.azimuth_rad, WINDOW.elevation_rad, np.zeros(8, np.float32))
    slope = jax.grad(lambda xyz: points_to_polar(cloud.replace(xyz_m=xyz), grid)[0].range_m.sum())(xyz)
    assert slope[0] == pytest.approx(xyz[0] / np.linalg.norm(xyz[0]), abs=1e-6)
    assert not slope[1:].any()


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_the_counted_beam_is_the_nearest(seed):
    rng = np.random.default_rng(seed)
    xyz = (rng.uniform(-1, 1, (2, 200, 3)) * [60, 60, 12]).astype(np.float32)
    for spec in (SPEC, preset("vlp16")):
        row = np.asarray(rows_of(xyz, full_grid(spec)))
        for got, frame in zip(row, xyz, strict=True):
            elevation = np.arctan2(frame[:, 2:] - np.asarray(spec.origin_m), np.hypot(*frame[:, :2].T)[:, None])
            off = np.abs(elevation - spec.elevation_rad)
            best = off.min(axis=1)
            assert np.take_along_axis(off, got[:, None], 1)[:, 0] == pytest.approx(best, abs=1e-6)
            assert (got == rows_by_elevation(frame, spec)).mean() > 0.98


@pytest.mark.parametrize(("top_deg", "bottom_deg"), [(89.65, 0.35), (10, -89.9)])
def test_beams_of_a_dome_are_counted_up_to_the_zenith(top_deg, bottom_deg):
    elevation = np.deg2rad(np.linspace(top_deg, bottom_deg, 41)).astype(np.float32)
    dome = PolarGrid(WINDOW.azimuth_rad, elevation, np.zeros(41, np.float32))
    away = np.full((41, len(WINDOW.azimuth_rad)), 10, np.float32)
    cloud = polar_to_points(PolarImage(away, 0 * away, away > 0), dome)
    for grid, before in ((dome, 0), (with_neighbours(dome), 1)):
        np.testing.assert_array_equal(rows_of(cloud.xyz_m, grid) - before, cloud.row)


def test_rasters_of_different_sizes_are_refused():
    with pytest.raises(ValueError, match="must share their shape"):
        resample((np.zeros((4, 5)), np.zeros((5, 4))), (2, 2))
    with pytest.raises(ValueError, match="must share their shape"):
        resample(np.zeros(4), (2, 2))


@settings(max_examples=60, deadline=None)
@given(st.tuples(*[st.integers(1, 40)] * 2), st.tuples(*[st.integers(0, 40)] * 2))
def test_enlarging_and_going_back_is_nothing(size, more):
    image = np.arange(size[0] * size[1]).reshape(size)
    large = resample(image, (size[0] + more[0], size[1] + more[1]))
    assert np.array_equal(resample(large, size), image)


@settings(max_examples=30, deadline=None)
@given(st.integers(1, 40), st.integers(1, 40))
def test_a_new_cell_takes_the_old_cell_of_its_centre(old, new):
    got = resample(np.arange(old)[None], (1, new))[0]
    centre = (np.arange(new) + 0.5) / new * old
    assert np.array_equal(got, np.floor(centre + 1e-9))


def test_every_leaf_is_resampled():
    shape = (2, 6, 8)
    ones = np.ones(shape)
    painted = Painted(ones, ones, np.ones((*shape, 3)), ones, ones, ones > 0, ones > 0)
    out = resample(painted, (3, 16))
    assert out.rgb.shape == (2, 3, 16, 3)
    assert {leaf.shape[:3] for leaf in jax.tree.leaves(out)} == {(2, 3, 16)}
    assert jax.jit(lambda tree: resample(tree, (3, 16)))(painted).range_m.shape == (2, 3, 16)


def test_a_cloud_is_filled_up_with_invalid_points():
    cloud = Cloud(np.ones((3, 3), np.float32), np.ones(3, np.float32), np.ones(3, bool))
    padded = pad_cloud(cloud, 4)
    assert padded.xyz_m.shape == (4, 3)
    assert padded.valid.tolist() == [True, True, True, False]
    assert padded.row is None
    assert pad_cloud(padded, 4).valid.shape == (4,)


def test_points_are_filled_up_to_a_room_that_is_never_empty():
    assert [room_for(n, 4) for n in (0, 1, 4, 5)] == [4, 4, 4, 8]
    padded, real = pad_points(np.ones((3, 2), np.float32), room_for(3, 4))
    np.testing.assert_array_equal(padded, [[1, 1], [1, 1], [1, 1], [0, 0]])
    assert real.tolist() == [True, True, True, False]


def test_a_scan_on_a_window_is_that_part_of_the_whole_scan():
    rng = np.random.default_rng(3)
    xyz = (rng.uniform(-1, 1, (4000, 3)) * [40, 20, 3]).astype(np.float32)
    row = rows_by_elevation(xyz, SPEC)
    shifted = cloud_of(xyz, row - 10)
    expected, _ = points_to_polar(shifted, WINDOW)
    place = (np.arange(10, 18) / (SPEC.rows - 1)).astype(np.float32)
    got = scan_on_window(cloud_of(xyz, row), WINDOW, place, lines=SPEC.rows)
    assert expected.valid.any()
    for ours, theirs in zip(jax.tree.leaves(got), jax.tree.leaves(expected), strict=True):
        np.testing.assert_array_equal(ours, theirs)
