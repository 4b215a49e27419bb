from dataclasses import replace

import numpy as np
import pytest

from jaxsim.config import PenetConfig, PrepareConfig
from jaxsim.data import KittiObject, KittiRaw
from jaxsim.frame import Camera, CameraFrame, Cloud, Frame, Pair, PolarImage
from jaxsim.geometry import polar_to_points, preset, window_grid
from jaxsim.prepare import crop_image, denoise, polar_window, prepare_frame
from jaxsim.prepare.denoise.lidia import Variant, from_published, published_shapes, save_lidia
from jaxsim.prepare.depth.penet import save_penet
from jaxsim.prepare.depth.penet.training import create_state
from tests.prepare.lidia_oracle import random_state

SPEC = preset("hdl64e")
CONFIG = PrepareConfig(inputs=("rgb", "depth", "semantic", "edges", "row"), image_crop=(88, 304), columns=93)
SIZE = (94, 310)


def frame():
    """A wall 12 m ahead and a road, seen by a quarter-size camera and a LiDAR in the same place."""
    f = 721.5 / 4
    cam_from_velo = np.array([[0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1]], np.float32)
    camera = Camera(np.array([[f, 0, 152.4], [0, f, 43.2], [0, 0, 1]], np.float32), cam_from_velo)
    v = np.arange(SIZE[0], dtype=np.float32)[:, None] - 43.2
    depth = np.minimum(12.0, np.where(v > 0, 1.73 * f / np.maximum(v, 1e-3), 12.0)) * np.ones(SIZE)
    rgb = np.broadcast_to(np.array([40, 80, 120], np.uint8), (*SIZE, 3)).copy()
    semantic = np.where(depth < 12, 7, 11).astype(np.int32)
    view = CameraFrame(rgb, camera, depth.astype(np.float32), np.ones(SIZE, bool), semantic, 0 * semantic)

    grid = window_grid(SPEC, 1.2, -1.2, columns=900)
    elevation, azimuth = grid.elevation_rad[:, None], grid.azimuth_rad[None]
    wall = 12 / (np.cos(azimuth) * np.cos(elevation))
    down = (-1.73 - grid.origin_m[:, None]) / np.sin(np.minimum(elevation, -1e-4)) + 0 * azimuth
    r = np.minimum(wall, np.where(elevation < 0, down, 1e9)).astype(np.float32)
    line = np.arange(64)[:, None] / 100 + 0 * azimuth
    points = polar_to_points(PolarImage(r, line.astype(np.float32), np.ones(r.shape, bool)), grid)
    cloud = Cloud(*(np.asarray(a) for a in (points.xyz_m, points.intensity, points.valid, points.row)))
    return Frame(name="street-7", scene="street", camera=view, cloud=cloud)


@pytest.mark.long
def test_a_trained_penet_s_depth_is_what_is_painted(tmp_path):
    save_penet(tmp_path / "weights.npz", create_state(PenetConfig(width=2, start_m=10.0), seed=0).values)
    given = replace(CONFIG, image_crop=(64, 288), columns=88)
    learned = replace(given, depth="penet", depth_weights=tmp_path / "weights.npz")
    (pair, grid), (rendered, same) = (prepare_frame(frame(), SPEC, config) for config in (learned, given))
    np.testing.assert_array_equal(grid.azimuth_rad, same.azimuth_rad)
    assert pair.painted.valid.any()
    both = pair.painted.valid & rendered.painted.valid
    # Near the sweep's points even an untrained network keeps what they say; elsewhere its depth is its own.
    assert (np.abs(pair.painted.range_m - rendered.painted.range_m)[both] > 0.1).mean() > 0.25
    np.testing.assert_array_equal(pair.target, rendered.target)  # what was measured is what it was


def test_camera_and_lidar_agree_and_every_line_keeps_its_row():
    pair, grid = prepare_frame(frame(), SPEC, CONFIG)
    rows, columns = pair.target.shape
    assert (rows, columns) == (len(grid.elevation_rad), 93)
    painted, measured = pair.painted, pair.measured
    both = painted.valid & measured.valid
    assert both.mean() > 0.95
    off = np.abs(painted.range_m - measured.range_m)[both & ~painted.occluded]
    assert np.median(off) < 0.05
    assert np.percentile(off, 99) < 1.0
    first = int(np.argmin(np.abs(SPEC.elevation_rad - grid.elevation_rad[0])))
    line = first + np.arange(rows)
    np.testing.assert_allclose(pair.row_share, (line / 63)[:, None] * np.ones(columns), atol=1e-6)
    np.testing.assert_allclose(pair.target[both], (line / 100)[:, None].repeat(columns, 1)[both], atol=1e-6)
    assert set(np.unique(painted.semantic[painted.valid])) == {7, 11}
    wall = painted.valid & (painted.semantic == 11)
    assert np.median(pair.incidence_rad[wall]) < 0.5
    assert all(isinstance(leaf, np.ndarray) for leaf in (pair.target, painted.rgb, grid.azimuth_rad))


def test_a_window_of_a_single_beam_has_a_place_for_it():
    one = replace(SPEC, elevation_deg=(-3.0,), origin_m=(0.0,))
    grid, row_share = polar_window(frame().camera.camera, SIZE, one, config=CONFIG)
    assert len(grid.elevation_rad) == 1
    np.testing.assert_array_equal(row_share, [0.0])


def test_cells_without_return_have_no_target():
    one = frame()
    valid = one.cloud.valid & (np.arange(len(one.cloud.valid)) % 900 < 450)
    pair, _ = prepare_frame(replace(one, cloud=one.cloud.replace(valid=valid)), SPEC, CONFIG)
    assert not pair.measured.valid[:, 60:].any()
    assert not pair.target[:, 60:].any()
    assert pair.measured.valid[:, :30].all()


def test_the_denoiser_changes_the_target_and_not_the_measurement():
    rng = np.random.default_rng(0)
    one = frame()
    noise = np.clip(one.cloud.intensity + rng.normal(0, 0.05, one.cloud.intensity.shape), 0, 0.99).astype(np.float32)
    noisy = replace(one, cloud=one.cloud.replace(intensity=noise))
    plain, _ = prepare_frame(noisy, SPEC, CONFIG)
    smooth, _ = prepare_frame(noisy, SPEC, replace(CONFIG, denoise="non_local_means"))
    np.testing.assert_array_equal(plain.measured.intensity, smooth.measured.intensity)
    np.testing.assert_array_equal(plain.target, plain.measured.intensity)
    assert np.abs(np.diff(smooth.target, axis=1)).mean() < 0.7 * np.abs(np.diff(plain.target, axis=1)).mean()


@pytest.fixture
def lidia(tmp_path):
    """Settings with a network of small random weights."""
    state = random_state(published_shapes(Variant(small=True)), seed=0)
    save_lidia(tmp_path / "lidia.npz", from_published(state)[1])
    return replace(CONFIG, denoise="lidia", denoise_weights=tmp_path / "lidia.npz")


def test_a_target_by_lidia_is_the_measurement_denoised(lidia):
    one = frame()
    column = np.arange(len(one.cloud.valid)) % 900
    kept = one.cloud.valid & ((column < 400) | (column > 480))
    one = replace(one, cloud=replace(one.cloud, valid=kept))
    # Not the defaults: they are passed on.
    pair, _ = prepare_frame(one, SPEC, replace(lidia, denoise_statistics="stored", denoise_gain=0.5))
    intensity, valid = pair.measured.intensity, pair.measured.valid
    expected = denoise(intensity, valid, "lidia", weights=lidia.denoise_weights, statistics="stored", gain=0.5)
    np.testing.assert_array_equal(pair.target, expected)
    assert not valid.all()
    assert len(np.unique(pair.target[valid])) > 100
    assert np.abs(pair.target - intensity)[valid].mean() > 0.01
    default = denoise(intensity, valid, "lidia", weights=lidia.denoise_weights, statistics="stored")
    assert np.abs(pair.target - default)[valid].mean() > 0.01


def test_a_scan_of_which_nothing_came_back_is_named(lidia):
    lost = replace(frame(), cloud=replace(frame().cloud, valid=np.zeros_like(frame().cloud.valid)))
    with pytest.raises(ValueError, match=r"street-7: only 0 of the window's 93 columns got a point"):
        prepare_frame(lost, SPEC, lidia)
    with pytest.raises(ValueError, match="street-7: depth: not one pixel has depth"):
        prepare_frame(lost, SPEC, replace(CONFIG, depth="ip_basic"))


def test_a_crop_moves_the_camera_with_the_image():
    one = frame().camera
    cut = crop_image(one, (88, 304))
    np.testing.assert_array_equal(cut.rgb, one.rgb[6:, 3:307])
    np.testing.assert_array_equal(cut.depth_m, one.depth_m[6:, 3:307])
    shift = one.camera.intrinsics - cut.camera.intrinsics
    np.testing.assert_allclose(shift, [[0, 0, 3], [0, 0, 6], [0, 0, 0]], atol=1e-5)
    whole = crop_image(one, SIZE)
    np.testing.assert_array_equal(whole.camera.intrinsics, one.camera.intrinsics)


def _without(one, **fields):
    return replace(one, camera=one.camera.replace(**fields))


def test_what_the_frame_lacks_is_named():
    one = frame()
    no_rows = replace(one, cloud=one.cloud.replace(row=None))
    nth = np.arange(len(one.cloud.valid))
    sparse = replace(one, cloud=one.cloud.replace(valid=one.cloud.valid & (nth % 10 == 0)))
    scattered = replace(one, cloud=one.cloud.replace(valid=one.cloud.valid & (nth % 30 == 0)))
    behind = replace(one, cloud=one.cloud.replace(xyz_m=-one.cloud.xyz_m))
    swapped = replace(one, cloud=one.cloud.replace(xyz_m=one.cloud.xyz_m.astype(">f4")))
    bytes_of = replace(one, cloud=one.cloud.replace(intensity=np.round(255 * one.cloud.intensity).astype(np.uint8)))
    for broken, config, message in [
        (no_rows, CONFIG, "street-7: the cloud has no laser lines"),
        (_without(one, depth_m=None, depth_valid=None), CONFIG, r"street-7: .*no depth; .*--prepare\.depth ip_basic"),
        (_without(one, semantic=None), CONFIG, "semantic and edges need class labels.*--prepare.inputs rgb depth row"),
        (_without(one, semantic=None), replace(CONFIG, depth="penet"), "class labels"),  # nor weights: labels first
        (_without(one, semantic=None), replace(CONFIG, inputs=("edges",)), "--prepare.inputs rgb depth row"),
        (one, replace(CONFIG, image_crop=(352, 1216)), "310 x 94, smaller than the crop of 1216 x 352"),
        (sparse, CONFIG, r"columns, all over it, got no point: .*lower --prepare\.columns to about"),
        (scattered, CONFIG, r"columns got a point: .*check the calibration \(R and T"),
        (behind, CONFIG, r"only 0 of the window's 93 columns got a point: .*check the calibration"),
        (swapped, CONFIG, r"street-7: the cloud's xyz_m holds >f4, bytes in the order of another machine"),
        (bytes_of, CONFIG, r"street-7: the cloud's intensity spans 0\.\.161; it must lie in 0\.\.1: divide by"),
        (behind, replace(CONFIG, depth="ip_basic"), "street-7: depth: not one pixel has depth"),
    ]:
        with pytest.raises(ValueError, match=message):
            prepare_frame(broken, SPEC, config)


def test_labels_are_not_needed_where_no_input_asks_for_them():
    pair, _ = prepare_frame(
        _without(frame(), semantic=None, instance=None), SPEC, replace(CONFIG, inputs=("rgb", "row"))
    )
    assert not pair.painted.semantic.any()


@pytest.fixture(scope="module", params=["ip_basic", "ip_basic_fast"])
def real(request, samples):
    config = PrepareConfig(inputs=("rgb", "depth", "row"), depth=request.param)
    raw, single = KittiRaw(samples / "kitti_raw"), KittiObject(samples / "kitti_object")
    frames = [(raw[0], raw.spec), (raw[5], raw.spec), (single[1], single.spec)]
    return [prepare_frame(one, spec, config) for one, spec in frames]


def test_real_frames_give_the_papers_window(real):
    for pair, grid in real:
        assert isinstance(pair, Pair)
        assert pair.target.shape == (44, 372)
        assert pair.row_share[0, 0] == 0
        assert len(grid.elevation_rad) == 44
    np.testing.assert_array_equal(real[0][1].azimuth_rad, real[1][1].azimuth_rad)


def test_painted_and_measured_range_agree_on_real_frames(real):
    for pair, _ in real:
        painted, measured = pair.painted, pair.measured
        both = painted.valid & measured.valid & ~painted.occluded

        def off(shift, painted=painted, measured=measured, both=both):
            seen = both & np.roll(painted.valid, shift, (0, 1))
            return np.median(np.abs(np.roll(painted.range_m, shift, (0, 1)) - measured.range_m)[seen])

        assert both.mean() > 0.6
        assert off((0, 0)) < 0.03
        # One line or one column off would show.
        assert min(off(shift) for shift in ((1, 0), (-1, 0), (0, 1), (0, -1))) > 1.5 * off((0, 0))


def test_measured_intensity_is_in_hundredths_and_some_cells_are_occluded(real):
    for pair, _ in real:
        values = pair.measured.intensity[pair.measured.valid]
        np.testing.assert_allclose(values * 100, np.round(values * 100), atol=1e-4)
        assert 0.005 < pair.painted.occluded.mean() < 0.15
        np.testing.assert_array_equal(pair.target, np.where(pair.measured.valid, pair.measured.intensity, 0))


def test_a_lost_sector_is_no_reason_to_stop():
    one = frame()
    column = np.arange(len(one.cloud.valid)) % 900
    lost = one.cloud.valid & ((column < 400) | (column > 480))
    pair, _ = prepare_frame(replace(one, cloud=one.cloud.replace(valid=lost)), SPEC, CONFIG)
    assert not pair.measured.valid.any(axis=0).all()
