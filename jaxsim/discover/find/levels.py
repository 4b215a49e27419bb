"""Levels: noise, losses and lattices of both sides, and what of them the simulator lacks.

No discovery: every sensor has noise, and a simulator may leave it out on purpose. Each level is told from the frames of
its own side (`model.noise_levels`), scene by scene; the interval is that of the scatter between scenes.
Differences are of variances: noise that both sides have is not missing.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace

import jax
import numpy as np
from jaxtyping import Bool, Float

from jaxsim.discover.model.evidence import Evidence
from jaxsim.discover.model.noise_levels import Levels, noise_levels, on_lattices, range_bends
from jaxsim.discover.read import Comparison
from jaxsim.discover.rules import RULES
from jaxsim.discover.verdict import Interval, Level
from jaxsim.effects.rays import FLOOR, Scan
from jaxsim.metrics.intervals import mean_interval

MEASURES = {
    "range_noise": ("range_m", "m"),
    "intensity_noise": ("intensity_share", "share of the intensity"),
    "intensity_noise_constant": ("intensity", ""),
    "random_loss": ("loss", "share of the rays"),
    "intensity_step": ("intensity_step", ""),
    "range_step": ("range_step_m", "m"),
}
"""Levels by the name that a verdict gives them: field of `Levels`, and unit."""
LATTICES = ("intensity_step", "range_step")
USUAL = {
    "range_noise": RULES.usual_range_noise_m,
    "intensity_noise": RULES.usual_intensity_noise,
    "random_loss": RULES.usual_random_loss,
}


def compare_levels(comparison: Comparison) -> tuple[Level, ...]:
    """The levels of both sides, and what the simulator lacks of them.

    A sensor's intensity noise holds texture of surfaces that is finer than the rays, for no frame tells the two apart.
    """
    simulated = _by_scene(comparison, comparison.scan)
    if comparison.lattices is not None:
        simulated = [on_lattices(of_scene, comparison.lattices) for of_scene in simulated]
    measured = _by_scene(comparison, _as_measured(comparison))
    return tuple(
        _compared(
            name,
            unit,
            simulated=[getattr(of_scene, field) for of_scene in simulated],
            measured=[getattr(of_scene, field) for of_scene in measured],
        )
        for name, (field, unit) in MEASURES.items()
    )


def range_noise_grows(comparison: Comparison) -> bool:
    """Whether the sensor's noise of the range, beside the simulator's, grows as echoes weaken, by what neighbouring
    readings differ: in the mean of the scenes, for certain.

    What a simulator does not know of grazing ground and of poses moves whole surfaces, and hardly neighbours. Beside
    one without noise only planes are asked: leaves and heaps, of which more are far off, differ from ray to ray as
    noise does, and with noise on top by more than both alone.
    """
    range_m = np.maximum(comparison.scan.range_m, RULES.finest_step)
    power = np.log(np.maximum(comparison.scan.intensity, FLOOR)) - 2 * np.log(range_m)
    ends = np.quantile(power[np.asarray(comparison.scan.hit)], [1 / 3, 2 / 3])

    def variance(side: Scan, part: Bool[np.ndarray, "f r c"]) -> Float[np.ndarray, " s"]:
        """The noise of each scene's ranges, in a part of the rays."""
        noise = _by_scene(comparison, replace(side, hit=np.asarray(side.hit) & part))
        return np.square([of_scene.range_m for of_scene in noise])

    simulated, measured = comparison.scan, _as_measured(comparison)
    sensor_m = noise_levels(measured).range_m
    ideal = noise_levels(simulated).range_m < RULES.ideal_noise * sensor_m
    plane = np.abs(range_bends(simulated)) < RULES.plane_noise * sensor_m if ideal else np.ones(power.shape, bool)
    weak, strong = plane & (power < ends[0]), plane & (power > ends[1])
    grown = variance(measured, weak) - RULES.noise_growth * variance(measured, strong)
    # What grows on both sides is the surfaces' own.
    low, _ = mean_interval(grown - variance(simulated, weak) + variance(simulated, strong))
    return low > 0


def made_by(before: Evidence, after: Evidence) -> dict[str, float]:
    """Levels that effects make of their own, by name: what they change from `before` to `after` they are in place, at
    the median echo. (A gate or a sector loses some rays and leaves the others: that is no loss at random.)"""
    hit = np.asarray(before.rays.hit) & np.asarray(after.rays.hit)
    if not hit.any():
        return {}
    kept = np.asarray(after.rays.log_keep, np.float64) - np.asarray(before.rays.log_keep, np.float64)
    noise_m = np.broadcast_to(np.asarray(after.rays.noise_m), hit.shape)
    return {
        "range_noise": float(np.median(noise_m[hit])),
        "random_loss": float(np.median(-np.expm1(np.broadcast_to(kept, hit.shape)[hit]))),
    }


def missing(levels: tuple[Level, ...], made: Mapping[str, float] | None = None) -> dict[str, float]:
    """What a sensor model adds to a simulation besides its effects, by name: the levels that the simulator lacks for
    certain, less what the effects have `made` of them already."""
    result = {}
    for level in levels:
        by_effects = (made or {}).get(level.name, 0.0)
        if level.missing.low > by_effects:
            power = power_of(level.name)
            result[level.name] = (level.missing.value**power - by_effects**power) ** (1 / power)
    return result


def power_of(name: str) -> int:
    """Variances of independent noise add up; so do small probabilities of loss."""
    return 1 if name == "random_loss" else 2


def _as_measured(comparison: Comparison) -> Scan:
    """The sensor's readings with the simulator's surfaces."""
    measured = comparison.measured
    return replace(comparison.scan, range_m=measured.range_m, intensity=measured.intensity, hit=measured.valid)


def _by_scene(comparison: Comparison, scan: Scan) -> list[Levels]:
    """Levels of each scene, or of each frame where all are of one."""
    scenes = np.asarray(comparison.scenes)
    # Scenes of several frames give one number each: frames of a scene are no independent witnesses.
    groups = scenes if len(set(scenes)) > 1 else np.arange(len(scenes))
    return [noise_levels(_frames(scan, groups == group)) for group in dict.fromkeys(groups)]


def _frames(scan: Scan, keep: np.ndarray) -> Scan:
    """Some frames of a scan."""
    rasters = {f.name: getattr(scan, f.name) for f in fields(scan) if f.name != "grid"}
    return replace(scan, **jax.tree.map(lambda raster: jax.device_put(np.asarray(raster)[keep]), rasters))


def _compared(name: str, unit: str, *, simulated: list[float], measured: list[float]) -> Level:
    ours, theirs = np.array(simulated, float), np.array(measured, float)
    if name in LATTICES:
        # A lattice is one for all scenes, or none; where they disagree, there is none to speak of.
        lattice = [_only(side) for side in (ours, theirs)]
        lacking = lattice[1] if lattice[1] > RULES.coarser_step * lattice[0] else 0.0
        sides = [Interval.exact(v, unit) for v in (*lattice, lacking)]
        return Level(name, simulated=sides[0], measured=sides[1], missing=sides[2], beyond_usual=False)
    power = power_of(name)
    lacks = _root_of_mean(theirs**power - ours**power, power, unit)
    usual = USUAL.get(name, np.inf)
    sides = [_root_of_mean(side**power, power, unit) for side in (ours, theirs)]
    return Level(name, sides[0], sides[1], lacks, beyond_usual=bool(lacks.low > usual))


def _root_of_mean(powers: Float[np.ndarray, " s"], power: int, unit: str) -> Interval:
    """Mean level of its powers in scenes; of noise, the root of the mean variance."""
    return Interval(*[max(v, 0.0) ** (1 / power) for v in (float(powers.mean()), *mean_interval(powers))], unit=unit)


def _only(steps: Float[np.ndarray, " s"]) -> float:
    """The step of most scenes; 0 where they differ by more than rounding."""
    middle = float(np.median(steps))
    return middle if np.mean(np.isclose(steps, middle, rtol=RULES.lattice_near)) > RULES.most_frames else 0.0
