"""What is compared: thinned rays of the simulation beside what the sensor said of them.

Letters: b blocks, c columns, r rows. A block is a frame, or a sector of one where all frames are of few drives. A
scene is what statistics count: a drive, or such a sector. Whole columns are kept, since columns are lost whole; of the
n that a scan has, c are looked at.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from flax import struct
from jaxtyping import Bool, Float, Int
from scipy.ndimage import gaussian_filter1d

from jaxsim.discover.model.cast import Cast, RayIndex, Surfaces, cast, edges, ray_index, surfaces_of
from jaxsim.discover.model.kinds import kinds_of
from jaxsim.discover.model.noise_levels import FINEST, lattice_step
from jaxsim.discover.model.simulator import AtRays, Meant, at_rays
from jaxsim.discover.rules import RULES
from jaxsim.effects.catalogue.edge_dropout import at_edge
from jaxsim.effects.rays import FLOOR, Rays, Scan
from jaxsim.frame import Array

CLASS_SD = 0.3
"""Standard deviation of a class's reflectance about the simulator's table, nats."""
CURVATURE_SD = 0.002
"""Standard deviation of the curvature 0.5 sec(incidence)**2 that noise of 2.5 degrees on the simulator's normals
leaves."""
SHIFT_SD = 0.002
"""Standard deviation of the variance of the simulator's angles, rad^2, of noise of 2.5 degrees on its normals ..."""
STEP_RAD = np.deg2rad(1.0)
"""... which moves angles towards what is common: by steps of the angle in which rays are counted ..."""
SMOOTH_STEPS = 2.0
"""... and by so many, standard deviation, over which counts are smoothed ..."""
MOST_SCORE = 20.0
"""... and at most by this slope of ln density, 1/rad: rays without noise have steps in it."""
NORMALS_SD = 1.0
"""Standard deviation of the share of the disagreement between given and fitted normals that the measured intensity
follows."""
GAIN_PRECISION = 1e-6
"""1 / variance of ln of the overall gain: any gain is possible."""
FLAT = (6, 7, 8, 9, 10)
"""Cityscapes ids of flat surfaces, whose normals a range image gives best."""
TERRAIN = (22,)
"""Cityscapes ids of ground that rolls."""
POSE_SD = np.array([0.02, 0.02, 0.02, 0.001, 0.001, 0.001])
"""Standard deviation of a frame's pose: m along x, y, z and rad about them."""
AFTER_KINDS = 5
"""Features behind the kinds: curvature, shift and the three of disagreeing normals; of a noisy simulator, or one
of free contrast, its detail too."""


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
    """ln of the readings, `lift` above them."""
    lift: Float[Array, "b c r"]
    """Nats by which the mean of a reading's logarithm lies below the logarithm of its mean."""
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
    """Columns of the design matrix of ln I, 0 where not `compared`: 1 (the gain), kinds of surfaces, curvature in the
    incidence, where noise on the simulator's normals shifts it from (`angle_scores`), and how much brighter the surface
    would be with the normal of the simulator's own range image, on flat ground, on terrain and elsewhere (the
    simulator's normals may be noisy)."""
    ridge: Float[Array, " p"]
    """1 / prior variance of each feature's coefficient in all scenes."""
    strip: Int[Array, "b c r"]
    """The strip of each ray; this and the next two are those of `Surfaces`."""
    surface: Int[Array, " t"]
    precision: Float[Array, " s"]
    scene: Int[Array, " b"]
    known_variance: Float[Array, "#b #c #r"]
    """Squared standard deviation of ln I that follows from levels read off the frames, nats^2: of what the simulator
    means, where noise of its own hides it; and of the sensor's readings by noise that is the same for all."""
    known_range_variance: Float[Array, "#b #c #r"]
    """Squared scale, m^2, of what noise of the simulator's own leaves unknown of the range that it means."""
    own_step: Float[Array, " 2"]
    """Lattices of the simulator's own intensities and ranges; 0 for none."""
    cell_hits: Int[Array, "r n"]
    """Rays of each cell of the grid that hit something, over all columns of the blocks' frames ..."""
    cell_lost: Int[Array, "r n"]
    """... and those that did not return: borders between lost and returned columns are known no better."""
    scenes: int = struct.field(pytree_node=False, default=0)
    kinds: tuple[str, ...] = struct.field(pytree_node=False, default=())
    """Names of the features behind the gain: classes, or what stands in for them (`Kinds`)."""
    after_kinds: int = struct.field(pytree_node=False, default=AFTER_KINDS)
    """Features behind the kinds of surfaces."""
    scales: tuple[str, ...] = struct.field(pytree_node=False, default=())
    """Names of the last features where contrast is left free (`contrast.Contrasts`)."""

    @property
    def intensity(self) -> Float[np.ndarray, "b c r"]:
        """The readings themselves, on their lattice where they have one; 0 of nothing."""
        reading = np.exp(np.asarray(self.log_intensity) - np.asarray(self.lift))
        # FLOOR stands for a reading of 0, whose logarithm could not be kept.
        return np.where(reading > FLOOR * 1.001, reading, 0)

    @property
    def all_blocks(self) -> Float[np.ndarray, " b"]:
        """The mask `in_fit` that leaves no block out: 1 for each."""
        return np.ones(len(self.scene), np.float32)

    def by_scene(self, by_block: Float[np.ndarray, " b"]) -> Float[np.ndarray, " s"]:
        """The sums of each scene's blocks, of the scenes that have any."""
        scene = np.asarray(self.scene)
        return np.bincount(scene, by_block, self.scenes)[np.unique(scene)]

    @property
    def smooth(self) -> Bool[Array, "b c r"]:
        """Whether the range is compared: both sides hit something, and at no edge."""
        return self.rays.hit & self.returned & ~self.edge


def without_detail(ev: Evidence) -> Evidence:
    """The evidence that takes a simulator's detail for what it says, whose slopes are left to no nuisance."""
    others = ev.features.shape[-1] - (ev.after_kinds - AFTER_KINDS)
    return replace(ev, features=ev.features.at[..., others:].set(0))


def near_enough(measured_m: Float[Array, "*n"], predicted_m: Float[Array, "*n"]) -> Bool[Array, "*n"]:
    """Whether a reading is of the predicted surface, or close by."""
    return jnp.abs(measured_m - predicted_m) < jnp.maximum(RULES.near_m, RULES.near_share * predicted_m)


def gather(
    scan: Scan,
    measured: Measured,
    *,
    frame: Int[np.ndarray, " b"],
    column: Int[np.ndarray, "b c"],
    scene: Int[np.ndarray, " b"],
    given_rad: Float[Array, "f r n"] | None = None,
    rays: Cast | None = None,
    simulator: Meant | None = None,
    apart: Sequence[int] = (),
) -> Evidence:
    """The evidence of chosen columns: `frame`, `column` and `scene` of each block.

    `given_rad` are the simulator's own incidence angles, where those of `scan` are better (`with_planes`);
    `rays` what `cast` gives for these columns, where it was asked before; `simulator` what is known of its own noise,
    if `scan` is what it means; `apart` the classes whose surfaces are partly others on the two sides: where these are
    not most of what is seen, their intensities are not compared, for they are seen at other angles than is simulated.
    """
    index = ray_index(scan, frame, column)
    values = np.asarray(measured.intensity)[index]
    valid = np.asarray(measured.valid)[index]
    step = lattice_step(values[valid], finest=FINEST["intensity_quantization"])
    kinds = kinds_of(scan, index)
    given = scan.incidence_rad if given_rad is None else given_rad
    surfaces = surfaces_of(scan, index)
    per_ray = at_rays(scan, index, surfaces=surfaces, given_rad=given, simulator=simulator or Meant.as_said(scan))
    others, returned = np.isin(np.asarray(scan.semantic)[index], apart), np.asarray(scan.hit)[index]
    if (others & returned).sum() <= RULES.apart_most_share * returned.sum():
        per_ray = replace(per_ray, trusted=per_ray.trusted & ~others)
    fields = _fields_of_rays(
        scan,
        measured,
        rays or cast(scan, frame, column),
        index=index,
        given_rad=given,
        score=angle_scores(given, hit=scan.hit, semantic=scan.semantic)[index],
        darkest=np.float32(RULES.compared_steps * step),
        cut=_cut_off(values, valid, surfaces),
        per_ray=per_ray,
        kinds=kinds.share,
    )
    details = per_ray.detail.shape[-1]
    of_frames = np.unique(frame)
    hit = np.asarray(scan.hit)[of_frames]
    ev = Evidence(
        **fields,
        lowest=np.float32(np.log(np.min(values, where=valid & (values > FLOOR), initial=1.0))),
        ridge=_ridge(len(kinds.names), detail_sd=per_ray.detail_sd),
        strip=surfaces.strip,
        surface=surfaces.surface,
        precision=surfaces.precision,
        scene=scene.astype(np.int32),
        known_range_variance=per_ray.range_variance,
        own_step=per_ray.step,
        cell_hits=hit.sum(0, dtype=np.int32),
        cell_lost=(hit & ~np.asarray(measured.valid)[of_frames]).sum(0, dtype=np.int32),
        scenes=int(scene.max()) + 1,
        kinds=kinds.names,
        after_kinds=AFTER_KINDS + details,
        scales=per_ray.scales,
    )
    return jax.device_put(ev)


@jax.jit
def _fields_of_rays(
    scan: Scan,
    measured: Measured,
    simulated: Cast,
    *,
    index: RayIndex,
    given_rad: Float[Array, "f r n"],
    score: Float[Array, "b c r"],
    darkest: Float[Array, ""],
    cut: Bool[Array, "#b #c #r"],
    per_ray: AtRays,
    kinds: Float[Array, "b c r k"],
) -> dict[str, Any]:
    """The fields of `Evidence` that are told ray by ray. Not compared are readings below `darkest`, and those that are
    `cut` off."""
    rays, pose = simulated.rays, simulated.pose
    # What the simulator itself loses at random is no loss of the sensor's.
    rays = replace(
        rays,
        log_keep=rays.log_keep + per_ray.log_kept,
        log_intensity=rays.log_intensity - per_ray.excess,
        log_power=rays.log_power - per_ray.excess,
    )
    returned, range_m = measured.valid[index], measured.range_m[index]
    # A ray that grazes its plane runs along it at the least turn of the sensor.
    steady = rays.hit & (jnp.abs(pose[..., 3:]).max(-1) < rays.range_m / RULES.least_slant)
    edge = edges(rays, scan.grid.elevation_rad) | (rays.hit & ~steady)
    step = rays.hit & at_edge(rays)
    near = near_enough(range_m, rays.range_m)
    given = given_rad[index]
    # Both angles must be moderate: of noisy angles, the moderate ones often stand for grazing surfaces.
    moderate = (rays.incidence_rad < RULES.compared_below_rad) & (given < RULES.compared_below_rad)
    # By what is usual, free of noise: what was measured, or noise of the simulator, would choose the brighter of the
    # dark rays, and those that are left would seem to fall too steeply with the angle and the range.
    expected = rays.log_intensity - per_ray.over_usual
    clear = expected > jnp.log(jnp.maximum(darkest, FLOOR))
    compared = rays.hit & returned & near & ~edge & moderate & clear & ~cut & per_ray.trusted
    # Of the logarithm of a reading that noise may halve the mean is off, and its scatter as large as itself.
    seen = rays.hit & returned & near & clear
    log_measured = jnp.log(jnp.maximum(measured.intensity[index], FLOOR))
    level = expected + jnp.nanmedian(jnp.where(seen, log_measured - rays.log_intensity, jnp.nan))
    dark = per_ray.constant * jnp.exp(-level)
    # Such noise of the simulator hides what it means by its dark rays.
    hidden = per_ray.own_constant * jnp.exp(-expected)
    compared = compared & (dark < RULES.compared_noise) & (hidden < RULES.compared_noise)
    blur = jnp.minimum(dark, RULES.compared_noise) ** 2
    known_variance = per_ray.variance + blur
    # The mean of a logarithm lies below the logarithm of the mean by half the relative variance.
    lift = jnp.broadcast_to(0.5 * blur, log_measured.shape)
    # The design of the random effects.
    features = jnp.concatenate([_features(rays, given, kinds, score=score), per_ray.detail], axis=-1)
    return {
        "rays": rays,
        "returned": returned,
        "range_m": range_m,
        "log_intensity": log_measured + lift,
        "lift": lift,
        "given_rad": given,
        "compared": compared,
        "edge": edge,
        "step": step,
        "pose": jnp.where(steady[..., None], pose, 0),
        "features": jnp.where(compared[..., None], features, 0).astype(jnp.float32),
        "known_variance": known_variance,
    }


def _cut_off(
    intensity: Float[np.ndarray, "b c r"], valid: Bool[np.ndarray, "b c r"], surfaces: Surfaces
) -> Bool[np.ndarray, "#b #c #r"]:
    """Whether a ray, or much of its surface, reads the end of the sensor's scale."""
    full = valid & (intensity >= RULES.full_reading)
    if not full.any():
        return np.zeros((1, 1, 1), bool)
    surface = np.asarray(surfaces.surface)[np.asarray(surfaces.strip)]
    count = np.bincount(surface.ravel(), valid.ravel())
    share = np.bincount(surface.ravel(), full.ravel()) / np.maximum(count, 1)
    return full | (share > RULES.full_share)[surface]


def angle_scores(
    given_rad: Float[Array, "f r n"], *, hit: Bool[Array, "f r n"], semantic: Int[Array, "f r n"]
) -> Float[np.ndarray, "f r n"]:
    """The slope of ln density of the simulator's angles of incidence at each ray, 1/rad, among the rays of its row: of
    flat ground, of terrain and of all else.

    An angle that is known with noise of variance v stands, in the mean, for one that lies v times this slope away
    (Tweedie's formula; Efron 2011, eq. 1.4): rays of the road that seem to be seen steeply are mostly others. Rows are
    asked one by one, for each sees the road at an angle of its own: over all rows the density ends at the lowest one,
    and its rays would all be moved up.
    """
    given = np.clip(np.asarray(given_rad), 0, np.pi / 2)
    score = np.zeros(given.shape, np.float32)
    returns, semantic = np.asarray(hit), np.asarray(semantic)
    steps = int(np.ceil(np.pi / 2 / STEP_RAD)) + 1
    ground, terrain = np.isin(semantic, FLAT), np.isin(semantic, TERRAIN)
    for kind in (ground, terrain, ~ground & ~terrain):
        for row in range(given.shape[1]):
            of = kind[:, row]
            at = given[:, row] / STEP_RAD
            # Shared between the steps on both sides: rays of one angle are then dense about it, not about a step.
            below = np.floor(at).astype(int)
            counted = of & returns[:, row]
            near = (at - below)[counted]
            count = np.bincount(below[counted], 1 - near, steps + 1) + np.bincount(below[counted] + 1, near, steps + 1)
            # One ray more at each step: empty ones then have a logarithm, and no cliff beside them.
            slope = np.gradient(np.log(gaussian_filter1d(count, SMOOTH_STEPS) + 1), STEP_RAD)
            score[:, row][of] = np.interp(at[of], np.arange(steps + 1), np.clip(slope, -MOST_SCORE, MOST_SCORE))
    return score


def _features(
    rays: Rays, given_rad: Float[Array, "b c r"], kinds: Float[Array, "b c r k"], *, score: Float[Array, "b c r"]
) -> Float[Array, "b c r p"]:
    """`Evidence.features`, of all rays."""
    given = jnp.minimum(given_rad, RULES.compared_below_rad)
    seen = jnp.minimum(rays.incidence_rad, RULES.compared_below_rad)
    # Held within 1.5 nats: near grazing incidence ln cos runs away from small differences of angle.
    disagreement = jnp.clip(jnp.log(jnp.cos(seen)) - jnp.log(jnp.cos(given)), -1.5, 1.5)
    ground = jnp.isin(rays.semantic, jnp.asarray(FLAT))
    terrain = jnp.isin(rays.semantic, jnp.asarray(TERRAIN))
    # Apart, since a range image gives the normals of ground better than those of hedges.
    disagreements = [jnp.where(kind, disagreement, 0) for kind in (ground, terrain, ~ground & ~terrain)]
    # E ln cos(angle + noise) is below ln cos(angle) by half the variance times sec^2.
    curvature = 0.5 / jnp.cos(given) ** 2
    shift = -jnp.tan(given) * score
    return jnp.stack([jnp.ones_like(given), *jnp.moveaxis(kinds, -1, 0), curvature, shift, *disagreements], axis=-1)


def _ridge(kinds: int, *, detail_sd: Sequence[float]) -> Float[np.ndarray, " p"]:
    """`Evidence.ridge` for so many kinds of surfaces and a simulator's detail, each of these deviations."""
    others = [1 / CURVATURE_SD**2, 1 / SHIFT_SD**2, *[1 / NORMALS_SD**2] * 3]
    of_detail = [1 / sd**2 for sd in detail_sd]
    return np.array([GAIN_PRECISION, *[1 / CLASS_SD**2] * kinds, *others, *of_detail], np.float32)
