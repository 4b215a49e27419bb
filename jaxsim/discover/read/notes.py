"""What two folders say that a reader of the answer must know, and that stops no comparison."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from jaxsim.discover.rules import RULES
from jaxsim.discover.scenes import MEDIAN_TO_SD, chance_of
from jaxsim.frame import PolarImage
from jaxsim.progress import counted


def unpartnered(simulated: Sequence[str], measured: Sequence[str]) -> list[str]:
    """Gives a note on frames that only one folder has."""
    alone = len({*simulated} ^ {*measured})
    return [f"{alone} frames have no partner of the same name in the other folder and are left out"] if alone else []


def brightness(simulated: Sequence[PolarImage], measured: Sequence[PolarImage]) -> Float[np.ndarray, " f"]:
    """Gives each measured frame's brightness beside the simulated one, ln; NaN where few rays return on both sides."""
    return np.array([_brighter(*pair) for pair in zip(simulated, measured, strict=True)])


def uneven(names: Sequence[str], level: Float[np.ndarray, " f"]) -> list[str]:
    """Gives notes on frames whose brightness beside the simulated ones (`brightness`) is not that of the others: single
    ones by name, as one of another scale, or all, where gains differ from frame to frame."""
    off = level - np.nanmedian(level) if np.isfinite(level).any() else level
    scatter = MEDIAN_TO_SD * np.nanmedian(np.abs(off)) if np.isfinite(off).any() else 0.0
    alone = np.abs(off) > max(RULES.alone_nats, RULES.alone_sds * scatter)
    notes = []
    if alone.any():
        which = ", ".join(f"{names[k]} {np.exp(off[k]):.2g}" for k in np.flatnonzero(alone)[:3])
        which = f"{which}{' ...' if alone.sum() > 3 else ''} times as bright"
        notes.append(
            f"{counted(int(alone.sum()), 'measured frame')} of another brightness than the others, beside the "
            f"simulated ones ({which}): another scale or exposure? Compared as they are"
        )
    others = off[~alone & np.isfinite(off)]
    if len(others) and np.std(others) > RULES.uneven_nats:
        notes.append(
            f"measured frames are {np.exp(others.min()):.2g} to {np.exp(others.max()):.2g} times as bright, beside the "
            f"simulated ones, as the median of them (standard deviation of ln {np.std(others):.2f}): a gain or an "
            "exposure that differs from frame to frame, which is fitted and of which nothing is said; frames of one "
            "setting by themselves tell more"
        )
    return notes


def fading(scenes: Sequence[str], facts: Sequence[Mapping[str, Any]], level: Float[np.ndarray, " f"]) -> list[str]:
    """Gives a note where the brightness of frames beside the simulated ones rises, or falls, in the course of every
    drive, as frames in another order seldom do: a receiver that warms up begins anew with each of them."""
    courses = list(_courses(scenes, facts, level))
    if len(courses) < RULES.fading_drives:
        return []
    slopes = np.array([np.polyfit(time_s, of_drive, 1)[0] for time_s, of_drive in courses])
    change = slopes * np.array([np.ptp(time_s) for time_s, _ in courses])
    rng = np.random.default_rng(0)
    shuffled = np.zeros(RULES.sign_draws)
    for time_s, of_drive in courses:
        orders = rng.permuted(np.tile(of_drive, (RULES.sign_draws, 1)), axis=1)
        shuffled += orders @ (time_s - time_s.mean())
    observed = sum(of_drive @ (time_s - time_s.mean()) for time_s, of_drive in courses)
    p = chance_of(np.abs(shuffled), float(np.abs(observed)))
    one_way = (change > 0).all() or (change < 0).all()
    if not one_way or p > RULES.fading_level or abs(np.median(change)) < RULES.fading_nats:
        return []
    return [
        f"measured frames grow {'brighter' if change[0] > 0 else 'darker'} beside the simulated ones in the course "
        f"of each of {len(courses)} drives, by {abs(np.median(change)):.2g} nats in the median (p {p:.2g}, frames in "
        "other orders), as a sensor does that warms up or adapts, or streets that the simulator knows less and less; "
        "each frame's level is fitted, and no effect is named for it"
    ]


def _courses(
    scenes: Sequence[str], facts: Sequence[Mapping[str, Any]], level: Float[np.ndarray, " f"]
) -> Iterator[tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]]:
    """Gives times and levels of each drive of which enough frames tell both."""
    for scene in dict.fromkeys(scenes):
        told = [
            (float(fact["time"]), of_frame)
            for name, fact, of_frame in zip(scenes, facts, level, strict=True)
            if name == scene and "time" in fact and np.isfinite(of_frame)
        ]
        time_s, of_drive = np.array(told).reshape(-1, 2).T
        if len(np.unique(time_s)) >= RULES.fading_frames:
            yield time_s, of_drive


def _brighter(simulated: PolarImage, measured: PolarImage) -> float:
    """Gives the median of ln measured / simulated intensity, of rays that both read; NaN where these are few."""
    ours, theirs = np.asarray(simulated.intensity), np.asarray(measured.intensity)
    both = np.asarray(simulated.valid) & np.asarray(measured.valid) & (ours > 0) & (theirs > 0)
    return float(np.median(np.log(theirs[both] / ours[both]))) if both.mean() > RULES.fewest_returns else np.nan


def very_fast(speed_mps: Float[np.ndarray, " f"]) -> list[str]:
    """Gives a note on speeds that no car in a street has, as those in kilometres an hour."""
    fastest = float(np.max(np.abs(speed_mps[np.isfinite(speed_mps)]), initial=0.0))
    if fastest <= RULES.fastest_mps:
        return []
    return [
        f"speeds in grid.json reach {fastest:.0f} m/s ({3.6 * fastest:.0f} km/h): if these are km/h already, divide "
        "them by 3.6, for what follows speed is told by them"
    ]


def sceneless(names: Sequence[str], facts: Sequence[Mapping[str, Any]]) -> list[str]:
    """Gives a note on frames of which grid.json names no scene: each counts as one, though they may be one drive's."""
    without = [fact for fact in facts if "scene" not in fact]
    if not without:
        return []
    note = (
        f"{len(without)} of {len(names)} frames have no scene in grid.json and count as a drive each: if they are of "
        "one drive they are not independent, and p-values and intervals are too small; give each frame its scene"
    )
    step = seconds_apart(facts)
    if step < RULES.consecutive_s:
        note += (
            f". Their times are {step:g} s apart: consecutive frames of one drive, it seems. Do not trust p-values and "
            "intervals of this answer"
        )
    return [note]


def seconds_apart(facts: Sequence[Mapping[str, Any]]) -> float:
    """Gives the median step in time between frames that name no scene, s; infinite where these say no times, or one
    for all."""
    times = np.unique([float(fact["time"]) for fact in facts if "scene" not in fact and "time" in fact])
    return float(np.median(np.diff(times))) if len(times) > 1 else np.inf


def same_numbers(simulated: Sequence[PolarImage], measured: Sequence[PolarImage]) -> list[str]:
    """Gives a note where nearly all rays read the same number on both sides, as those of which one side is a copy."""
    notes = []
    for part, what in (("range_m", "ranges"), ("intensity", "intensities")):
        share = float(np.mean([_alike(*pair, part) for pair in zip(simulated, measured, strict=True)]))
        if share > RULES.same_numbers:
            notes.append(
                f"{100 * share:.0f} % of the rays that return on both sides have the same number as {what}: of these "
                "the answer tells nothing where one side was made from the other"
            )
    return notes


def _alike(simulated: PolarImage, measured: PolarImage, part: str) -> float:
    both = np.asarray(simulated.valid) & np.asarray(measured.valid)
    equal = np.asarray(getattr(simulated, part)) == np.asarray(getattr(measured, part))
    return float(equal[both].mean()) if both.any() else 0.0
