"""What a simulator means, behind noise of its own: its level of noise from its frames alone, and frames without it.

A simulator that adds noise (CARLA, Isaac, Gazebo and RGL do when asked) or learned from noisy drives is a noisy reading
of what it means. Regressed on a noisy predictor, what was measured follows it too weakly (errors in variables; Fuller
1987), and every effect that bends intensities would explain that. So the detail within a surface is shrunk to the share
that is not noise (regression calibration; Carroll, Ruppert, Stefanski, Crainiceanu 2006), and how far the sensor
follows the rest is left to a nuisance (`Evidence.features`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from flax import struct
from jaxtyping import Bool, Float, Int

from jaxsim.discover.model.cast import RayIndex, Surfaces
from jaxsim.discover.model.contrast import class_trend, contrast_of, within_classes
from jaxsim.discover.model.noise_levels import BINS, Levels, cosine_of, filled, lattices_of
from jaxsim.discover.model.own_noise import own_levels
from jaxsim.discover.model.smooth import Smooth, Smoothing, smooth_frames
from jaxsim.discover.rules import RULES
from jaxsim.effects.rays import FLOOR, Scan
from jaxsim.effects.scan import slopes_of
from jaxsim.frame import Array

NORMAL = 0.86
"""Scale that normal noise of standard deviation 1 adds, in squares, to a Student-t of 4 degrees that is fitted to the
sum: 0.89 where the noise is weak, 0.83 where it is all."""
SLOPE_SD = 0.15
"""Of how much more, or less, than what an ideal simulator says of surfaces within a class the measured intensity
follows it (a judgement, not calibrated). Its tables have materials, and each thing, a little too dark or too bright,
beside differences not much larger: that flattens the slope, and is no law of the sensor ..."""
DETAIL_SD = 1.0
"""... and how much more, or less, than the detail of one with noise, or of free contrast."""
UNUSUAL = 0.5
"""Nats by which a surface is clearly darker or brighter than is usual of its class: three times what noise leaves on
the darkest that are compared (a judgement, not calibrated)."""
TREND_RAYS = 200_000
"""Rays of all frames by which the trend of classes is told, fewer than twice as many: their noise is then gone ..."""
TREND_NOISE = 0.3
"""... and their relative noise, at most: the mean of a logarithm lies too low by hardly more than half its square."""


@dataclass(frozen=True)
class MeantRanges:
    """What noise leaves of ranges that were made smooth."""

    variance: Float[Array, "f r c"]
    """Squared standard deviation that is left, m^2."""
    planes_rad: Float[Array, "f r c"]
    """Incidence on the planes through them."""


@dataclass(frozen=True)
class MeantIntensities:
    """What noise leaves of intensities that were made smooth."""

    detail: Float[Array, "f r c"]
    """Intensity of each ray over its surface's beside it, less 1, as the simulator has it, noise and all."""
    detail_variance: Float[Array, "f r c"]
    """Squared standard deviation of the detail that is meant about its trusted share, nats^2."""
    trusted: Bool[Array, "f r c"]
    """Where enough of the surface lies beside a ray to say what is meant."""
    level: Float[Array, "f r c"]
    """ln I of each ray's surface beside it."""
    leverage: Float[Array, "f r c"]
    """Variance that noise gives `level` over that of one ray."""


@dataclass(frozen=True)
class Meant:
    """A simulator's frames as it means them; without noise the very frames."""

    scan: Scan
    noise: Levels
    """The simulator's."""
    measured_noise: Levels
    """The sensor's own, by the same rule: real texture counts as noise where it is as fine as the rays."""
    ranges: MeantRanges | None = None
    """None where ranges are not noisy."""
    intensities: MeantIntensities | None = None
    """None where intensities are not noisy."""
    free_contrast: bool = False
    """Whether how far the sensor follows the contrast of intensities without noise is left to a nuisance."""

    @classmethod
    def as_said(cls, scan: Scan) -> Meant:
        """A simulator without noise, which means what it says."""
        return cls(scan, lattices_of(scan), Levels())

    @property
    def noisy(self) -> bool:
        """Whether the simulator's readings have noise of their own."""
        return self.ranges is not None or self.intensities is not None


def meant(
    scan: Scan,
    *,
    range_m: Float[Array, "f r c"],
    intensity: Float[Array, "f r c"],
    valid: Bool[Array, "f r c"],
    noises: tuple[Levels, Levels] | None = None,
) -> Meant:
    """The frames that a simulator means, and the noise on them; the other three are what the sensor read.

    Rays lost within a surface are put back, ranges and intensities made smooth within each surface. `noises` are the
    simulator's and the sensor's noise where other frames have told them.
    """
    measured = replace(scan, range_m=range_m, intensity=intensity, hit=valid)
    noise, measured_noise = noises or own_levels(scan, measured)
    ranges, intensities = None, None
    if noise.loss > 0:
        scan = filled(scan)
    if noise.range_m > 0 or noise.of_intensity:
        smooth = smooth_frames(scan, Smoothing.of(scan, noise))
        if noise.incidence_rad > 0:
            # Noise on angles would pass for a wrong cosine.
            scan = replace(scan, incidence_rad=smooth.incidence_rad)
        if noise.range_m > 0:
            ranges = MeantRanges(noise.range_m**2 * smooth.range_leverage, smooth.plane_rad)
            scan = replace(scan, range_m=smooth.range_m)
        if noise.of_intensity:
            scan, intensities = _meant_intensities(scan, smooth, noise)
    if ranges is not None or noise.loss > 0:
        # Slopes of surfaces follow from ranges, which have changed.
        slopes = [slopes_of(scan.grid, r, h) for r, h in zip(scan.range_m, scan.hit, strict=True)]
        scan = replace(scan, slopes=jnp.stack(slopes))
    return Meant(scan, noise, measured_noise, ranges, intensities)


def _meant_intensities(scan: Scan, smooth: Smooth, noise: Levels) -> tuple[Scan, MeantIntensities]:
    """The scan with the detail within surfaces shrunk to the share that is not noise."""
    detail = np.asarray(smooth.detail)
    level = np.asarray(smooth.albedo) * (cosine_of(scan) if noise.follows_cosine else 1.0)
    # At the level of the surface, not of the ray: the noisy ray itself would be weighed by its own error.
    variance = noise.variance(level)
    trusted = np.asarray(scan.hit & smooth.trusted)
    trust = reliability(detail, variance, level, semantic=np.asarray(scan.semantic), where=trusted)
    intensities = MeantIntensities(
        detail=smooth.detail,
        detail_variance=jax.device_put(np.asarray(variance * trust * (1 - trust), np.float32)),
        trusted=smooth.trusted,
        level=_log(jax.device_put(np.asarray(level, np.float32))),
        leverage=smooth.leverage,
    )
    return replace(scan, intensity=jax.device_put(np.asarray(level * np.exp(trust * detail), np.float32))), intensities


def _log(level: Float[Array, "f r c"]) -> Float[Array, "f r c"]:
    """The natural logarithm of an intensity, or of FLOOR where that is more."""
    return jnp.log(jnp.maximum(level, FLOOR))


@struct.dataclass
class AtRays:
    """What is known of the simulator's own noise, at the chosen rays."""

    detail: Float[Array, "b c r k"]
    """What `within_classes` says, and of a noisy simulator ln I over the surface beside a ray, and of that surface over
    the trend of all its rays; or what `contrast_of` says, where contrast is left free."""
    excess: Float[Array, "#b #c #r"]
    """What noise adds to ln I, by the best guess."""
    over_usual: Float[Array, "#b #c #r"]
    """ln I, as it is then left, over what is usual of the class at the ray's angle and range; 0 where it is clearly
    another than that (UNUSUAL)."""
    variance: Float[Array, "#b #c #r"]
    range_variance: Float[Array, "#b #c #r"]
    trusted: Bool[Array, "#b #c #r"]
    log_kept: Float[Array, ""]
    step: Float[Array, " 2"]
    constant: Float[Array, ""]
    """Noise on the sensor's intensities that is the same for all ..."""
    own_constant: Float[Array, ""]
    """... and on the simulator's."""
    detail_sd: tuple[float, ...] = struct.field(pytree_node=False, default=())
    """Prior standard deviation of the slope of the measured detail over `detail`, about 1, of each."""
    scales: tuple[str, ...] = struct.field(pytree_node=False, default=())
    """Names of `detail` (`contrast.Contrasts`), where that is left free."""


def at_rays(
    scan: Scan, index: RayIndex, *, surfaces: Surfaces, given_rad: Float[Array, "f r n"], simulator: Meant
) -> AtRays:
    """What is known of the simulator's own noise, at the rays of `index`."""
    noise, ranges = simulator.noise, simulator.ranges
    nothing = np.zeros((1, 1, 1), np.float32)
    simulated = AtRays(
        detail=np.zeros((*np.asarray(index[0]).shape, 0), np.float32),
        excess=nothing,
        over_usual=nothing,
        variance=nothing,
        range_variance=nothing if ranges is None else NORMAL**2 * np.asarray(ranges.variance)[index],
        # Without noise every ray is trusted.
        trusted=nothing == 0,
        log_kept=np.float32(np.log1p(-noise.loss)),
        step=np.array([noise.intensity_step, noise.range_step_m], np.float32),
        constant=np.float32(simulator.measured_noise.intensity),
        own_constant=np.float32(noise.intensity),
    )
    if simulator.intensities is None and simulator.free_contrast:
        contrast = contrast_of(scan, index, given_rad=given_rad)
        return _with_detail(simulated, contrast.nats, sd=DETAIL_SD, scales=contrast.scales)
    within = within_classes(scan, index, given_rad=given_rad)
    simulated = _with_detail(simulated, within.nats, sd=SLOPE_SD)
    if simulator.intensities is None:
        return simulated
    intensities = simulator.intensities
    trusted = np.asarray(intensities.trusted)[index]
    level = np.asarray(intensities.level)[index].astype(float)
    semantic = np.asarray(scan.semantic)[index]
    surface = np.asarray(surfaces.surface)[np.asarray(surfaces.strip)]
    expected = level.copy()
    expected[trusted] = trend(
        level[trusted],
        semantic=semantic[trusted],
        surface=surface[trusted],
        incidence_rad=np.asarray(given_rad)[index][trusted],
        range_m=np.asarray(scan.range_m)[index][trusted],
    )
    over_trend = level - expected
    # By what is expected, not by what is read, which would take the darker of the noisy levels for dark surfaces.
    variance = noise.variance(np.exp(expected)) * np.asarray(intensities.leverage)[index]
    # The same question once more, between surfaces: how much of a surface's own brightness is its noise.
    trust = reliability(over_trend, variance, np.exp(expected), semantic=semantic, where=trusted)
    off = _off_trend(scan, index, given_rad=given_rad, intensities=intensities, noise=noise)
    excess = (1 - trust) * over_trend - off
    predicted = np.log(np.maximum(np.asarray(scan.intensity)[index], FLOOR)) - excess
    usual = predicted.copy()
    usual[trusted] = class_trend(
        predicted[trusted],
        semantic=semantic[trusted],
        # On the planes through the ranges, whose errors no intensity follows.
        incidence_rad=np.asarray(scan.incidence_rad)[index][trusted],
        range_m=np.asarray(scan.range_m)[index][trusted],
    )
    over_usual = predicted - usual
    # How far noise hides what is meant differs between bright and dark surfaces.
    dark = noise.constant_part(np.exp(expected))
    own_detail = np.asarray(intensities.detail)[index]
    detail = np.stack([own_detail * (1 - dark), own_detail * dark, over_trend], axis=-1)
    return replace(
        _with_detail(simulated, np.where(trusted[..., None], detail, 0).astype(np.float32), sd=DETAIL_SD),
        excess=excess.astype(np.float32),
        over_usual=np.where(np.abs(over_usual) < UNUSUAL, over_usual, 0).astype(np.float32),
        # What is not trusted is compared nowhere, and its variance may be without bound.
        variance=np.asarray(intensities.detail_variance)[index]
        + np.multiply(variance, trust, where=trusted, out=np.zeros(variance.shape, np.float32), casting="same_kind"),
        trusted=trusted,
    )


def _off_trend(
    scan: Scan, index: RayIndex, *, given_rad: Float[Array, "f r n"], intensities: MeantIntensities, noise: Levels
) -> Float[np.ndarray, "b c r"]:
    """Nats by which rays that were smoothed lie below what the simulator says of their class at their angle and range.

    Noise leaves the mean of many rays as it is. Smoothing over materials does not: where a class has other ones that
    are seen steeply than aslant, it would pass for a wrong cosine.
    """
    every = np.asarray(scan.hit & intensities.trusted) & (np.asarray(given_rad) < RULES.compared_below_rad)
    every = tuple(place[:: max(1, every.sum() // TREND_RAYS)] for place in np.nonzero(every))
    level = np.asarray(intensities.level)[every].astype(float)
    of_trend = {"semantic": scan.semantic, "incidence_rad": given_rad, "range_m": scan.range_m}
    of_trend = {name: np.asarray(values) for name, values in of_trend.items()}
    here = {name: values[every] for name, values in of_trend.items()}
    # The mean of a noisy logarithm lies below the logarithm of what is meant by half the relative variance. Rays that
    # are mostly noise say nothing; they are told by what is usual, for by their own level noise would choose them.
    variance = noise.variance(np.exp(class_trend(level, **here)))
    said = level + np.log(np.maximum(1 + np.asarray(intensities.detail)[every], FLOOR)) + 0.5 * variance
    off = said - np.log(np.maximum(np.asarray(scan.intensity)[every], FLOOR))
    at = {name: values[index].ravel() for name, values in of_trend.items()}
    both = {name: np.concatenate([here[name], at[name]]) for name in at}
    # A reading that is off by more than such noise is of another material, and that of nothing has no logarithm.
    tells = (variance < TREND_NOISE**2) & (np.abs(np.asarray(intensities.detail)[every]) < 3 * TREND_NOISE)
    telling = np.concatenate([tells, np.zeros(at["range_m"].size, bool)])
    nats = class_trend(np.concatenate([off, np.zeros(at["range_m"].size)]), **both, telling=telling)
    return nats[len(off) :].reshape(np.asarray(index[0]).shape)


def _with_detail(known: AtRays, detail: Float[np.ndarray, "b c r k"], *, sd: float, **more: Any) -> AtRays:
    """What is known, with more columns of detail, of one standard deviation."""
    columns = np.concatenate([known.detail, detail], axis=-1)
    return replace(known, detail=columns, detail_sd=(*known.detail_sd, *[sd] * detail.shape[-1]), **more)


def reliability(
    detail: Float[np.ndarray, "*n"],
    variance: Float[np.ndarray, "*n"],
    level: Float[np.ndarray, "*n"],
    *,
    semantic: Int[np.ndarray, "*n"],
    where: Bool[np.ndarray, "*n"],
) -> Float[np.ndarray, "*n"]:
    """Share of the variance of `detail` that is not noise of the given `variance`, by class and by the surfaces'
    intensity `level` (Fuller's reliability ratio); 0 for classes of which too few rays count to say."""
    share = np.zeros(detail.shape, np.float32)
    for kind in np.unique(semantic[where]):
        of = where & (semantic == kind)
        if of.sum() < RULES.fewest_of_class:
            continue
        # Noise hides more of dark surfaces than of bright ones: one share for all would leave both wrong.
        order = np.argsort(level[of])
        bins = np.array_split(order, max(1, min(BINS, len(order) // RULES.fewest_differences)))
        at = np.array([np.median(level[of][b]) for b in bins])
        total = np.array([np.mean(detail[of][b] ** 2) for b in bins])
        noise = np.array([np.mean(variance[of][b]) for b in bins])
        share[of] = np.interp(level[of], at, np.clip(1 - noise / np.maximum(total, 1e-9), 0, 1))
    return share


def trend(
    level: Float[np.ndarray, " n"],
    *,
    semantic: Int[np.ndarray, " n"],
    surface: Int[np.ndarray, " n"],
    incidence_rad: Float[np.ndarray, " n"],
    range_m: Float[np.ndarray, " n"],
) -> Float[np.ndarray, " n"]:
    """What the simulator says of ln I by class, angle and range, and by the mean of each surface: of so many rays that
    their noise is gone."""
    result = class_trend(level, semantic=semantic, incidence_rad=incidence_rad, range_m=range_m)
    # A surface's mean residual is its own brightness; what single rays have beyond it is noise or detail.
    _, at = np.unique(surface, return_inverse=True)
    return result + (np.bincount(at, level - result) / np.bincount(at))[at]
