"""What a single drive shows of effects that are bound to directions of the sensor.

Frames of one drive are cut into sectors of azimuth, which stand for scenes (`model/cast.py`). What hides one sector, or
grows over the turn, is then in one scene or a number of each, and no two scenes can agree on it. Pieces of the drive
see all sectors, so such effects are asked of these first, and put in place before sectors are asked for the rest.
Pieces pass the same walls, and a wall that is darker than it is simulated looks like a dirty window on its side: what
intensities say does not count.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from jaxsim.discover.add import add_effects, changes
from jaxsim.discover.explain import named
from jaxsim.discover.find import find_dependences
from jaxsim.discover.model.cast import blocks, cast
from jaxsim.discover.model.fit import in_place
from jaxsim.discover.model.null import refitted
from jaxsim.discover.name.select import Log, choose
from jaxsim.discover.read import Division
from jaxsim.discover.rules import RULES
from jaxsim.discover.scenes import clipped, p_value, split_scenes
from jaxsim.discover.show import gap_with
from jaxsim.discover.verdict import Named, Verdict
from jaxsim.effects import Effect
from jaxsim.effects.chain import SensorModel
from jaxsim.effects.effect import CHANNELS

BOUND = ("sector_occlusion", "motion_distortion", "window_contamination")
"""Effects of a direction of the sensor, or of the moment within a turn."""
PIECES = 12
"""A drive is cut into so many, or one a frame where these are fewer: as many as sectors."""


@dataclass(frozen=True)
class OfPieces:
    """What was named by pieces of a drive."""

    effects: tuple[Named, ...]
    known: SensorModel
    """What was known, with these effects."""
    pieces: int


def ask_pieces(division: Division, catalogue: Sequence[Effect], *, known: SensorModel, log: Log) -> OfPieces:
    """The effects of the catalogue that pieces of the one drive that was cut into sectors in `division` show, and judge
    pieces confirm; none where the drive has too few frames, and of several drives."""
    nothing = OfPieces((), known, 0)
    frames, rows, columns = division.scan.range_m.shape
    bound = [effect for effect in catalogue if effect.name in BOUND]
    cut = len(division.blocks.frame) > frames
    if not cut or not bound or frames < RULES.fewest_scenes:
        return nothing
    count = min(PIECES, frames)
    labels = [f"piece {k * count // frames:02d}" for k in range(frames)]
    chosen = blocks(labels, rows, columns)
    rays = cast(division.scan, chosen.frame, chosen.column)
    pieces = replace(division, blocks=chosen, rays=rays, parts=split_scenes(chosen.scene))
    null = find_dependences(pieces, known).null
    log(f"one drive: {' and '.join(effect.name for effect in bound)} are asked of {count} pieces of it")
    if not choose(null, bound, log=log).steps:
        return nothing
    # Alone they stand in for what goes by range or class, which differ from side to side: now beside all others.
    choice = choose(null, catalogue, log=log)
    steps = [step.chosen.effect.name in BOUND and without_brightness(step.chosen.gain) for step in choice.steps]
    if not any(steps):
        return nothing
    added = add_effects(null, choice.steps, known=known)
    chain = [pair for pair, keep in zip(added.chain, steps, strict=True) if keep]
    noise = refitted(in_place(null, chain)).noise
    judged = gap_with(pieces, null, chain, noise=noise, known=known).gap
    if sum(one.gained.value for one in judged.values() if one.gained) <= RULES.confirmed_nats:
        return nothing
    every = zip(choice.steps, added.parameters, added.refits, strict=True)
    effects = tuple(
        named(step, values, does=changes(null, one))
        for (step, values, one), keep in zip(every, steps, strict=True)
        if keep
    )
    of_sensor = [pair for pair in added.sensor.effects if pair[0] not in dict(known.effects)]
    kept = [pair for pair, keep in zip(of_sensor, steps, strict=True) if keep]
    return OfPieces(effects, replace(known, effects=(*known.effects, *kept)), count)


def without_brightness(gain: Float[np.ndarray, "s 3"]) -> bool:
    """Whether what scenes gain in other channels than the intensity passes what all that is named must pass."""
    rest = clipped(np.delete(gain, CHANNELS.index("intensity"), axis=1).sum(1))
    return bool(rest.sum() > RULES.bar_nats and p_value(rest) <= RULES.agreement_level)


def with_pieces(verdict: Verdict, found: OfPieces) -> Verdict:
    """The verdict with what pieces of the drive showed before what was named with it in place."""
    if not found.effects:
        return verdict
    names = ", ".join(effect.name for effect in found.effects)
    note = (
        f"{names}: found by {found.pieces} pieces of the one drive, each of which sees all directions, and confirmed "
        "on a third of them; everything else was asked, and the gap is shown, with it in place"
    )
    answer = "named" if verdict.verdict == "none" else verdict.verdict
    return replace(verdict, verdict=answer, effects=(*found.effects, *verdict.effects), notes=(*verdict.notes, note))
