"""Simulated frames as they would be seen from elsewhere: the range image, cast again for the whole scan."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from jaxsim.discover.model.cast import RayIndex, ray_index
from jaxsim.discover.model.evidence import Measured, near_enough
from jaxsim.effects import get_effect
from jaxsim.effects.places import rays_at
from jaxsim.effects.rays import Scan
from jaxsim.effects.recast import is_told, recast
from jaxsim.effects.scan import slopes_of
from jaxsim.frame import Array

FIELDS = ("range_m", "hit", "incidence_rad", "semantic", "instance", "rgb", "glare_m", "glare_rad")
"""Rasters of a scan that follow from the surface that a ray meets."""


def seen_from(
    scan: Scan, effects: Mapping[str, Mapping[str, Float[np.ndarray, " k"]]]
) -> tuple[Scan, Bool[np.ndarray, "f r n"]]:
    """The scan (host memory) as a sensor sees it on which these effects act, and the rays of which it tells anything:
    names and parameters of those of the catalogue that displace rays, each a number for every frame, or beam. What no
    simulated ray met stays unknown: beside edges the nearest surface goes on."""
    frames, _, columns = scan.range_m.shape
    index = ray_index(scan, np.arange(frames), np.broadcast_to(np.arange(columns), (frames, columns)))
    # Numbers of a frame stand before its columns and rows.
    spread = {
        name: {
            key: np.asarray(value, np.float32)
            if get_effect(name).parameters[key].shape == "row"
            else np.asarray(value, np.float32)[:, None, None]
            for key, value in values.items()
        }
        for name, values in effects.items()
    }
    met = {name: np.swapaxes(np.asarray(v), 1, 2) for name, v in _met(scan, index, spread).items()}
    slopes = [np.asarray(slopes_of(scan.grid, r, h)) for r, h in zip(met["range_m"], met["hit"], strict=True)]
    told = met.pop("told")
    return replace(scan, **met, slopes=np.stack(slopes)), told


@jax.jit
def _met(scan: Scan, index: RayIndex, effects: dict[str, dict[str, Array]]) -> dict[str, Array]:
    """The rasters of the surfaces that displaced rays meet, columns before rows."""
    rays = rays_at(scan, index)
    for name, values in effects.items():
        rays = get_effect(name).apply(values, rays)
    told = is_told(rays, scan)
    rays = recast(rays, scan)
    intensity = jnp.where(rays.hit, jnp.exp(rays.log_intensity), 0)
    return {name: getattr(rays, name) for name in FIELDS} | {"intensity": intensity, "told": told}


def same_surfaces(scan: Scan, measured: Measured) -> tuple[Scan, Measured]:
    """Both sides (in host memory) without the rays whose ranges are of different surfaces: between two moments things
    move and come out from behind others, which no effect of a sensor should explain. They count as seen by neither.

    A ray is kept by what its neighbours say, not by whether it returned itself: where both sides see one surface to
    both sides of it, a ray that did not return was lost, and the share of these is that of all rays there.
    """
    hit, valid = np.asarray(scan.hit), np.asarray(measured.valid)
    agree = hit & valid & np.asarray(near_enough(measured.range_m, scan.range_m))
    same = hit & _amid(agree) & (agree | ~valid)
    return seen_by_both(scan, measured, same=same)


def seen_by_both(scan: Scan, measured: Measured, *, same: Bool[np.ndarray, "f r n"]) -> tuple[Scan, Measured]:
    """Both sides (in host memory) with those rays alone; the others count as seen by neither."""
    hit = np.asarray(scan.hit) & same
    slopes = np.where(hit[..., None], scan.slopes, 0).astype(np.float32)
    zeros = {name: np.where(hit, getattr(scan, name), 0) for name in ("range_m", "intensity", "incidence_rad")}
    one = replace(scan, hit=hit, slopes=slopes, **{k: v.astype(np.float32) for k, v in zeros.items()})
    # Where neither hits anything there is nothing to be of another moment.
    return one, replace(measured, valid=np.asarray(measured.valid) & same)


def _amid(agreed: np.ndarray) -> np.ndarray:
    """Whether both neighbours of a ray, in its row or in its column, agree."""
    wide = np.pad(agreed, ((0, 0), (1, 1), (1, 1)))
    beside = wide[:, 1:-1, :-2] & wide[:, 1:-1, 2:]
    above = wide[:, :-2, 1:-1] & wide[:, 2:, 1:-1]
    return beside | above
