"""An error of the sensor's mounting, as the registration of ranges found it.

From far away no fit of the likelihood arrives there: frames' own poses (`random_effects`) take up a part, and which
rays lie at edges is another matter. So the simulated scan is brought to where the sensor stood before anything else is
asked, and the motion is reported as the effects of a mounting.

What it gains: frames' own numbers p_f are normal about what the sensor's mounting is off by, with `evidence.POSE_SD`.
Held against 0, each scene gains sum over its frames of (|p_f|^2 - |p_f - m|^2) / 2 sd^2 nats, with m from the others.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from jaxsim.discover.find.division import NOTHING_YET
from jaxsim.discover.model.cast import RayIndex, ray_index, sectors_a_drive
from jaxsim.discover.model.evidence import POSE_SD, Measured
from jaxsim.discover.model.fit import Problem, fit
from jaxsim.discover.model.noise_levels import lattices_of
from jaxsim.discover.model.parameters import to_values
from jaxsim.discover.read import Comparison
from jaxsim.discover.read.registration import LIFT, MOTION_PARTS, EffectValues, Registration, as_effects
from jaxsim.discover.rules import RULES
from jaxsim.discover.scenes import Split, clipped, p_value
from jaxsim.discover.verdict import Interval, Named, Registered
from jaxsim.effects import EFFECTS, Law, Parameter, get_effect
from jaxsim.effects.chain import SensorModel
from jaxsim.effects.edits import displace
from jaxsim.effects.places import rays_at
from jaxsim.effects.rays import Scan
from jaxsim.effects.recast import is_told, recast
from jaxsim.effects.scan import slopes_of
from jaxsim.frame import Array
from jaxsim.metrics.intervals import mean_interval

POSE_AND_LIFT_SD = np.append(POSE_SD, POSE_SD[-1])
"""Standard deviations of a frame's own pose and lift of beams, m and rad."""
OF_POSE = ("extrinsic_translation", "extrinsic_rotation")
"""The effects of where a sensor stands: beams are of the sensor, and move with it."""
LIFT_OF_ALL = Law(
    name="lift",
    parameters={"error_rad": Parameter(0.0, -0.01, 0.01, "rad", "of all beams alike", scale=0.0014)},
    channels=("range", "intensity", "drop"),
    apply=lambda p, rays: displace(rays, turn_rad=(0 * rays.range_m, p["error_rad"] + 0 * rays.range_m)),
    casts=2,
)
"""`beam_elevation_error` with one number for all beams."""
OF_SURFACE = ("range_m", "hit", "incidence_rad", "semantic", "instance", "rgb", "glare_m", "glare_rad")
"""Rasters of a scan that follow from the surface that a ray meets."""
BY_RANGES = (
    "found by registering the ranges of both sides; everything else was asked, and the gap is shown, with the "
    "simulated frames as seen from there"
)
"""How the effects of a mounting are found, in words."""
BY_FRAMES = (
    "frames of so few drives find and judge it in turn, and share how their drive was localised: a place that is off "
    "on the map looks the same as a mounting"
)
"""What few drives leave open."""


@dataclass(frozen=True)
class Mounting:
    """Effects of a mounting that were put in place, and the comparison with them there."""

    effects: tuple[str, ...]
    """Names of those that the registration found."""
    comparison: Comparison
    known: SensorModel
    """What was known besides."""


def place_mounting(comparison: Comparison, candidates: Collection[str], known: SensorModel = NOTHING_YET) -> Mounting:
    """The comparison with simulated frames as seen from where the sensor stood, if that is surely elsewhere: from each
    frame's own place where they are of other moments, else from the mounting that all share. That is told by effects
    among the `candidates` alone, or by those that are `known`, as they stand."""
    registered = comparison.registration
    if registered is None:
        return Mounting((), comparison, known)
    scan = comparison.scan
    if registered.early_or_late:
        # Frames' own places hold what the mounting is off by as well.
        again = brought(comparison, of_frames(registered.frames, rows=scan.range_m.shape[1]))
        return Mounting((), replace(again, as_read=scan), known)
    # A mounting is that of all frames: what acts in a part of them alone stays with what else is known.
    known_effects = {name for name, _ in known.effects} - {*known.regions}
    named = tuple(name for name in registered.sure if name in candidates)
    stated = tuple(name for name in registered.sure if name in known_effects)
    if not named and not stated:
        return Mounting((), comparison, known)
    # One mounting for all frames: what single frames differ by is noise of their registration.
    everywhere = np.repeat(registered.motion[None], len(scan.range_m), axis=0)
    motion = {k: v for k, v in of_frames(everywhere, rows=scan.range_m.shape[1]).items() if k in named}
    motion |= {name: _as_stated(name, known, scan) for name in stated}
    rest = replace(known, effects=tuple(pair for pair in known.effects if pair[0] not in stated))
    return Mounting(named, brought(comparison, motion), rest)


def how_placed(scenes: Sequence[str]) -> str:
    """How effects of a mounting were found on frames of these scenes, in words."""
    return f"{BY_RANGES}; {BY_FRAMES}" if sectors_a_drive(scenes) > 1 else BY_RANGES


def refine_lift(comparison: Comparison, mounting: Mounting, null: Problem, *, known: SensorModel) -> Mounting:
    """The mounting with the lift of its beams fitted to the likelihood of the null in which it is in place.

    A frame's own pose takes up what the registration left of a turn or a shift; a lift of all beams it cannot, and on
    the road a thirtieth of a milliradian is a centimetre at 25 m. `comparison` is that before anything was brought.
    """
    registered = comparison.registration
    if registered is None or "beam_elevation_error" not in mounting.effects:
        return mounting
    refit = fit(LIFT_OF_ALL, null)
    by = np.zeros(len(registered.motion))
    by[LIFT] = float(to_values(LIFT_OF_ALL, refit.z)["error_rad"])
    finer = replace(registered, motion=registered.motion + by, frames=registered.frames + by)
    return place_mounting(replace(comparison, registration=finer), mounting.effects, known)


def brought(comparison: Comparison, effects: EffectValues) -> Comparison:
    """The comparison with its simulated frames as seen from where a sensor stands on which these effects act
    (`seen_from`)."""
    moved, told = seen_from(comparison.scan, effects)
    return replace(
        comparison,
        scan=moved,
        told=told if comparison.told is None else told & comparison.told,
        # Lifted beams meet the steps to their sides where they were.
        between_unknown=comparison.between_unknown or {*effects} != {"beam_elevation_error"},
        lattices=comparison.lattices or lattices_of(comparison.scan),
    )


def seen_from(scan: Scan, effects: EffectValues) -> tuple[Scan, Bool[np.ndarray, "f r n"]]:
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


def brought_back(exchanged: Comparison) -> Comparison:
    """Exchanged sides of other moments: the measured frames, in the place of the simulated ones, as seen from where
    these stood, against these as they were read."""
    was, registered = exchanged.as_read, exchanged.registration
    assert was is not None, "frames of one moment are exchanged as they are"
    assert registered is not None, "frames were brought elsewhere without a registration"
    scan = jax.tree.map(np.asarray, exchanged.scan)
    slopes = [np.asarray(slopes_of(scan.grid, r, h)) for r, h in zip(scan.range_m, scan.hit, strict=True)]
    # The inverse of a motion to first order: of 3 m and half a degree 3 cm are left, which frames' own poses take up.
    back = of_frames(-registered.frames, rows=scan.range_m.shape[1])
    moved, told = seen_from(replace(scan, slopes=np.stack(slopes)), back)
    hit = np.asarray(was.hit)
    read = Measured(np.where(hit, was.range_m, 0), np.where(hit, was.intensity, 0), hit)
    return replace(exchanged, scan=moved, measured=read, told=told)


@jax.jit
def _met(scan: Scan, index: RayIndex, effects: dict[str, dict[str, Array]]) -> dict[str, Array]:
    """The rasters of the surfaces that displaced rays meet, columns before rows."""
    rays = rays_at(scan, index)
    for name, values in effects.items():
        rays = get_effect(name).apply(values, rays)
    told = is_told(rays, scan)
    rays = recast(rays, scan)
    intensity = jnp.where(rays.hit, jnp.exp(rays.log_intensity), 0)
    return {name: getattr(rays, name) for name in OF_SURFACE} | {"intensity": intensity, "told": told}


def of_frames(motion: Float[np.ndarray, "f 8"], *, rows: int) -> EffectValues:
    """Frames' motions as parameters of the effects of MOTION_PARTS."""
    # Beams are of the sensor: they cannot differ from frame to frame.
    lift = np.full(rows, np.median(motion[:, LIFT]))
    return {**as_effects(motion), "beam_elevation_error": {"error_rad": lift}}


def _as_stated(name: str, known: SensorModel, scan: Scan) -> dict[str, Float[np.ndarray, " k"]]:
    """An effect's parameters as a sensor model has them, for every frame, or beam."""
    frames, rows, _ = scan.range_m.shape
    values = EFFECTS[name].values(dict(known.effects)[name], rows)
    return {key: np.broadcast_to(value, rows if np.ndim(value) else frames) for key, value in values.items()}


def parameters(registered: Registration, effect: str) -> dict[str, Interval]:
    """The parameters of an effect of a mounting, with intervals, within the catalogue's bounds; beams' is that of
    each."""
    values = as_effects(registered.motion)[effect].items()
    halves = registered.half[MOTION_PARTS[effect]].tolist()
    return {
        name: Interval.about(float(value), half, "").within(EFFECTS[effect].parameters[name])
        for (name, value), half in zip(values, halves, strict=True)
    }


def registered_of(comparison: Comparison) -> Registered | None:
    """What a verdict says of the registration."""
    registered = comparison.registration
    if registered is None:
        return None
    near = [float(np.median(share)) for share in (registered.near_as_given, registered.near)]
    predicted = registered.given_m, registered.predicted_m
    off_m = [float(np.nanmedian(np.abs(range_m - registered.measured_m))) for range_m in predicted]
    return Registered(
        motion={
            key: value
            for name in MOTION_PARTS
            if name != "beam_elevation_error" or name in registered.sure
            for key, value in parameters(registered, name).items()
        },
        sure=registered.sure,
        other_moments=registered.early_or_late,
        near=(near[0], near[1]),
        off_m=(off_m[0], off_m[1]),
        speeds=comparison.speeds,
    )


def named_mounting(mounting: Mounting, parts: Split, *, rows: int) -> tuple[tuple[Named, ...], tuple[Named, ...]]:
    """The effects of a mounting that are confirmed on judge scenes, and those that are not, for a sensor of so many
    beams."""
    registered = mounting.comparison.registration
    confirmed: list[Named] = []
    unconfirmed: list[Named] = []
    if registered is None:
        return (), ()
    for name in mounting.effects:
        on_find, on_judge = gains(registered.frames, MOTION_PARTS[name], scenes=mounting.comparison.scenes, parts=parts)
        gain = clipped(on_find)
        values = parameters(registered, name)
        of_beams = [key for key in values if EFFECTS[name].parameters[key].shape == "row"]
        vectors = {key: (values[key],) * rows for key in of_beams}
        nats = Interval.of_scenes(gain, "nats per scene")
        effect = Named.alone(name, p_value(gain), nats, parameters=values | vectors)
        # What every other name is asked: the signs of find scenes, the bar, and judge scenes.
        sure = effect.p_value <= RULES.agreement_level and gain.sum() > RULES.bar_nats
        (confirmed if sure and mean_interval(on_judge)[0] > 0 else unconfirmed).append(effect)
    return tuple(confirmed), tuple(unconfirmed)


def gains(
    motion: Float[np.ndarray, "f 8"], part: slice, *, scenes: Sequence[str], parts: Split
) -> tuple[Float[np.ndarray, " s"], Float[np.ndarray, " t"]]:
    """Nats that find scenes gain, each by the poses of the other find scenes, and judge scenes by those of all find
    scenes. Of few drives, which are cut into sectors, frames find and judge in turn."""
    names = np.asarray(scenes)
    find = list(parts.find)
    judged = list(parts.judge)
    # Sectors of a drive share the sensor's motion: only frames are as good as independent here.
    if sectors_a_drive(scenes) > 1:
        names = np.arange(len(motion)).astype(str)
        judged = list(names[::3])
        find = [name for name in names if name not in judged]
    # In standard deviations of what a frame's own pose may be off by, so that squares are nats.
    z = motion[:, part] / POSE_AND_LIFT_SD[part]

    def gain(scene: str, by: Sequence[str]) -> float:
        if not by:
            # With no other frame there is nothing that it could bear out.
            return 0.0
        poses = z[names == scene]
        # The median: a frame that was registered to another valley must not name a mounting.
        middle = np.median(z[np.isin(names, by)], axis=0)
        return 0.5 * float(np.sum(poses**2 - (poses - middle) ** 2))

    held_out = [gain(scene, [other for other in find if other != scene]) for scene in find]
    return np.array(held_out or [0.0]), np.array([gain(scene, find) for scene in judged])
