import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxsim.frame import Camera, CameraFrame, PolarGrid, PolarImage
from jaxsim.geometry import camera_window, polar_to_points, preset, window_grid
from jaxsim.prepare import paint

SPEC = preset("hdl64e")
SIZE = (44, 152)  # KITTI's crop at an eighth
# The LiDAR 0.27 m behind and 0.08 m above the camera, as on KITTI's car; axes x right, y down, z forward.
CAM_FROM_VELO = np.array([[0, -1, 0, 0.06], [0, 0, -1, -0.08], [1, 0, 0, -0.27], [0, 0, 0, 1]], np.float32)


def camera(size=SIZE):
    f = 721.5 * size[1] / 1216
    intrinsics = np.array([[f, 0, 0.49 * size[1]], [0, f, 0.43 * size[0]], [0, 0, 1]], np.float32)
    return Camera(intrinsics, CAM_FROM_VELO)


def view(depth, size=SIZE, **labels):
    depth = np.broadcast_to(np.asarray(depth, np.float32), (*np.shape(depth)[:-2], *size)).copy()
    number = np.arange(size[0] * size[1]).reshape(size)
    rgb = np.stack([number % 251, number % 241, number % 239], axis=-1).astype(np.uint8)
    valid = np.isfinite(depth)
    return CameraFrame(np.broadcast_to(rgb, (*depth.shape, 3)), camera(size), depth, valid, **labels)


def rays(size=SIZE):
    """Directions of the pixels in `velo` at planar depth 1, and the camera's place."""
    k = camera(size).intrinsics
    v, u = np.mgrid[: size[0], : size[1]].astype(np.float64)
    cam = np.stack([(u - k[0, 2]) / k[0, 0], (v - k[1, 2]) / k[1, 1], np.ones(size)], axis=-1)
    turn = CAM_FROM_VELO[:3, :3].astype(np.float64)
    return cam @ turn, -turn.T @ CAM_FROM_VELO[:3, 3]


def plane(normal, offset, size=SIZE):
    """Depth map of the plane {p: normal . p = offset} in `velo`; NaN where the camera does not see it."""
    direction, origin = rays(size)
    with np.errstate(divide="ignore"):
        depth = (offset - origin @ normal) / (direction @ np.asarray(normal, float))
    return np.where((depth > 0) & (depth < 200), depth, np.nan)


def grid_of(columns=47, size=SIZE, rows=(0, 44)):
    azimuth = camera_window(camera(size), size, SPEC, columns=columns).azimuth_rad.astype(float)
    half = (azimuth[0] - azimuth[1]) / 2
    return window_grid(SPEC, azimuth[0] + half, azimuth[-1] - half, columns=columns, rows=rows)


def cells_of(frame, grid):
    """Row (nearest beam by angle), column, range and distance from the ray in cells of every pixel."""
    direction, origin = rays(frame.depth_m.shape)
    xyz = origin + direction * frame.depth_m[..., None].astype(np.float64)
    x, y, z = xyz[..., 0], xyz[..., 1], xyz[..., 2]
    e, h = (np.asarray(a, np.float64) for a in (grid.elevation_rad, grid.origin_m))
    rho = np.hypot(x, y)
    angle = np.arctan2(z[..., None] - h, rho[..., None]) - e
    row = np.nanargmin(np.where(np.isfinite(angle), np.abs(angle), 9), axis=-1)
    off = np.take_along_axis(angle, row[..., None], axis=-1)[..., 0]
    above, below = (e[0] - e[1]) / 2, (e[-2] - e[-1]) / 2
    row = np.where((row == 0) & (off > above), -1, np.where((row == len(e) - 1) & (off < -below), len(e), row))
    step = float(grid.azimuth_rad[0] - grid.azimuth_rad[-1]) / (len(grid.azimuth_rad) - 1)
    place = (float(grid.azimuth_rad[0]) - np.arctan2(y, x)) / step
    column = np.floor(np.nan_to_num(place, nan=-9) + 0.5).astype(int)
    range_m = np.hypot(rho, z - h[np.clip(row, 0, len(e) - 1)])
    e, h = (np.concatenate([[2 * t[0] - t[1]], t, [2 * t[-1] - t[-2]]]) for t in (e, h))
    neighbour = np.clip(row + 1 - np.sign(np.nan_to_num(off)).astype(int), 0, len(e) - 1)
    gap = np.abs(np.arctan2(z - h[neighbour], rho) - e[neighbour])
    down = np.abs(off) / (np.abs(off) + gap)
    return row, column, range_m, np.hypot(down, place - column)


def oracle(frame, grid, occlusion_m=1.0):
    """One cell after the other, in plain loops: winner (-1 none), nearest, surface, occluded."""
    row, column, range_m, off = cells_of(frame, grid)
    shape = len(grid.elevation_rad), len(grid.azimuth_rad)
    nearest, farthest = np.full(shape, np.inf), np.zeros(shape)
    pixels = [[[] for _ in range(shape[1])] for _ in range(shape[0])]
    for v, u in zip(*np.nonzero(frame.depth_valid), strict=True):
        r, c = row[v, u], column[v, u]
        if 0 <= r < shape[0] and 0 <= c < shape[1]:
            pixels[r][c].append((v, u))
            nearest[r, c] = min(nearest[r, c], range_m[v, u])
            farthest[r, c] = max(farthest[r, c], range_m[v, u])

    def change(of, r, c, dr, dc):
        steps = []
        for sign in (-1, 1):
            rr, cc = r + sign * dr, c + sign * dc
            if 0 <= rr < shape[0] and 0 <= cc < shape[1] and np.isfinite(nearest[rr, cc]):
                steps.append(sign * (of[rr, cc] - of[r, c]))
        if len(steps) == 2:
            return min(map(abs, steps)) if steps[0] * steps[1] > 0 else 0.0
        return abs(steps[0]) if steps else 0.0

    winner, occluded = np.full(shape, -1), np.zeros(shape, bool)
    for r in range(shape[0]):
        for c in range(shape[1]):
            if pixels[r][c]:
                # A plane's inverse range changes evenly: one and a half rows of it end here.
                end = 1 / nearest[r, c] - 1.5 * change(1 / nearest, r, c, 1, 0)
                spanned = 1 / max(end, 1e-3) - nearest[r, c] + 1.5 * change(nearest, r, c, 0, 1)
                allowed = max(occlusion_m, 0.1 * nearest[r, c]) + spanned
                front = [p for p in pixels[r][c] if range_m[p] <= nearest[r, c] + allowed]
                v, u = min(front, key=lambda p: off[p])
                winner[r, c] = v * frame.depth_m.shape[1] + u
                occluded[r, c] = farthest[r, c] - nearest[r, c] > allowed
    return winner, occluded


def numbered(frame):
    """The frame with every pixel's number as its instance, so that a painting tells which pixel won."""
    number = np.arange(frame.depth_m[..., :, :].size // (frame.depth_m.size // (SIZE[0] * SIZE[1])), dtype=np.int32)
    return frame.replace(instance=np.broadcast_to(number.reshape(SIZE), frame.depth_m.shape))


def street(rng):
    """Road, walls and boxes at random, with holes."""
    depth = plane((0, 0, 1), -1.73)
    for normal, offset in (((0, 1, 0), rng.uniform(3, 9)), ((0, -1, 0), rng.uniform(3, 9)), ((1, 0, 0), 60.0)):
        depth = np.fmin(depth, plane(normal, offset))
    for _ in range(6):
        top, left = rng.integers(0, SIZE[0] - 8), rng.integers(0, SIZE[1] - 12)
        box = depth[top : top + rng.integers(2, 30), left : left + rng.integers(1, 30)]
        np.minimum(box, rng.uniform(3, 40), out=box)
    depth[rng.random(SIZE) < 0.02] = np.nan
    return depth


@pytest.mark.parametrize("seed", range(4))
def test_equals_the_slow_obvious_program(seed):
    frame, grid = numbered(view(street(np.random.default_rng(seed)))), grid_of()
    painted = paint(frame, grid)
    winner, occluded = oracle(frame, grid)
    # Pixels on the border of two cells may fall into either.
    assert (np.asarray(painted.valid) != (winner >= 0)).mean() < 0.002
    assert (np.asarray(painted.occluded) != occluded).mean() < 0.002
    assert 0.003 < occluded.mean() < 0.4
    seen = (winner >= 0) & np.asarray(painted.valid)
    row, column, range_m, off = (a.ravel() for a in cells_of(frame, grid))
    picked = np.asarray(painted.instance)
    r, c = np.nonzero(seen)
    pixel = picked[seen]
    assert ((row[pixel] == r) & (column[pixel] == c)).mean() > 0.998
    assert (picked == winner)[seen].mean() > 0.98
    # Where another pixel is picked, it is as near to the ray: the kernel measures height, not angle.
    assert (off[pixel] < off[winner[seen]] + 0.03).mean() > 0.998
    np.testing.assert_allclose(np.asarray(painted.range_m)[seen], range_m[pixel], rtol=1e-5)
    np.testing.assert_array_equal(painted.depth_m, np.where(painted.valid, frame.depth_m.ravel()[picked], 0))
    expected = frame.rgb.reshape(-1, 3)[picked] / np.float32(255) * np.asarray(painted.valid)[..., None]
    np.testing.assert_allclose(painted.rgb, expected, atol=1e-6)


@given(st.integers(0, 2**31), st.integers(2, 60), st.floats(0.1, 5.0))
@settings(max_examples=15, deadline=None)
def test_any_view_paints_pixels_of_their_own_cell(seed, columns, occlusion_m):
    rng = np.random.default_rng(seed)
    frame, grid = numbered(view(street(rng) * rng.uniform(0.2, 2))), grid_of(47)
    painted = paint(frame, grid, occlusion_m=occlusion_m)
    row, column, _, _ = cells_of(frame, grid)
    r, c = np.nonzero(np.asarray(painted.valid))
    pixel = np.asarray(painted.instance)[r, c]
    assert (np.abs(row.ravel()[pixel] - r) <= 1).all()
    assert (row.ravel()[pixel] == r).mean() > 0.995
    assert (column.ravel()[pixel] == c).mean() > 0.995
    assert frame.depth_valid.ravel()[pixel].all()


def test_a_batch_is_painted_as_its_frames_are():
    rng = np.random.default_rng(5)
    depth = np.stack([street(rng) for _ in range(3)])
    grid = grid_of()
    frames = numbered(view(depth))
    cameras = Camera(*(np.broadcast_to(m, (3, *m.shape)) for m in (camera().intrinsics, camera().cam_from_velo)))
    together = paint(frames.replace(camera=cameras), grid)
    for i in range(3):
        alone = paint(numbered(view(depth[i])), grid)
        np.testing.assert_array_equal(together.instance[i], alone.instance)
        np.testing.assert_array_equal(together.occluded[i], alone.occluded)
        np.testing.assert_allclose(together.range_m[i], alone.range_m, rtol=1e-6)


@pytest.mark.parametrize("height", [1.2, 1.73, 2.5])
@pytest.mark.parametrize("tilt", [-0.02, 0.0, 0.05])
def test_a_road_is_never_occluded_and_its_points_lie_on_it(height, tilt):
    size = (352, 1216)
    normal = np.array([tilt, 0, 1]) / np.hypot(tilt, 1)
    frame, grid = view(plane(normal, -height, size), size), grid_of(372, size)
    painted = paint(frame, grid)
    near = np.asarray(painted.valid & (painted.range_m < 60))
    assert near.sum() > 4000
    assert not (painted.occluded & near).any()
    raster = PolarImage(painted.range_m, painted.range_m, painted.valid)
    xyz = np.asarray(polar_to_points(raster, grid).xyz_m).reshape(*near.shape, 3)
    # Half a pixel is 0.04 degrees, 4 cm of height at 60 m; a cell's nearest pixel would float 0.2 m above the road.
    off = np.abs(xyz @ normal + height)[near]
    assert np.median(off) < 0.02
    assert np.percentile(off, 99.9) < 0.06


@pytest.mark.parametrize("yaw_deg", [0, 30, 60, 80])
def test_a_wall_is_never_occluded_however_it_is_turned(yaw_deg):
    size = (352, 1216)
    normal = (np.cos(np.deg2rad(yaw_deg)), np.sin(np.deg2rad(yaw_deg)), 0.0)
    painted = paint(view(plane(normal, 8.0, size), size), grid_of(372, size))
    near = painted.valid & (painted.range_m < 60)
    assert near.sum() > 4000
    assert (painted.occluded & near).mean() < 1e-3


@pytest.mark.parametrize(("rows", "most"), [(16, 0.02), (32, 0.02), (64, 0.0), (128, 0.0)])
def test_a_road_is_no_more_occluded_for_a_sensor_of_few_rows(rows, most):
    size = (352, 1216)
    elevation = np.deg2rad(np.linspace(2, -15, rows)).astype(np.float32)
    grid = grid_of(372, size).replace(elevation_rad=elevation, origin_m=np.zeros(rows, np.float32))
    painted = paint(view(plane((0, 0, 1), -1.73, size), size), grid)
    seen = np.asarray(painted.valid)
    assert seen.sum() > 1000
    assert np.asarray(painted.occluded)[seen].mean() <= most


def test_what_a_pole_hides_from_the_lidar_is_marked():
    size = (352, 1216)
    depth = np.full(size, 30.0)
    depth[:, 600:640] = 5.0
    painted = paint(view(depth, size), grid_of(372, size))
    hit = np.asarray(painted.valid & (painted.range_m < 10))
    columns = np.flatnonzero(hit.any(axis=0))
    assert 10 <= len(columns) <= 16
    # The camera stands 6 cm left of the LiDAR, so it sees wall to the pole's left which the pole hides from the LiDAR.
    marked = np.asarray(painted.occluded)[5:40]
    inner = columns[4:-2]
    assert marked[:, columns[:2]].all()
    assert not marked[:, inner].any()
    assert not marked[:, : columns[0] - 1].any()
    assert not marked[:, columns[-1] + 2 :].any()
    assert np.asarray(painted.valid)[5:40, columns[0]].all()  # marked, not removed


def test_the_nearest_surface_wins_a_cell_and_on_it_the_pixel_at_the_ray():
    size = (352, 1216)
    depth = np.full(size, 20.0)
    depth[::2, ::2] = 10.0
    frame, grid = view(depth, size), grid_of(372, size)
    painted = paint(frame, grid)
    inner = np.s_[5:35, 20:330]
    assert np.asarray(painted.valid)[inner].all()
    assert np.asarray(painted.occluded)[inner].all()
    assert (np.asarray(painted.depth_m)[inner] == 10).all()


def test_pixels_without_depth_are_not_painted_whatever_their_value():
    depth = np.full(SIZE, 12.0)
    depth[:20] = np.nan
    frame = view(depth)
    other = frame.replace(depth_m=np.where(frame.depth_valid, frame.depth_m, 3.0).astype(np.float32))
    for each in (frame, other):
        painted = paint(each, grid_of())
        assert painted.valid.any()
        np.testing.assert_array_equal(painted.range_m > 0, painted.valid)
        assert np.asarray(painted.depth_m)[np.asarray(painted.valid)] == pytest.approx(12.0)


def test_labels_that_the_camera_lacks_are_zero_and_small_integers_are_kept():
    semantic = np.full(SIZE, 26, np.uint8)
    painted = paint(view(np.full(SIZE, 12.0), semantic=semantic), grid_of())
    assert (np.asarray(painted.semantic)[np.asarray(painted.valid)] == 26).all()
    assert not np.asarray(painted.instance).any()


def test_a_view_without_depth_says_so():
    frame = view(np.full(SIZE, 12.0)).replace(depth_m=None, depth_valid=None)
    with pytest.raises(ValueError, match="no depth_m"):
        paint(frame, grid_of())


def test_a_grid_of_one_beam_is_painted_too():
    """As the same beam among others, but for the height of its cells."""
    whole = grid_of()
    one = PolarGrid(whole.azimuth_rad, whole.elevation_rad[20:21], whole.origin_m[20:21])
    tilted = view(10.0 + 0.1 * np.arange(SIZE[0])[:, None])
    among, alone = paint(tilted, whole), paint(tilted, one)
    both = np.asarray(among.valid)[20] & np.asarray(alone.valid)[0]
    assert both.mean() > 0.8
    np.testing.assert_allclose(alone.depth_m[0][both], among.depth_m[20][both], atol=0.15)
