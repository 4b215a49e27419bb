"""Lists of candidates must never lack a solid that a ray of the tile meets."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.data.synthetic import kitti_camera
from jaxsim.data.synthetic.layout import Drive, lay_out
from jaxsim.data.synthetic.raycast import cast_solids
from jaxsim.data.synthetic.solids import Solids, in_world, poses_at
from jaxsim.data.synthetic.tiles import in_raster, pinhole_mask, polar_mask, slanted_mask, solids_by_tile
from jaxsim.geometry import directions, full_grid, preset

TILE = (16, 16)
CAST = jax.jit(cast_solids, static_argnames="tile")
EYE = np.array([0.0, -1.8, 1.7])


@pytest.fixture(scope="module", params=[0, 3])
def scene(request: pytest.FixtureRequest) -> tuple[Drive, Solids, np.ndarray]:
    drive = lay_out(9, request.param)
    pose = poses_at(drive.things, float(drive.street.curvature), 0.0)
    solids, corners = in_world(drive.parts, *pose, instance=np.ones(len(drive.things), np.int64))
    return drive, solids, corners


def everything_agrees(
    scene: tuple, origin: np.ndarray, direction: np.ndarray, mask: np.ndarray, *, share: float = 0.3
) -> None:
    drive, solids, _ = scene
    rays = [tuple(jnp.asarray(rays, jnp.float32)) for rays in (origin, direction)]
    counts = drive.parts.counts
    listed, full = (solids_by_tile(m, counts) for m in (mask, np.ones_like(mask)))
    few, all_ = (CAST(solids, *rays, candidates=c, tile=TILE) for c in (listed, full))
    for one, other in zip(few, all_, strict=True):
        np.testing.assert_array_equal(one, other)
    assert np.mean(np.asarray(all_[1]) >= 0) > 0.05
    assert listed.counts.sum() <= share * full.counts.sum()


def test_camera_tiles_lack_nothing(scene: tuple) -> None:
    h, w = 94, 310
    k = kitti_camera((h, w)).intrinsics
    u, v = np.meshgrid(np.arange(w), np.arange(h))
    # cam looks along x of the world: x right, y down, z forward.
    x, y = (u - k[0, 2]) / k[0, 0], (v - k[1, 2]) / k[1, 1]
    direction = np.stack([np.ones_like(x), -x, -y])
    to_cam = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])
    corners = (scene[2] - EYE) @ to_cam.T
    u = np.arange(0, w + TILE[1], TILE[1]) - 0.5
    v = np.arange(0, h + TILE[0], TILE[0]) - 0.5
    mask = pinhole_mask(corners, k, u_px=u, v_px=v)
    everything_agrees(scene, EYE[:, None, None], direction, mask)


# Of 30 columns a tile of 16 spans more than half a turn, of 12 all of it.
@pytest.mark.parametrize(("columns", "share"), [(128, 0.3), (30, 1.0), (12, 1.0)])
def test_lidar_tiles_lack_nothing(scene: tuple, columns: int, share: float) -> None:
    grid = full_grid(preset("hdl64e"), columns)
    mask = polar_mask(scene[2] - EYE, grid, TILE)
    origin = EYE[:, None, None] + np.stack([0 * grid.origin_m, 0 * grid.origin_m, grid.origin_m])[:, :, None]
    everything_agrees(scene, origin, np.moveaxis(np.asarray(directions(grid)), -1, 0), mask, share=share)


def test_sunbeam_tiles_lack_nothing(scene: tuple) -> None:
    sun = np.array([0.4, -0.5, 0.6])
    x, y = np.linspace(-10, 60, 65), np.linspace(-30, 30, 49)
    mask = slanted_mask(scene[2], sun, x_m=x[:: TILE[1]], y_m=y[:: TILE[0]])
    ground = np.stack(np.broadcast_arrays(*np.meshgrid((x[1:] + x[:-1]) / 2, (y[1:] + y[:-1]) / 2), 0.0))
    origin = ground + (100 * sun)[:, None, None]
    everything_agrees(scene, origin, np.broadcast_to(-sun[:, None, None], origin.shape), mask)


@pytest.mark.parametrize("size", [(32, 48), (30, 41), (5, 7)])
def test_a_raster_is_put_together_of_tiles_in_any_order(size: tuple[int, int]) -> None:
    raster = np.arange(size[0] * size[1]).reshape(size)
    down, across = -(-size[0] // TILE[0]), -(-size[1] // TILE[1])
    wide = np.pad(raster, [(0, n * t - s) for n, t, s in zip((down, across), TILE, size, strict=True)])
    tiles = [
        wide[i * TILE[0] : (i + 1) * TILE[0], j * TILE[1] : (j + 1) * TILE[1]].ravel()
        for i in range(down)
        for j in range(across)
    ]
    order = np.random.default_rng(1).permutation(len(tiles))
    shuffled = np.stack(tiles)[order]
    parts = np.array_split(shuffled, 2) if len(tiles) > 1 else [shuffled]
    np.testing.assert_array_equal(in_raster(parts, order, tile=TILE, size=size), raster)
