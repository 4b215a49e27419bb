"""What is compared: thinned rays of the simulation beside what the sensor said of them.

Letters: b blocks, c columns, r rows. A block is a frame, or a sector of one where there is but one scan. A unit
is what statistics count: a scene (drive), or a sector. Whole columns are kept, since columns are lost whole.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from flax import struct
from jaxtyping import Bool, Float, Int

from jaxsim.discover.model.cast import Cast, cast, places
from jaxsim.discover.model.lattice import FINEST, lattice_step
from jaxsim.discover.model.surfaces import edges, surfaces_of
from jaxsim.effects.catalogue.edge_dropout import at_edge
from jaxsim.effects.rays import FLOOR, Rays, Scan
from jaxsim.frame import Array

CLASS_SD = 0.3
"""Of a class's reflectance about the simulator's table, nats."""
CURVATURE_SD = 0.002
"""Of the curvature 0.5 sec(incidence)**2 that noise of 2.5 degrees on the simulator's normals leaves."""
STEEPEST_RAD = np.deg2rad(80.0)
"""Intensity is compared below this incidence."""
GROUND, TERRAIN = (6, 7, 8, 9, 10), (22,)
"""Cityscapes ids of flat surfaces, whose normals a range image gives best, and of those that roll."""
BLURRED = 3.0
"""Steps of the sensor's rounding below which predicted intensities are not compared: their logarithms are off."""
LEAST_SLANT = 0.03
"""Cosine of incidence below which a range tells nothing: it changes by 33 times what the surface does."""
POSE_SD = np.array([0.02, 0.02, 0.02, 0.001, 0.001, 0.001])
"""Of a frame's pose: m along x, y, z and rad about them."""


@struct.dataclass
class Measured:
    """A sensor's frames on the grid of the simulated ones."""

    range_m: Float[Array, "f r c"]
    intensity: Float[Array, "f r c"]
    valid: Bool[Array, "f r c"]


@struct.dataclass
class Evidence:
    """Thinned rays, what was measured of them, and what their nuisances need."""

    rays: Rays
    returned: Bool[Array, "b c r"]
    range_m: Float[Array, "b c r"]
    log_intensity: Float[Array, "b c r"]
    lowest: Float[Array, ""]
    """ln of the weakest reading that is not 0: a 0 says that the intensity lies below it."""
    given_rad: Float[Array, "b c r"]
    """The simulator's own angle of incidence, which its intensity follows; noisy, it may be."""
    compared: Bool[Array, "b c r"]
    """The intensity is that of the predicted surface: it returned, close by, at no edge, not at grazing incidence, and
    is not so weak that the sensor's rounding blurs it."""
    edge: Bool[Array, "b c r"]
    """A neighbour lies clearly nearer or farther, or one of the two hits nothing."""
    step: Bool[Array, "b c r"]
    """The range steps to a neighbour of any side, as rows of the road do far away; `edge` leaves those out."""
    pose: Float[Array, "b c r 6"]
    """Change of range with the sensor's pose (x, y, z, and rotations about them); 0 at grazing incidence."""
    features: Float[Array, "b c r p"]
    """Of the reflectance nuisance: 1, class indicators, curvature in the incidence, and how much brighter the surface
    would be with the normal of the simulator's own range image, on flat ground, on terrain and elsewhere (the
    simulator's normals may be noisy)."""
    ridge: Float[Array, " p"]
    strip: Int[Array, "b c r"]
    """The part of a surface that one column sees, which is alike: numbered through all frames, 0 none."""
    surface: Int[Array, " t"]
    """That each strip belongs to: an object, or a patch of what is no object; 0 none."""
    hold: Float[Array, " s"]
    """1 / variance of each surface's reflectance about its class, 1/nats^2."""
    unit: Int[Array, " b"]
    units: int = struct.field(pytree_node=False, default=0)


def near_enough(measured_m: Array, predicted_m: Array) -> Array:
    """Whether a reading is of the predicted surface, or close by."""
    return jnp.abs(measured_m - predicted_m) < jnp.maximum(0.5, 0.05 * predicted_m)


def gather(
    scan: Scan,
    measured: Measured,
    frame: np.ndarray,
    column: np.ndarray,
    unit: np.ndarray,
    *,
    given_rad: Array | None = None,
    rays: Cast | None = None,
) -> Evidence:
    """The evidence of chosen columns: `frame` (b,), `column` (b, c), `unit` (b,) of each block.

    `given_rad` (f, r, c) are the simulator's own incidence angles, where those of `scan` are better (`with_planes`);
    `rays` what `cast` gives for these columns, where it was asked before.
    """
    at = places(scan, frame, column)
    strip, surface, hold = surfaces_of(scan, at)
    values, seen = np.asarray(measured.intensity)[at], np.asarray(measured.valid)[at]
    step = lattice_step(values[seen], finest=FINEST["intensity_quantization"])
    classes = np.unique(np.asarray(scan.semantic)[at])
    lowest = np.log(np.min(values, where=seen & (values > FLOOR), initial=1.0))
    return _gather(
        scan,
        measured,
        scan.incidence_rad if given_rad is None else given_rad,
        at,
        rays or cast(scan, frame, column),
        (strip, surface, hold),
        unit.astype(np.int32),
        (np.float32(BLURRED * step), np.float32(lowest)),
        classes=tuple(int(c) for c in classes),
        units=int(unit.max()) + 1,
    )


@partial(jax.jit, static_argnames=("classes", "units"))
def _gather(
    scan: Scan,
    measured: Measured,
    given_rad: Array,
    at: Any,
    simulated: Cast,
    surfaces: Any,
    unit: Any,
    limits: Any,
    *,
    classes: Any,
    units: int,
) -> Evidence:
    rays, pose, (least, lowest) = simulated.rays, simulated.pose, limits
    returned, range_m = measured.valid[at], measured.range_m[at]
    steady = rays.hit & (jnp.abs(pose[..., 3:]).max(-1) < rays.range_m / LEAST_SLANT)
    edge = edges(rays, scan.grid.elevation_rad) | (rays.hit & ~steady)
    step = rays.hit & at_edge(rays)
    near = near_enough(range_m, rays.range_m)
    given = given_rad[at]
    # Both angles must be moderate: of noisy angles, the moderate ones often stand for grazing surfaces.
    moderate = (rays.incidence_rad < STEEPEST_RAD) & (given < STEEPEST_RAD)
    # By what is predicted, not by what was measured, which would choose the brighter of the dark rays.
    clear = rays.log_intensity > jnp.log(jnp.maximum(least, FLOOR))
    compared = rays.hit & returned & near & ~edge & moderate & clear
    steep, better = (jnp.minimum(angle, STEEPEST_RAD) for angle in (given, rays.incidence_rad))
    one_hot = [(rays.semantic == c).astype(jnp.float32) for c in classes]
    disagree = jnp.clip(jnp.log(jnp.cos(better)) - jnp.log(jnp.cos(steep)), -1.5, 1.5)
    flat, rolling = (jnp.isin(rays.semantic, jnp.asarray(ids)) for ids in (GROUND, TERRAIN))
    apart = [jnp.where(kind, disagree, 0) for kind in (flat, rolling, ~flat & ~rolling)]
    features = jnp.stack([jnp.ones_like(steep), *one_hot, 0.5 / jnp.cos(steep) ** 2, *apart], axis=-1)
    ridge = np.array([1e-6, *[1 / CLASS_SD**2] * len(classes), 1 / CURVATURE_SD**2, 1.0, 1.0, 1.0], np.float32)
    return Evidence(
        rays=rays,
        returned=returned,
        range_m=range_m,
        log_intensity=jnp.log(jnp.maximum(measured.intensity[at], FLOOR)),
        lowest=lowest,
        given_rad=given,
        compared=compared,
        edge=edge,
        step=step,
        pose=jnp.where(steady[..., None], pose, 0),
        features=jnp.where(compared[..., None], features, 0).astype(jnp.float32),
        ridge=ridge,
        strip=surfaces[0],
        surface=surfaces[1],
        hold=surfaces[2],
        unit=unit,
        units=units,
    )
