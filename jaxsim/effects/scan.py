"""Simulated frames, as they are read from files, to the `Scan` that effects act on (host memory), with what a range
image tells of its surfaces: their slopes, and where the nearest glare is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from jaxsim.effects.edits import wrapped
from jaxsim.effects.places import on_turn
from jaxsim.effects.rays import Scan
from jaxsim.frame import Array, PolarGrid, PolarImage
from jaxsim.geometry import incidence, known_or_median, spans_turn
from jaxsim.geometry.rasters import check_classes

BLOOMS_FROM = 0.9
"""Intensity from which a surface blooms."""
SIGN = 20
"""Cityscapes id of traffic signs."""
GLARE_REACH_RAD = 0.3
_SAME = 1e-3
"""Relative error of a range below which a neighbour continues the plane."""
_ROUGH = 0.03
"""Above it no neighbour continues the surface, which is then taken to face the ray."""
# A cell, then two cells each up, down, left and right of it: the near ones and the far ones.
_DOWN = np.array([0, -1, 1, 0, 0, -2, 2, 0, 0], np.int32)
_RIGHT = np.array([0, 0, 0, -1, 1, 0, 0, -2, 2], np.int32)
_NEAR, _BEYOND = slice(1, 5), slice(5, 9)


def scan_of(
    grid: PolarGrid,
    images: Sequence[PolarImage],
    further: Sequence[Mapping[str, np.ndarray]] | None = None,
    *,
    about: Sequence[Mapping[str, Any]] | None = None,
) -> Scan:
    """The scan of simulated frames on one grid.

    `further` holds each frame's further rasters by the names of the polar-frame format (incidence rad, semantic,
    instance, rgb 0..255, time s within the scan), `about` what its grid.json says (time s, speed m/s, heading rad,
    tags).
    What is missing: incidence comes from the range image, the place within the scan from the column, the rest is 0.
    Frame times count from the first frame's. Raises ValueError for frames that do not fit the grid or hold
    impossible values.
    """
    if not images:
        raise ValueError("scan_of: no frames; give one simulated frame or more")
    further, about = further or [{}] * len(images), about or [{}] * len(images)
    if not len(images) == len(further) == len(about):
        raise ValueError(
            f"scan_of: {len(images)} images, further rasters of {len(further)} and facts of {len(about)}; one each"
        )
    grid = jax.tree.map(lambda x: np.asarray(x, np.float32), grid)
    if len(grid.azimuth_rad) < 2:
        raise ValueError(f"scan_of: a grid of {len(grid.azimuth_rad)} columns has no step; it needs 2 or more")
    frames = [_frame(grid, *frame, number=k) for k, frame in enumerate(zip(images, further, strict=True))]
    stacked = {name: np.stack([frame[name] for frame in frames]) for name in frames[0]}
    time_s = _per_frame(about, "time", np.float64)
    return Scan(
        grid=grid,
        **stacked,
        # Seconds since 1970 do not fit into float32.
        time_s=(time_s - time_s.min()).astype(np.float32),
        speed_mps=_per_frame(about, "speed", np.float32),
        heading_rad=_per_frame(about, "heading", np.float32),
        tags=_tags(about),
    )


def _tags(about: Sequence[Mapping[str, Any]]) -> dict[str, Bool[np.ndarray, " f"]]:
    """Which frames have each tag."""
    names = sorted({tag for entry in about for tag in entry.get("tags", ())})
    return {name: np.array([name in entry.get("tags", ()) for entry in about]) for name in names}


def _per_frame(about: Sequence[Mapping[str, Any]], key: str, dtype: Any) -> np.ndarray:
    """A number of every frame; 0 where none has it."""
    given = [entry.get(key) for entry in about]
    if any(value is None for value in given) and any(value is not None for value in given):
        lacking = [str(k) for k, value in enumerate(given) if value is None]
        raise ValueError(
            f"scan_of: {key} is given for some frames and not for others; {len(lacking)} of {len(given)} lack it "
            f"(numbers {', '.join(lacking[:3])}{' ...' * (len(lacking) > 3)}, from 0): give it for all or none"
        )
    values = np.array([0.0 if value is None else value for value in given], dtype)
    if not np.isfinite(values).all():
        raise ValueError(f"scan_of: {key} must be finite, got {values.tolist()}")
    return values


def _frame(
    grid: PolarGrid, image: PolarImage, further: Mapping[str, np.ndarray], *, number: int
) -> dict[str, np.ndarray]:
    """One frame's rasters by the names of `Scan`."""
    shape = (len(grid.elevation_rad), len(grid.azimuth_rad))
    rasters = {"range": image.range_m, "intensity": image.intensity, "valid": image.valid, **further}
    for name, raster in rasters.items():
        if np.shape(raster)[:2] != shape:
            raise ValueError(f"scan_of: frame {number}: {name} is {np.shape(raster)}, the grid {shape}")
    hit = np.asarray(image.valid) & (np.asarray(image.range_m) > 0)
    range_m = np.where(hit, image.range_m, 0).astype(np.float32)
    # What did not return has no intensity, whatever a file keeps there.
    intensity = np.where(hit, image.intensity, 0).astype(np.float32)
    semantic = np.asarray(further.get("semantic", np.zeros(shape)), np.int32)
    check_classes(semantic, f"scan_of: frame {number}")
    # A renderer that has no retroreflection still knows which surfaces are signs.
    glare_m, glare_rad = nearest_glare(grid, range_m, hit & ((intensity >= BLOOMS_FROM) | (semantic == SIGN)))
    return {
        "range_m": range_m,
        "hit": hit,
        "intensity": intensity,
        "incidence_rad": _incidence(grid, range_m, hit, given=further.get("incidence"), number=number),
        "semantic": semantic,
        "instance": np.asarray(further.get("instance", np.zeros(shape)), np.int32),
        "rgb": np.asarray(further.get("rgb", np.zeros((*shape, 3))), np.float32) / 255,
        "phase": _phase(shape, hit, further.get("time")),
        "glare_m": glare_m,
        "glare_rad": glare_rad,
        "slopes": np.asarray(slopes_of(grid, range_m, hit)),
    }


def _incidence(
    grid: PolarGrid, range_m: np.ndarray, hit: np.ndarray, *, given: np.ndarray | None, number: int
) -> Float[np.ndarray, "r c"]:
    if given is None:
        return known_or_median(*jax.device_get(incidence(range_m, hit, grid)))
    angle = np.asarray(given, np.float32)
    seen = angle[hit]
    if seen.size and not (np.isfinite(seen).all() and seen.min() >= 0 and seen.max() <= np.pi / 2 + 1e-3):
        raise ValueError(
            f"scan_of: frame {number}: incidence spans {seen.min():g}..{seen.max():g}; it must be the angle between "
            "ray and surface normal in radians, 0 head on to pi/2"
        )
    return np.where(hit, angle, 0).astype(np.float32)


def _phase(shape: tuple[int, int], hit: np.ndarray, time_s: np.ndarray | None) -> Float[np.ndarray, "r c"]:
    """The place within the scan, 0..1: by the files' times from first to last, else by column from left to right."""
    if time_s is not None:
        t = np.asarray(time_s, np.float64)
        known = hit & np.isfinite(t)
        if known.any() and np.ptp(t[known]) > 0:
            # By what returned: rays that did not often have a time of 0.
            first, last = t[known].min(), t[known].max()
            return np.clip((np.nan_to_num(t) - first) / (last - first), 0, 1).astype(np.float32)
    rows, columns = shape
    return np.tile(((np.arange(columns) + 0.5) / columns).astype(np.float32), (rows, 1))


def nearest_glare(
    grid: PolarGrid, range_m: Float[Array, "r c"], bright: Bool[Array, "r c"]
) -> tuple[Float[np.ndarray, "r c"], Float[np.ndarray, "r c"]]:
    """The range of the nearest bright target by angle, and the angle to it; pi where there is none within 0.3 rad.

    Exact and separable: first the nearest bright row of each column, then the nearest such column.
    """
    rows, columns = range_m.shape
    best = np.full((rows, columns), GLARE_REACH_RAD**2)
    target_m, glares = np.zeros((rows, columns), np.float32), np.zeros((rows, columns), bool)
    if not bright.any():
        return target_m, np.full((rows, columns), np.pi, np.float32)
    # Squares of angles: that of elevations, then that of azimuths, which is smaller by the cosine of the elevation.
    elevation = np.asarray(grid.elevation_rad, np.float64)
    apart = np.square(elevation[:, None] - elevation[None, :])
    # Few columns hold a bright target: all others are spared the search.
    lit = np.flatnonzero(bright.any(axis=0))
    cost = np.where(bright[None, :, lit], apart[:, :, None], np.inf)
    row = cost.argmin(axis=1)
    cost, lit_m = cost.min(axis=1), range_m[row, lit[None, :]]
    step = abs(float(grid.azimuth_rad[0]) - float(grid.azimuth_rad[-1])) / (columns - 1)
    # Never past half a turn, where a target would be met again from the other side.
    reach = min(int(GLARE_REACH_RAD / step), (columns - 1) // 2)
    closed = bool(spans_turn(grid))
    for offset in range(-reach, reach + 1):
        inside = np.ones(len(lit), bool) if closed else (lit + offset >= 0) & (lit + offset < columns)
        to = (lit[inside] + offset) % columns
        square = cost[:, inside] + np.square(offset * step * np.cos(elevation))[:, None]
        nearer = square < best[:, to]
        best[:, to] = np.where(nearer, square, best[:, to])
        target_m[:, to] = np.where(nearer, lit_m[:, inside], target_m[:, to])
        glares[:, to] |= nearer
    return target_m, np.where(glares, np.sqrt(best), np.pi).astype(np.float32)


@jax.jit
def slopes_of(grid: PolarGrid, range_m: Float[Array, "r c"], hit: Bool[Array, "r c"]) -> Float[Array, "r c 2"]:
    """The slopes u and v of every cell's surface, to the left and up, from those neighbours that continue its plane.

    With q = 1 / range, which is linear in the ray's direction on a plane, q (1, u, v) is the plane's normal over its
    distance, in the basis of the cell's ray, its left and its up.

    To each side the next cell gives a slope and the one after tells whether it is the same plane's. Weights as in
    WENO schemes: a corner takes the slope of its own side, a lone pole none.
    """
    rows, columns = range_m.shape
    azimuth, elevation = grid.azimuth_rad, grid.elevation_rad
    row, column = jnp.meshgrid(jnp.arange(rows), jnp.arange(columns), indexing="ij")
    down = jnp.asarray(_DOWN)[:, None, None]
    right = jnp.asarray(_RIGHT)[:, None, None]
    i = jnp.clip(row[None] + down, 0, rows - 1)
    j = on_turn(column[None] + right, columns, spans_turn(grid))
    returned = hit[i, j]
    far = jnp.where(returned, range_m[i, j], jnp.inf)
    r = jnp.where(returned[0], far[0], 1.0)
    # Neighbours past a border repeat the border.
    valid = returned & returned[:1]
    valid = valid & ((i != row[None]) | (j != column[None]))
    continued = valid[_BEYOND] & ((i[_BEYOND] != i[_NEAR]) | (j[_BEYOND] != j[_NEAR]))
    ratio = r[None] / jnp.where(returned, far, 1.0)
    e = elevation[row][None]
    de, da = elevation[i] - e, wrapped(azimuth[j] - azimuth[column][None])

    def slope(near: slice, beyond: slice, *, even: Array, odd: Array) -> Array:
        """The slope that near and far neighbours give: on a plane a neighbour's ratio is even + slope * odd."""
        value = (ratio[near] - even[near]) / jnp.where(valid[near], odd[near], 1.0)
        # By how much the far neighbour misses the plane through the near one.
        rough = ratio[beyond] - even[beyond] - value * odd[beyond]
        rough = jnp.where(continued[near.start - 1 : near.stop - 1], rough, ratio[near] - even[near])
        # Jiang and Shu 1996: the inverse square of how rough the surface is on this side.
        weight = jnp.where(valid[near], 1 / jnp.square(rough * rough + _SAME**2), 0.0)
        # One more vote, for slope 0: it wins only where every neighbour is rougher than _ROUGH.
        no_slope = 1 / (_ROUGH**2 + _SAME**2) ** 2
        return jnp.sum(jnp.where(valid[near], value, 0.0) * weight, axis=0) / (jnp.sum(weight, axis=0) + no_slope)

    v = slope(slice(1, 3), slice(5, 7), even=jnp.cos(de), odd=jnp.sin(de))
    # 1 - cos(da), without cancellation.
    versine = 2 * jnp.square(jnp.sin(da / 2))
    even = 1 - versine * jnp.cos(e) * (jnp.cos(e) - v[None] * jnp.sin(e))
    u = slope(slice(3, 5), slice(7, 9), even=even, odd=jnp.cos(e) * jnp.sin(da))
    return jnp.stack([u, v], axis=-1)
