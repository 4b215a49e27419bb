"""What two folders must fulfil to be compared: units, one grid, and the same streets under the same names.

A pair of frames agrees on a ray where both sides return within 0.5 m or 5 % of each other. Every effect of the
catalogue leaves most rays so, but for rain and fog, whose returns all lie before the surface: a ray that goes on beyond
the simulated surface is another matter. Of frames of other streets the road still agrees.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Collection, Hashable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from jaxsim.data.polar_frames import PolarFrames
from jaxsim.discover.read.registration import Registration
from jaxsim.discover.rules import RULES
from jaxsim.discover.scenes import rank_correlation
from jaxsim.frame import PolarGrid, PolarImage
from jaxsim.geometry import grid_difference, incidence

_Sides = tuple[Mapping[str, bytes], Mapping[str, bytes]]
"""`readings_of` simulated and measured frames, by name."""
_Levels = Sequence[tuple[float, float]]
"""`levels_of` the frames of one side."""
RAYS_OF_FRAME = 2000
"""Rays looked at in each frame."""
OTHERS = 64
"""Other frames with which each is compared."""
ADVICE = (
    "check that names pair the same moments, that both sides use the same axes and mounting (more than 2 "
    "degrees or 0.5 m off are too many), or, if they show different streets, use --unpaired"
)
RASTERS = ("semantic", "instance", "incidence", "rgb", "time")
"""What the simulated side may have besides range and intensity."""
REARRANGED: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "rows from the bottom up": lambda raster: raster[::-1],
    "columns from right to left": lambda raster: raster[:, ::-1],
    "columns half a turn on": lambda raster: np.roll(raster, raster.shape[1] // 2, axis=1),
}
"""Orders in which one side may be written by mistake, in words."""


def plausible(name: str, image: PolarImage, side: str) -> None:
    """Raises ValueError for a frame that is empty, dark, or not in metres."""
    valid = np.asarray(image.valid)
    if valid.mean() < RULES.fewest_returns:
        raise ValueError(
            f"discover: {side} frame {name} is empty: {valid.sum()} of {valid.size} rays returned; leave it out"
        )
    check_units(name, image, side)


def check_units(name: str, image: PolarImage, side: str) -> None:
    """Raises ValueError for a frame with returns that is dark, or not in metres."""
    valid = np.asarray(image.valid)
    range_m, intensity = np.asarray(image.range_m)[valid], np.asarray(image.intensity)[valid]
    if np.median(range_m) > RULES.farthest_m:
        raise ValueError(
            f"discover: {side} frame {name} has a median range of {np.median(range_m):.0f}; ranges are metres: divide "
            "millimetres by 1000, centimetres by 100"
        )
    if np.median(range_m) < RULES.nearest_m:
        raise ValueError(
            f"discover: {side} frame {name} has a median range of {np.median(range_m):.3g}; ranges are metres: "
            "multiply kilometres by 1000"
        )
    if not intensity.any():
        raise ValueError(f"discover: {side} frame {name} has intensity 0 everywhere; there is nothing to compare")


def check_one_grid(simulated: PolarFrames, measured: PolarFrames) -> None:
    """Raises ValueError where two folders' grids differ."""
    if difference := grid_difference(simulated.grid, measured.grid):
        raise ValueError(
            f"discover: the grids of {simulated.folder} and {measured.folder} differ in {difference}; simulate on the "
            "measured sensor's grid.json"
        )


def check_no_copies(simulated: PolarFrames, measured: PolarFrames, *, sides: _Sides, allowed: int = 0) -> None:
    """Raises ValueError where more measured frames than are `allowed` hold the readings of a simulated one."""
    ours, theirs = sides
    seen = {readings: name for name, readings in ours.items()}
    copies = [(seen[readings], name) for name, readings in theirs.items() if readings in seen]
    if len(copies) > allowed:
        first, second = copies[0]
        raise ValueError(
            f"discover: {first} of {simulated.folder} and {second} of {measured.folder} hold the same readings; "
            "compare a simulation with a sensor"
        )


def _copies(readings: Mapping[str, Hashable]) -> Iterator[tuple[str, str]]:
    """Gives each frame that holds what one before it does, behind the first that does."""
    seen: dict[Hashable, str] = {}
    for name, digest in readings.items():
        if (first := seen.setdefault(digest, name)) != name:
            yield first, name


def check_all_differ(folder: Path, readings: Mapping[str, bytes]) -> None:
    """Raises ValueError where two frames (of `folder`) hold the same readings."""
    for first, name in _copies(readings):
        raise ValueError(
            f"discover: {first} and {name} of {folder} hold the same readings to the last digit; one is a copy: leave "
            "it out, or put back what it was"
        )


def check_no_doubles(folder: Path, sides: _Sides) -> None:
    """Raises ValueError where two measured frames (of `folder`) hold the same readings, and their simulated partners do
    not: a sensor's noise makes each frame its own."""
    simulated, measured = sides
    for first, name in _copies(measured):
        if simulated[first] != simulated[name]:
            raise ValueError(
                f"discover: {first} and {name} of {folder} hold the same readings to the last digit, and their "
                "simulated frames differ; one is a copy: leave it out, or put back what it was"
            )


def doubles(sides: _Sides) -> dict[str, str]:
    """Gives the frames that hold on both sides what another one does, and why they are none."""
    simulated, measured = sides
    both = {name: (simulated[name], measured[name]) for name in measured}
    return {name: f"{name} holds the readings of {other} on both sides: a copy" for other, name in _copies(both)}


def check_sides(simulated: Path, measured: Path, *, rasters: tuple[Collection[str], Collection[str]]) -> None:
    """Raises ValueError where measured frames tell angles of incidence and simulated ones do not: a sensor knows none.
    `rasters` are the names of the further ones of the simulated and of the measured frames."""
    known, by_sensor = rasters
    if "incidence" in by_sensor and "incidence" not in known:
        raise ValueError(
            f"discover: frames of {measured} tell the incidence of every ray, which no sensor knows, and those of "
            f"{simulated} do not; exchange --measured and --simulated, or take `incidence` out of the measured frames"
        )


def check_incidence(name: str, image: PolarImage, *, angle_rad: Float[np.ndarray, "r c"], grid: PolarGrid) -> None:
    """Raises ValueError for angles of incidence that fall where the range image says that they grow, as cosines do."""
    of_ranges, is_known = incidence(image.range_m, image.valid, grid)
    known = np.asarray(is_known)
    if known.sum() < RULES.fewest_residuals or np.ptp(angle_rad[known]) == 0:
        return
    if rank_correlation(np.asarray(of_ranges)[known], angle_rad[known]) < RULES.reversed_incidence:
        raise ValueError(
            f"discover: the incidence of {name} falls where its range image says that surfaces turn away; it must be "
            "the angle between ray and surface normal in radians, 0 head on to pi/2: take arccos of cosines"
        )


def check_instances(name: str, image: PolarImage, *, rasters: Mapping[str, np.ndarray]) -> None:
    """Raises ValueError where a number of an object stands for all that is none: for much of a frame, of several
    classes."""
    if not {"instance", "semantic"} <= {*rasters}:
        return
    back = np.asarray(image.valid)
    numbers, count = np.unique(np.asarray(rasters["instance"])[back], return_counts=True)
    for number in numbers[(numbers != 0) & (count > RULES.background_share * count.sum())]:
        classes, rays = np.unique(
            np.asarray(rasters["semantic"])[back & (rasters["instance"] == number)], return_counts=True
        )
        if np.sum(rays > RULES.background_class_share * rays.sum()) > 1:
            raise ValueError(
                f"discover: instance {number} of {name} holds {100 * rays.sum() / count.sum():.0f} % of its rays, of "
                f"{len(classes)} classes: what is no object is 0; write it there"
            )


def readings_of(image: PolarImage) -> bytes:
    """A digest of a frame's ranges and intensities, which differs where a digit of them does."""
    return hashlib.blake2b(image.range_m.tobytes() + image.intensity.tobytes(), digest_size=16).digest()


def all_or_none(folder: Path, names: Sequence[str], extra: Sequence[Mapping[str, np.ndarray]]) -> None:
    """Raises ValueError where some frames of a folder have a raster that others lack."""
    for key in RASTERS:
        lacking = [name for name, rasters in zip(names, extra, strict=True) if key not in rasters]
        if 0 < len(lacking) < len(names):
            raise ValueError(
                f"discover: {len(lacking)} of {len(names)} frames of {folder} lack {key} ({', '.join(lacking[:3])}"
                f"{' ...' if len(lacking) > 3 else ''}) and the others have it; give it for all or none"
            )


def constant_intensity(simulated: _Levels, measured: _Levels) -> list[str]:
    """Gives a note where the simulated intensity is alike everywhere. Raises ValueError where the measured one is."""
    least, most = _extent(measured)
    if least == most:
        raise ValueError(
            f"discover: measured intensity is {least:g} everywhere; a sensor that reports none cannot be "
            "compared: give what it measures (reflectivity, signal or intensity of its driver)"
        )
    least, most = _extent(simulated)
    if least == most:
        return [
            f"simulated intensity is {least:g} everywhere: what differs between surfaces counts as noise or as "
            "reflectances, and effects on intensity are told less surely"
        ]
    return []


def levels_of(image: PolarImage) -> tuple[float, float]:
    """Gives the least and the largest intensity of a frame's returns; of none the least is above the largest."""
    values = np.asarray(image.intensity)[np.asarray(image.valid)]
    return float(values.min(initial=np.inf)), float(values.max(initial=-np.inf))


def _extent(levels: _Levels) -> tuple[float, float]:
    return min(low for low, _ in levels), max(high for _, high in levels)


class RangeAgreement(NamedTuple):
    """Shares of the rays that return on both sides, of a frame's pair or of many."""

    near: Float[np.ndarray, "*n"]
    beyond: Float[np.ndarray, "*n"]
    """Share of the rays that were measured clearly behind the simulated surface."""


def agreement(
    simulated_m: Float[np.ndarray, "*n rays"],
    measured_m: Float[np.ndarray, "*n rays"],
    both: Bool[np.ndarray, "*n rays"],
) -> RangeAgreement:
    """Tells how far two sides' ranges agree where `both` return; 0 where no ray does."""
    off = measured_m - simulated_m
    limit = np.maximum(RULES.near_m, RULES.near_share * simulated_m)
    count = np.maximum(both.sum(-1), 1)
    near = np.sum(both & (np.abs(off) < limit), -1) / count
    beyond = np.sum(both & (off >= limit), -1) / count
    return RangeAgreement(near, beyond)


def check_partners(
    names: Sequence[str],
    simulated: Sequence[PolarImage],
    measured: Sequence[PolarImage],
    *,
    registered: Registration | None = None,
) -> dict[str, str]:
    """The single frames that are no pair, and why, by name.

    Raises ValueError where frames of the same name cannot show the same street through the same sensor: ranges
    that differ by a factor, hardly a common return, too few rays that agree, or partners that fit each other's
    partner better. Where a common motion of the sensor makes the ranges agree (`registered`), they show one street."""
    # Every so manieth ray: shares of thousands of rays are known to a percent.
    stride = max(1, simulated[0].range_m.size // RAYS_OF_FRAME)
    simulated_m, simulated_back = _thinned(simulated, stride)
    measured_m, measured_back = _thinned(measured, stride)
    both = simulated_back & measured_back & (simulated_m > 0) & (measured_m > 0)
    # Of the poorer side's returns: a sensor may see much less than its simulator.
    poorer = np.minimum(simulated_back.sum(1), measured_back.sum(1))
    apart = both.sum(1) < RULES.common_returns * poorer
    if apart.mean() > RULES.most_frames:
        k = int(np.argmax(apart))
        raise ValueError(
            f"discover: {names[k]} has {simulated_back[k].sum()} returns simulated and {measured_back[k].sum()} "
            f"measured of {both[k].size}, but only {both[k].sum()} on the same rays; {ADVICE}"
        )
    # Units differ by a factor on every ray: in logarithms by one number, about which hardly a ray scatters.
    log_ratio = np.log(measured_m[both] / simulated_m[both])
    middle = float(np.median(log_ratio))
    scatter = float(np.median(np.abs(log_ratio - middle)))
    same = agreement(simulated_m, measured_m, both)
    agreed = same.near if registered is None else np.maximum(same.near, registered.near)
    near = float(np.median(agreed))
    # A sensor that stands lower sees a road that is nearer by one factor: units do not mend by moving it.
    if abs(middle) > np.log(RULES.unit_factor) and scatter < RULES.steady and near < RULES.same_street:
        raise ValueError(
            f"discover: measured ranges are {np.exp(middle):.4g} times the simulated ones on the same rays; ranges are "
            "metres on both sides: correct the side that is in other units"
        )
    # Of a ray that ends before the surface (fog, rain) nothing can be said of the street.
    not_beyond = same.near / np.maximum(same.near + same.beyond, 1e-9)
    usual = float(np.median(not_beyond))
    if near < RULES.same_street and usual < RULES.not_beyond:
        k = int(np.argsort(same.near)[len(names) // 2])
        raise ValueError(
            f"discover: frames of the same name do not show the same street: ranges agree (within {RULES.near_m:g} m "
            f"or {100 * RULES.near_share:g} %) on {100 * same.near[k]:.0f} % of the rays that return on both sides of "
            f"{names[k]} and of half the frames{_as_registered(registered, same.near)}"
            f"{_in_other_order(simulated[k], measured[k])}; {ADVICE}"
        )
    # A single frame is of another street by the same signs, clearly unlike most: fog in one frame is not beyond either.
    strange = (agreed < min(RULES.same_street, near - RULES.better_partner)) & (
        not_beyond < usual - RULES.better_partner
    )
    alone = {
        names[k]: f"the ranges of {names[k]} agree on {100 * agreed[k]:.0f} % of the rays, the median frame's on "
        f"{100 * near:.0f} %: its two sides do not show the same street"
        for k in np.flatnonzero(strange).tolist()
    }
    return alone | _others_partners(
        names, simulated_m, measured_m, simulated_back=simulated_back, measured_back=measured_back, agreed=agreed
    )


def _in_other_order(simulated: PolarImage, measured: PolarImage) -> str:
    """Says in which other order of its rows or columns a measured frame is of the same street; nothing if in none."""
    ours_m, back = np.asarray(simulated.range_m), np.asarray(simulated.valid)
    for words, change in REARRANGED.items():
        both = back & change(np.asarray(measured.valid))
        near = float(agreement(ours_m[both], change(np.asarray(measured.range_m))[both], both[both]).near)
        if near >= RULES.same_street:
            return f", and on {100 * near:.0f} % with the measured {words}: correct the side that is written so"
    return ""


def _as_registered(registered: Registration | None, near_as_given: Float[np.ndarray, " f"]) -> str:
    """Says what the best motion of the sensor changes, if it betters anything."""
    if registered is None or np.median(registered.near) <= np.median(near_as_given):
        return ""
    return f", and on {100 * float(np.median(registered.near)):.0f} % with the simulated sensor {registered}"


def _thinned(side: Sequence[PolarImage], stride: int) -> tuple[Float[np.ndarray, "f rays"], Bool[np.ndarray, "f rays"]]:
    """Gives the ranges of every so manieth ray of each frame, and whether it returned."""
    range_m = np.stack([np.asarray(image.range_m, np.float32).ravel()[::stride] for image in side])
    valid = np.stack([np.asarray(image.valid).ravel()[::stride] for image in side])
    return range_m, valid


def _others_partners(
    names: Sequence[str],
    simulated_m: Float[np.ndarray, "f rays"],
    measured_m: Float[np.ndarray, "f rays"],
    *,
    simulated_back: Bool[np.ndarray, "f rays"],
    measured_back: Bool[np.ndarray, "f rays"],
    agreed: Float[np.ndarray, " f"],
) -> dict[str, str]:
    """Tells in words of measured frames that fit another simulated frame clearly better than their own. Raises
    ValueError where most do."""
    # Against a choice of the others: each against all would grow with the square of the frames.
    compared = np.unique(np.linspace(0, len(names) - 1, OTHERS).round().astype(int))
    # A partner that fits clearly better: names that are shifted by one frame pass all other tests.
    best = np.zeros(len(names), int)
    share = np.zeros(len(names))
    for k in range(len(names)):
        each = agreement(
            simulated_m[compared],
            np.broadcast_to(measured_m[k], simulated_m[compared].shape),
            simulated_back[compared] & measured_back[k][None],
        )
        best[k], share[k] = compared[np.argmax(each.near)], each.near.max()
    wrong = share > agreed + RULES.better_partner
    if wrong.mean() > RULES.most_frames:
        k = int(np.argmax(share - agreed))
        raise ValueError(
            f"discover: names pair the wrong frames: measured {names[k]} agrees with simulated {names[best[k]]} on "
            f"{100 * share[k]:.0f} % of the rays, with simulated {names[k]} on {100 * agreed[k]:.0f} %, and so for "
            f"{wrong.sum()} of {len(names)} frames; give the files of one moment the same name on both sides"
        )
    return {
        names[k]: f"measured {names[k]} agrees with simulated {names[best[k]]} on {100 * share[k]:.0f} % of the rays, "
        f"with simulated {names[k]} on {100 * agreed[k]:.0f} %; give the files of one moment the same name"
        for k in np.flatnonzero(wrong).tolist()
    }
