import jax
import jax.numpy as jnp
import numpy as np

from jaxsim.discover.model.noise_levels import Levels
from jaxsim.discover.model.smooth import Smoothing, smooth_frames
from tests.discover.noisy_street import scan

RANGE_SD_M = 0.02


def smoothed(noise, frames=2):
    frames_, truth = scan(noise, frames)
    levels = Levels(
        range_m=noise.get("range_m", 0.0),
        intensity=noise.get("constant", 0.0),
        intensity_share=noise.get("share", 0.0),
        follows_cosine=True,
    )
    smooth = smooth_frames(frames_, Smoothing.of(frames_, levels))
    return frames_, jax.tree.map(np.asarray, smooth), {k: np.stack([t[k] for t in truth]) for k in truth[0]}


def test_planes_halve_the_noise_of_ranges_without_bias():
    _, smooth, truth = smoothed({"range_m": RANGE_SD_M})
    there = smooth.trusted & truth["hit"]
    moved = there & (smooth.range_leverage < 1)
    assert moved.sum() > 0.6 * truth["hit"].sum()
    error = (smooth.range_m - truth["range"])[moved]
    assert np.abs(np.median(error)) < 1e-3
    assert np.median(np.abs(error)) / 0.6745 < RANGE_SD_M / 2
    for kind in (7, 11):
        assert np.abs(np.mean(error[truth["semantic"][moved] == kind])) < 2e-3


def test_rows_of_uneven_steps_leave_level_ground_where_it_is():
    # Beams of a real sensor lie by errors of its making; the lowest have neighbours to one side alone.
    frames_, _ = scan(None, 1)
    rows, columns = frames_.range_m.shape[1:]
    elevation = np.linspace(np.deg2rad(-4), np.deg2rad(-24), rows) + np.deg2rad(0.15) * (-1) ** np.arange(rows)
    ground = np.broadcast_to((1.73 / np.sin(-elevation))[None, :, None], (1, rows, columns))
    level = frames_.replace(
        grid=frames_.grid.replace(elevation_rad=jnp.asarray(elevation, jnp.float32)),
        range_m=jnp.asarray(ground, jnp.float32),
        intensity=jnp.full((1, rows, columns), 0.2),
        incidence_rad=jnp.asarray(np.pi / 2 + np.broadcast_to(elevation[:, None], ground.shape), jnp.float32),
        semantic=jnp.full((1, rows, columns), 7),
        instance=jnp.zeros((1, rows, columns), jnp.int32),
        hit=jnp.ones((1, rows, columns), bool),
    )
    how = Smoothing(jnp.float32(0.015), jnp.zeros(2, jnp.float32), jnp.float32(0), half=4, by_cosine=False)
    smooth = jax.tree.map(np.asarray, smooth_frames(level, how))
    assert (smooth.range_leverage < 1).mean() > 0.95
    np.testing.assert_allclose(smooth.range_m, ground, rtol=5e-5)
    np.testing.assert_allclose(smooth.plane_rad, np.asarray(level.incidence_rad), atol=1e-3)


def test_the_leverage_is_the_variance_that_is_left():
    _, smooth, truth = smoothed({"range_m": RANGE_SD_M}, frames=4)
    moved = smooth.trusted & truth["hit"] & (smooth.range_leverage < 1)
    claimed = RANGE_SD_M * np.sqrt(smooth.range_leverage[moved])
    z = (smooth.range_m - truth["range"])[moved] / claimed
    assert 0.7 < np.median(np.abs(z)) / 0.6745 < 1.3


def test_planes_tell_the_incidence_better_than_a_degree():
    _, smooth, truth = smoothed({"range_m": RANGE_SD_M})
    moved = smooth.trusted & truth["hit"] & (smooth.range_leverage < 1) & (truth["range"] < 30)
    error = (smooth.plane_rad - truth["incidence"])[moved]
    assert np.median(np.abs(error)) < np.deg2rad(1.5)


def test_albedo_is_that_of_the_surface_and_detail_what_is_over_it():
    frames_, smooth, truth = smoothed({"share": 0.1})
    there = smooth.trusted & truth["hit"] & (truth["semantic"] == 7) & (truth["incidence"] < np.deg2rad(80))
    albedo = smooth.albedo[there]
    assert abs(np.mean(albedo) - 0.15) < 0.003
    assert np.std(albedo) < 0.05 * 0.15
    shine = np.asarray(frames_.intensity)[there] / np.cos(np.asarray(frames_.incidence_rad)[there])
    np.testing.assert_allclose(smooth.detail[there], np.clip(shine / albedo - 1, -1, 1), atol=2e-3)


def test_a_ray_alone_is_not_trusted_and_stays():
    frames_, _ = scan({"range_m": RANGE_SD_M}, 1)
    lone = np.zeros(frames_.hit.shape, bool)
    lone[0, ::6, ::40] = True
    frames_ = frames_.replace(hit=frames_.hit & lone)
    how = Smoothing(jnp.float32(RANGE_SD_M), jnp.zeros(2, jnp.float32), jnp.float32(0), half=4, by_cosine=True)
    smooth = smooth_frames(frames_, how)
    assert not np.asarray(smooth.trusted).any()
    np.testing.assert_array_equal(np.asarray(smooth.range_m)[lone], np.asarray(frames_.range_m)[lone])


def test_panes_behind_a_wall_are_not_mixed_with_it_where_no_class_tells_them():
    # A wall straight ahead at 12 m with dark panes 10 cm behind it: within 1 % of the range.
    rng = np.random.default_rng(5)
    frames_, _ = scan(None, 1)
    shape = frames_.range_m.shape
    azimuth, elevation = np.asarray(frames_.grid.azimuth_rad), np.asarray(frames_.grid.elevation_rad)
    ahead = np.abs(azimuth) < np.deg2rad(60)
    slant = np.cos(elevation)[:, None] * np.where(ahead, np.cos(azimuth), 1.0)
    row, column = np.indices(shape[1:])
    pane = ((row // 5) % 2 == 1) & ((column // 6) % 2 == 1)
    true = np.where(ahead, (12.0 + 0.1 * pane) / slant, 0)[None]
    errors = []
    for _ in range(8):
        noisy = np.where(true > 0, true + RANGE_SD_M * rng.normal(size=shape), 0)
        shine = np.where(pane, 0.05, 0.3)[None] * (1 + 0.05 * rng.normal(size=shape))
        bare = frames_.replace(
            range_m=jnp.asarray(noisy, jnp.float32),
            intensity=jnp.asarray(shine, jnp.float32),
            hit=jnp.asarray(true > 0),
            semantic=jnp.zeros(shape, jnp.int32),
            instance=jnp.zeros(shape, jnp.int32),
        )
        sd = jnp.array([0.0, 0.05], jnp.float32)
        smooth = smooth_frames(bare, Smoothing(jnp.float32(RANGE_SD_M), sd, jnp.float32(0), half=10, by_cosine=False))
        moved = (np.asarray(smooth.range_leverage) < 1) & (true > 0)
        errors.append(np.where(moved, np.asarray(smooth.range_m) - true, np.nan))
    error = np.stack(errors)
    assert np.isfinite(error).mean() > 0.3 * (true > 0).mean()
    for part in (pane, ~pane):
        assert abs(np.nanmean(error[:, 0, part])) < 1e-3


def test_two_walls_that_meet_at_a_corner_keep_their_angles():
    # One along the road, 6 m to the left and seen at up to 79 degrees, ends at one across it, 30 m ahead. At the corner
    # their ranges are alike; a mean of both angles would make the grazing one several times too bright.
    rng = np.random.default_rng(6)
    frames_, _ = scan(None, 1)
    shape = frames_.range_m.shape
    azimuth, elevation = np.asarray(frames_.grid.azimuth_rad, float), np.asarray(frames_.grid.elevation_rad, float)
    ahead = np.abs(azimuth) < np.deg2rad(60)
    with np.errstate(divide="ignore"):
        along = np.where(azimuth > 0, 6.0 / np.sin(np.maximum(azimuth, 1e-9)), np.inf)
    across = 30.0 / np.maximum(np.cos(azimuth), 0.1)
    flat, up = np.cos(elevation)[:, None], np.abs(np.sin(elevation))[:, None]
    slant = np.where(along < across, np.abs(np.sin(azimuth)), np.cos(azimuth)) * flat
    true_m = np.where(ahead & (up * np.minimum(along, across) < 5), np.minimum(along, across) / flat, 0)[None]
    true_rad = np.where(true_m > 0, np.arccos(np.clip(slant, 0, 1))[None], 0)
    noisy = frames_.replace(
        range_m=jnp.asarray(np.where(true_m > 0, true_m + RANGE_SD_M * rng.normal(size=shape), 0), jnp.float32),
        incidence_rad=jnp.asarray(np.where(true_m > 0, true_rad + 0.03 * rng.normal(size=shape), 0), jnp.float32),
        intensity=jnp.asarray(0.3 * np.cos(true_rad), jnp.float32),
        hit=jnp.asarray(true_m > 0),
        semantic=jnp.full(shape, 11),
        instance=jnp.full(shape, 1),
    )
    levels = Levels(range_m=RANGE_SD_M, incidence_rad=0.03, follows_cosine=True)
    smooth = jax.tree.map(np.asarray, smooth_frames(noisy, Smoothing.of(noisy, levels)))
    corner = (true_m > 0) & (np.abs(azimuth - np.arctan2(6, 30)) < np.deg2rad(4))
    assert corner.sum() > 100
    for angle in (smooth.incidence_rad, smooth.plane_rad):
        assert np.quantile(np.abs(angle - true_rad)[corner], 0.98) < 0.12
