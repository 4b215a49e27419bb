"""Rays of a scan by their places, and the places beside them."""

from __future__ import annotations

from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from jaxsim.effects.rays import FLOOR, LEAST_M, REFERENCE_M, Rays, Scan
from jaxsim.frame import Array
from jaxsim.geometry import spans_turn

Places = tuple[Int[Array, "*n"], Int[Array, "*n"], Int[Array, "*n"]]
"""Frame, row and column of each ray."""
Angle = TypeVar("Angle", float, np.ndarray)


def on_turn(column: Int[Array, "*n"], columns: int, full: Bool[Array, ""]) -> Int[Array, "*n"]:
    """Columns that lie in the image: past the border of a full turn those of its other side, else the border's."""
    return jnp.where(full, column % columns, jnp.clip(column, 0, columns - 1))


def longest_run(flags: Bool[np.ndarray, " n"], *, closed: bool) -> Int[np.ndarray, " k"]:
    """Places of the longest run of flags that are set; of a `closed` ring they count on past its seam, from n on."""
    # A ring is laid out twice: a run across its seam lies whole in the middle.
    places = np.flatnonzero(np.tile(flags, 2) if closed else flags)
    return max(np.split(places, np.flatnonzero(np.diff(places) > 1) + 1), key=len)[: len(flags)]


def within_turn(azimuth_rad: Angle) -> Angle:
    """The same azimuth from -pi to pi."""
    return (azimuth_rad + np.pi) % (2 * np.pi) - np.pi


def neighbours_m(scan: Scan) -> Float[Array, "f r c 4"]:
    """Ranges left, right, up and down of every ray. A full turn closes; other borders repeat the ray itself."""
    r = jnp.where(scan.hit, scan.range_m, jnp.inf)
    full = spans_turn(scan.grid)
    left, right = jnp.roll(r, 1, axis=2), jnp.roll(r, -1, axis=2)
    # A border that repeats the ray itself shows no edge where nothing is known.
    left = left.at[:, :, 0].set(jnp.where(full, left[:, :, 0], r[:, :, 0]))
    right = right.at[:, :, -1].set(jnp.where(full, right[:, :, -1], r[:, :, -1]))
    up = jnp.concatenate([r[:, :1], r[:, :-1]], axis=1)
    down = jnp.concatenate([r[:, 1:], r[:, -1:]], axis=1)
    return jnp.stack([left, right, up, down], axis=-1)


@jax.jit
def rays_at(scan: Scan, at: Places) -> Rays:
    """The rays at these places of a scan, as the ray model predicts them: every hit returns, nothing is noisy."""
    frame, row, column = at
    r, hit = scan.range_m[at], scan.hit[at]
    log_intensity = jnp.log(jnp.maximum(scan.intensity[at], FLOOR))
    zero, one = jnp.zeros_like(r), jnp.ones_like(r)
    return Rays(
        frame=frame,
        row=row,
        column=column,
        azimuth_rad=scan.grid.azimuth_rad[column],
        elevation_rad=scan.grid.elevation_rad[row],
        phase=scan.phase[at],
        time_s=scan.time_s[frame],
        speed_mps=scan.speed_mps[frame],
        heading_rad=scan.heading_rad[frame],
        turned_rad=jnp.zeros((*r.shape, 2), r.dtype),
        moved_m=jnp.zeros((*r.shape, 3), r.dtype),
        hit=hit,
        range_m=r,
        incidence_rad=scan.incidence_rad[at],
        semantic=scan.semantic[at],
        instance=scan.instance[at],
        rgb=scan.rgb[at],
        beside_m=neighbours_m(scan)[at],
        glare_m=scan.glare_m[at],
        glare_rad=scan.glare_rad[at],
        met_log_intensity=log_intensity,
        log_intensity=log_intensity,
        # Sensors correct their intensity for the fall-off with the square of the range; the echo's power still has it.
        log_power=log_intensity - 2 * jnp.log(jnp.maximum(r, LEAST_M) / REFERENCE_M),
        log_power_sd=zero,
        log_keep=zero,
        column_loss=zero,
        reading_m=r,
        noise_m=zero,
        between=zero,
        between_m=r,
        ghost=zero,
        ghost_m=r,
        clutter=zero,
        clutter_power=zero,
        clutter_scale_m=one,
        clutter_from_m=0.5 * one,
        clutter_log_intensity=jnp.log(0.05) * one,
        intensity_step=jnp.zeros((), r.dtype),
        intensity_top=jnp.ones((), r.dtype),
        range_step_m=jnp.zeros((), r.dtype),
    )


def all_rays(scan: Scan) -> Rays:
    """Every ray of a scan, shape (f, r, c)."""
    f, r, c = jnp.meshgrid(*(jnp.arange(n, dtype=jnp.int32) for n in scan.range_m.shape), indexing="ij")
    return rays_at(scan, (f, r, c))
