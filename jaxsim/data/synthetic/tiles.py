"""Which solids can the rays of a tile meet? A conservative answer, on the host, from bounding boxes.

Rays of an image come in tiles. The border between two columns of tiles is a plane through the eye, and so is the
border between two rows: a solid whose bounding box lies wholly beyond one border of a tile cannot be met there.
Boxes are corners (n, 8, 3) in the frame of the rays; a mask is (tiles down, tiles across, n).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from jaxsim.data.synthetic.raycast import TileSolids
from jaxsim.data.synthetic.solids import CAPACITY
from jaxsim.frame import PolarGrid

Corners = Float[np.ndarray, "n 8 3"]
_Mask = Bool[np.ndarray, "down across n"]


def _between(side: Float[np.ndarray, "borders n 8"]) -> Bool[np.ndarray, "tiles n"]:
    """Boxes that reach into the tile between successive borders; `side` grows towards later tiles."""
    return (side[:-1].max(axis=-1) >= 0) & (side[1:].min(axis=-1) <= 0)


def pinhole_mask(
    corners_cam: Corners,
    intrinsics: Float[np.ndarray, "3 3"],
    *,
    u_px: Float[np.ndarray, " across1"],
    v_px: Float[np.ndarray, " down1"],
) -> _Mask:
    """Tiles of a camera image, by the pixel coordinates of their borders. The boxes are in `cam`."""
    x, y, z = np.moveaxis(corners_cam, -1, 0)
    slope_x = ((u_px - intrinsics[0, 2]) / intrinsics[0, 0])[:, None, None]
    slope_y = ((v_px - intrinsics[1, 2]) / intrinsics[1, 1])[:, None, None]
    ahead = (z > 0).any(axis=-1)
    return _between(y - slope_y * z)[:, None] & (_between(x - slope_x * z) & ahead)[None]


def polar_mask(corners_velo: Corners, grid: PolarGrid, tile: tuple[int, int]) -> _Mask:
    """Tiles (rows, columns) of a polar grid. The boxes are in `velo`."""
    azimuth, elevation = np.asarray(grid.azimuth_rad, np.float64), np.asarray(grid.elevation_rad, np.float64)
    half = abs(azimuth[1] - azimuth[0])
    x, y, z = np.moveaxis(corners_velo, -1, 0)
    starts = np.arange(0, len(azimuth), tile[1])
    # Azimuth falls from column to column: a tile's left border is its larger one.
    left = azimuth[starts] + half
    right = azimuth[np.minimum(starts + tile[1], len(azimuth)) - 1] - half
    beyond_left = y * np.cos(left)[:, None, None] - x * np.sin(left)[:, None, None]
    beyond_right = x * np.sin(right)[:, None, None] - y * np.cos(right)[:, None, None]
    wedge = (beyond_left.min(axis=-1) <= 0) & (beyond_right.min(axis=-1) <= 0)
    # Two planes bound less than half a turn; a wider tile may meet whatever stands there.
    wedge |= (left - right >= np.pi)[:, None]

    # Elevation has its extremes at the nearest and the farthest distance of the box's circle from the axis.
    middle = corners_velo[..., :2].mean(axis=1)
    radius = np.linalg.norm(corners_velo[..., :2] - middle[:, None], axis=-1).max(axis=-1)
    rho = np.linalg.norm(middle, axis=-1)
    near, far = np.maximum(rho - radius, 1e-3), rho + radius
    rows = np.arange(0, len(elevation), tile[0])
    masks = []
    for first in rows:
        beams = slice(first, first + tile[0])
        top = z.max(axis=-1) - np.min(grid.origin_m[beams])
        bottom = z.min(axis=-1) - np.max(grid.origin_m[beams])
        highest = np.arctan2(top, np.where(top > 0, near, far))
        lowest = np.arctan2(bottom, np.where(bottom > 0, far, near))
        masks.append((highest >= elevation[beams].min() - 1e-3) & (lowest <= elevation[beams].max() + 1e-3))
    return np.stack(masks)[:, None] & wedge[None]


def slanted_mask(
    corners: Corners,
    towards: Float[np.ndarray, "3"],
    *,
    x_m: Float[np.ndarray, " across1"],
    y_m: Float[np.ndarray, " down1"],
) -> _Mask:
    """Tiles of the ground, by their borders, under parallel rays that come from `towards`. The boxes are in `world`."""
    shift = corners[..., 2:] * (towards[:2] / towards[2])
    x, y = np.moveaxis(corners[..., :2] - shift, -1, 0)
    return _between(y - y_m[:, None, None])[:, None] & _between(x - x_m[:, None, None])[None]


def solids_by_tile(mask: _Mask, counts: tuple[int, int, int]) -> TileSolids:
    """Lists of a mask's solids; leaves have tiles first, (down * across, ...), those of most solids last."""
    flat = mask.reshape(-1, mask.shape[-1])
    kinds = np.split(flat, np.cumsum(counts)[:2], axis=1)
    lists = [_lists(m, room) for m, room in zip(kinds, CAPACITY, strict=True)]
    met = np.stack([m.sum(axis=1) for m in kinds], axis=1).astype(np.int32)
    order = np.lexsort((met[:, 2], met[:, 1], met[:, 0]))
    return TileSolids(order.astype(np.int32), lists[0][order], lists[1][order], lists[2][order], met[order])


def in_raster(
    rows: Sequence[Shaped[np.ndarray, "t1 r"]],
    order: Int[np.ndarray, " t"],
    *,
    tile: tuple[int, int],
    size: tuple[int, int],
) -> Shaped[np.ndarray, "h w"]:
    """The raster of values that stand tile by tile: parts one after the other, `order` the tiles' numbers."""
    down, across = -(-size[0] // tile[0]), -(-size[1] // tile[1])
    cut = np.empty((down * across, tile[0] * tile[1]), rows[0].dtype)
    cut[order] = np.concatenate(rows)
    raster = cut.reshape(down, across, *tile).swapaxes(1, 2).reshape(down * tile[0], across * tile[1])
    return np.ascontiguousarray(raster[: size[0], : size[1]])


def _lists(mask: Bool[np.ndarray, "tiles n"], room: int) -> Int[np.ndarray, "tiles room"]:
    # An unused place names the last slot; a loop that runs past a tile's own count meets an empty solid there.
    out = np.full((len(mask), room), room - 1, np.int32)
    tile, solid = np.nonzero(mask)
    first = np.cumsum(mask.sum(axis=1)) - mask.sum(axis=1)
    out[tile, np.arange(len(tile)) - first[tile]] = solid
    return out
