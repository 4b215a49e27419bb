"""Every frame of folders that do not fit into memory: what an answer gains on all that it was not found on.

`read.thin_frames` reads as many frames as fit, and effects are named on these. Here all others are judged, a block of
frames at a time: memory is that of one block, and time is linear in frames. Only sums are kept: each scene's errors and
nats, each frame's gain, and each cell's residuals.

Nuisances that frames share (gain, classes, angles) follow from the find scenes' rays, which are in every block; a
frame's own levels and pose are fitted to it alone, so sums depend on how frames are dealt to blocks by the columns that
are drawn of each alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float, Int

from jaxsim.devices import by_small_steps
from jaxsim.discover.find.division import AllScenes, Division, NullModel
from jaxsim.discover.model.cast import Blocks, blocks
from jaxsim.discover.model.evidence import Measured
from jaxsim.discover.model.fit import Chain
from jaxsim.discover.model.noise import Noise
from jaxsim.discover.mounting.change import Knock
from jaxsim.discover.mounting.constant import Mounting, place_mounting
from jaxsim.discover.read import Comparison, Rest, read_part
from jaxsim.discover.rules import RULES
from jaxsim.discover.show.gap import ERROR_UNITS, block_distances
from jaxsim.discover.show.pictures import GridSums, map_sums
from jaxsim.discover.verdict import EveryFrame, Interval, OddFrame
from jaxsim.effects.effect import CHANNELS
from jaxsim.effects.rays import Scan
from jaxsim.progress import Progress

_Maps = dict[str, Float[np.ndarray, "r c"]]


@dataclass
class Sums:
    """What is kept of frames that were judged."""

    error: dict[str, Float[np.ndarray, "2 3 2"]] = field(default_factory=dict)
    """For each scene, before and after: sums of errors and counts of rays by channel."""
    gain: dict[str, Float[np.ndarray, " 3"]] = field(default_factory=dict)
    """Nats of each scene, by channel."""
    of_frame: dict[str, float] = field(default_factory=dict)
    """Nats of each frame, all channels together."""
    frames_of: dict[str, set[str]] = field(default_factory=dict)
    """Names of each scene's frames."""
    maps: dict[str, tuple[GridSums, GridSums]] = field(default_factory=dict)
    """Residuals on the grid before and after, by channel."""


class HeldAnswer(NamedTuple):
    """What frames are judged by: an answer, as `show.gap_with` takes it."""

    null_model: NullModel
    """The division of the frames that were read, whose find scenes stay in every block."""
    chain: Chain
    noise: Noise
    knock: Knock | None = None
    """Where the sensor stands in a part of the recording."""


class JudgedRest(NamedTuple):
    """What frames say that were not read at first."""

    every: EveryFrame | None = None
    """None where there are none, or each frame is of a moment or at a place of its own."""
    maps: tuple[_Maps, _Maps] | None = None
    """Their residuals before and after."""
    left_out: tuple[str, ...] = ()
    """What is wrong with those that cannot be compared."""


@by_small_steps
def judge_rest(comparison: Comparison, mounting: Mounting, by: HeldAnswer, *, size: int = 0) -> JudgedRest:
    """What the answer gains on the frames that were not read, `size` at a time (0: as many as judge scenes have
    now)."""
    rest = comparison.rest
    if rest is None or mounting.comparison.other_moments or mounting.comparison.own_places:
        return JudgedRest()
    # A damaged frame must not cost the answer that is there by now.
    rest, left_out = rest.sound()
    if not rest.names:
        return JudgedRest(left_out=left_out)
    division = by.null_model.division
    judged, _ = division.blocks_of(division.parts.judge)
    size = size or len(np.unique(division.blocks.frame[judged]))
    sums = Sums()
    bar = Progress(total=len(rest.names), unit="frame", desc="judging every frame")
    with bar:
        for number, first in enumerate(range(0, len(rest.names), size)):
            names = rest.names[first : first + size]
            add(sums, block_of(comparison, mounting, rest, names=names, by=by, size=size, number=number), by)
            bar.update(len(names))
    maps = tuple({name: pair[side].mean() for name, pair in sums.maps.items()} for side in (0, 1))
    return JudgedRest(every_frame_of(sums, by), (maps[0], maps[1]), left_out)


class JudgedBlock(NamedTuple):
    """The find scenes' blocks and those of further frames."""

    division: Division
    in_fit: Float[np.ndarray, " b"]
    """1 for the find scenes' blocks."""
    frame: tuple[str, ...]
    """Name of each block's frame; empty for the find scenes', and where it only fills up."""
    scene: tuple[str, ...]
    """The scene of each block."""


def block_of(
    comparison: Comparison,
    mounting: Mounting,
    rest: Rest,
    *,
    names: Sequence[str],
    by: HeldAnswer,
    size: int,
    number: int,
) -> JudgedBlock:
    """The next frames as they are judged; the last one is repeated until there are `size`."""
    padded = [*names, *[names[-1]] * (size - len(names))]
    # Their registration is that of the frames that were read, and they are brought as these were.
    part = place_mounting(read_part(rest, padded, like=comparison), mounting.effects, by.null_model.known).comparison
    part = by.knock.brought(part) if by.knock else part
    old = by.null_model.division
    is_find, _ = old.blocks_of(old.parts.find)
    # Columns from other starts in each block.
    new = blocks(part.scenes, *np.shape(old.scan.range_m)[1:], like=old.blocks, seed=number + 1)
    # Each counts for itself: as many names in every block of frames, or everything would be compiled again.
    pieces = tuple(f"piece {k}" for k in range(len(new.frame)))
    fresh = Division.of(part, chosen=replace(new, scene=pieces), like=old)
    find_scenes = tuple(scene for scene, keep in zip(old.blocks.scene, is_find, strict=True) if keep)
    of_block = [padded[k] if k < len(names) else "" for k in new.frame]
    in_fit = np.concatenate([np.ones(int(is_find.sum())), np.zeros(len(new.frame))]).astype(np.float32)
    return JudgedBlock(
        _joined(old, fresh, is_find), in_fit, ("",) * int(is_find.sum()) + tuple(of_block), (*find_scenes, *new.scene)
    )


def add(sums: Sums, block: JudgedBlock, by: HeldAnswer) -> None:
    """Judges a block's frames and adds them to the sums."""
    division = block.division
    scenes = tuple(dict.fromkeys(division.blocks.scene))
    ev, scene = division.evidence(scenes, by.null_model.known)
    in_fit = block.in_fit
    every = AllScenes(by.null_model, division, ev, scene, in_fit)
    before = every.problem_with()
    after = every.problem_with(by.chain, by.noise)
    sides = [block_distances(problem, in_fit, before.equations) for problem in (before, after)]
    gain = sides[1].log_likelihood - sides[0].log_likelihood
    # Frames that only fill up have no name, and count nowhere.
    has_name = np.array([bool(name) for name in block.frame])
    for k in np.flatnonzero(has_name):
        scene, name = block.scene[k], block.frame[k]
        errors = np.stack([side.error[k] for side in sides])
        sums.error[scene] = sums.error.get(scene, 0.0) + errors
        sums.gain[scene] = sums.gain.get(scene, 0.0) + gain[k]
        sums.of_frame[name] = sums.of_frame.get(name, 0.0) + float(gain[k].sum())
        sums.frames_of.setdefault(scene, set()).add(name)
    maps = [map_sums(problem, in_fit, where=has_name) for problem in (before, after)]
    for (channel, was), now in zip(maps[0].items(), maps[1].values(), strict=True):
        old = sums.maps.get(channel)
        sums.maps[channel] = (was, now) if old is None else (old[0] + was, old[1] + now)


def every_frame_of(sums: Sums, by: HeldAnswer) -> EveryFrame:
    """The sums as a verdict tells them."""
    scenes = sorted(sums.gain)
    count = np.array([len(sums.frames_of[scene]) for scene in scenes])
    gain = np.array([sums.gain[scene] for scene in scenes]) / count[:, None]
    error = np.array([sums.error[scene] for scene in scenes])
    # A scene of which a channel compares no ray has 0 / 0, which no mean counts.
    with np.errstate(invalid="ignore"):
        means = error[..., 0] / error[..., 1]
    unseen = np.array([scene not in by.null_model.division.parts.find for scene in scenes])
    worst = sorted(sums.of_frame, key=lambda name: sums.of_frame[name])[: RULES.odd_frames]
    scene_of = {name: scene for scene, names in sums.frames_of.items() for name in names}

    def by_channel(of: Float[np.ndarray, "s 3"], units: Mapping[str, str] | None = None) -> dict[str, Interval]:
        units = units or dict.fromkeys(CHANNELS, "nats a frame")
        return {name: Interval.of_scenes(of[:, k], units[name]) for k, name in enumerate(CHANNELS)}

    return EveryFrame(
        frames=len(sums.of_frame),
        scenes=len(scenes),
        unseen=int(unseen.sum()),
        gained=by_channel(gain),
        gained_unseen=by_channel(gain[unseen]),
        before=by_channel(means[:, 0], ERROR_UNITS),
        after=by_channel(means[:, 1], ERROR_UNITS),
        worst=tuple(OddFrame(name, scene_of[name], sums.of_frame[name]) for name in worst),
    )


def rest_in_words(every: EveryFrame) -> str:
    """A note for the verdict."""
    gains = ", ".join(
        f"{name} {interval.value:.3g} nats a frame ({interval.low:.3g} to {interval.high:.3g})"
        for name, interval in every.gained.items()
    )
    worst = every.worst[0]
    return (
        f"on the other {every.frames} frames, of {every.scenes} scenes, {every.unseen} of which nothing was fitted to, "
        f"the answer gains: {gains}; least on {worst.name} of {worst.scene} ({worst.nats:.3g} nats)"
    )


def _joined(old: Division, fresh: Division, chosen: Bool[np.ndarray, " b"]) -> Division:
    """Some blocks of a division with the frames that they are of, as they were traced before, and all of another."""
    staying = np.unique(old.blocks.frame[chosen])
    # Frames are numbered anew, the fresh ones behind those that stay.
    first, behind = np.searchsorted(staying, old.blocks.frame[chosen]), len(staying) + fresh.blocks.frame
    blocks_of_both = Blocks(
        np.concatenate([first, behind]),
        np.concatenate([old.blocks.column[chosen], fresh.blocks.column]),
        (*(scene for scene, keep in zip(old.blocks.scene, chosen, strict=True) if keep), *fresh.blocks.scene),
        old.blocks.sectors,
    )
    rays = jax.tree.map(
        lambda kept, new: np.concatenate([kept, new]) if np.ndim(kept) else kept, old.rays.part(chosen), fresh.rays
    )
    frame = np.broadcast_to(blocks_of_both.frame[:, None, None], rays.rays.row.shape).astype(np.int32)
    scan = _scans(old.scan, fresh.scan, staying)
    incidence = [np.asarray(old.given.incidence_rad)[staying], np.asarray(fresh.given.incidence_rad)]
    # Nothing but its incidence tells the given scan from the other: one copy of the rasters is enough.
    given = replace(scan, incidence_rad=np.concatenate(incidence))
    ranges, intensities = old.simulator.ranges, old.simulator.intensities
    if ranges is not None:
        ranges = replace(ranges, **_stacked(ranges, fresh.simulator.ranges, staying))
    if intensities is not None:
        intensities = replace(intensities, **_stacked(intensities, fresh.simulator.intensities, staying))
    return replace(
        old,
        scan=scan,
        given=given,
        simulator=replace(old.simulator, scan=given, ranges=ranges, intensities=intensities),
        measured=Measured(**_stacked(old.measured, fresh.measured, staying)),
        blocks=blocks_of_both,
        rays=replace(rays, rays=replace(rays.rays, frame=frame)),
        names=(*(old.names[k] for k in staying), *fresh.names),
        scenes=(*(old.scenes[k] for k in staying), *fresh.scenes),
    )


def _scans(first: Scan, second: Scan, chosen: Int[np.ndarray, " k"]) -> Scan:
    """Some frames of a scan, then all of another on the same grid."""
    frames = len(np.asarray(second.range_m))
    of_tags = {
        name: np.concatenate([np.asarray(tag)[chosen], np.asarray(second.tags.get(name, np.zeros(frames, bool)))])
        for name, tag in first.tags.items()
    }
    return replace(first, **_stacked(first, second, chosen), tags=of_tags)


def _stacked(first: Any, second: Any, chosen: Int[np.ndarray, " k"]) -> dict[str, np.ndarray]:
    """Some frames of each raster of a struct, then all of another's."""
    names = [field.name for field in fields(first) if field.name not in ("grid", "tags")]
    return {
        name: np.concatenate([np.asarray(getattr(first, name))[chosen], np.asarray(getattr(second, name))])
        for name in names
    }
