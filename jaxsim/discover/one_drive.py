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
from itertools import compress

import numpy as np
from jaxtyping import Float

from jaxsim.discover.add import add_effects, changes
from jaxsim.discover.division import AllScenes, NullModel
from jaxsim.discover.explain import named
from jaxsim.discover.model.cast import blocks
from jaxsim.discover.name.select import Log, choose
from jaxsim.discover.rules import RULES
from jaxsim.discover.scenes import clipped, p_value, split_scenes
from jaxsim.discover.show import judge_gains
from jaxsim.discover.verdict import Named
from jaxsim.effects import Effect
from jaxsim.effects.chain import SensorModel
from jaxsim.effects.effect import CHANNELS

OF_DIRECTIONS = ("sector_occlusion", "motion_distortion", "window_contamination")
"""Effects of a direction of the sensor, or of the moment within a turn."""
BRIGHTNESS = CHANNELS.index("intensity")
"""The channel that does not count."""
PIECES = 12
"""A drive is cut into so many, or one a frame where these are fewer: as many as sectors."""


@dataclass(frozen=True)
class OfPieces:
    """What was named by pieces of a drive."""

    effects: tuple[Named, ...]
    known: SensorModel
    """What was known, with these effects."""
    pieces: int

    @property
    def how(self) -> str:
        """How they were found, in words."""
        return (
            f"found by {self.pieces} pieces of the one drive, each of which sees all directions, and confirmed on a "
            "third of them; everything else was asked, and the gap is shown, with it in place"
        )


def ask_pieces(sectors: NullModel, catalogue: Sequence[Effect], *, log: Log) -> OfPieces:
    """The effects of the catalogue that pieces of a drive show and judge pieces confirm, where the null model is of one
    drive that was cut into `sectors`; none where it has too few frames, and of several drives."""
    nothing = OfPieces((), sectors.known, 0)
    whole = sectors.division
    frames, rows, columns = whole.scan.range_m.shape
    bound = [effect for effect in catalogue if effect.name in OF_DIRECTIONS]
    cut = len(whole.blocks.frame) > frames
    if not cut or not bound or frames < RULES.fewest_scenes:
        return nothing
    count = min(PIECES, frames)
    chosen = blocks([f"piece {k * count // frames:02d}" for k in range(frames)], rows, columns)
    pieces = replace(whole.looking_at(chosen), parts=split_scenes(chosen.scene))
    null = NullModel.of(pieces, sectors.known)
    log(f"one drive: {' and '.join(effect.name for effect in bound)} are asked of {count} pieces of it")
    if not choose(null.problem, bound, log=log).steps:
        return nothing
    # Alone they stand in for what goes by range or class, which differ from side to side: now beside all others.
    choice = choose(null.problem, catalogue, log=log)
    stands = [
        step.chosen.effect.name in OF_DIRECTIONS and without_brightness(step.chosen.gain) for step in choice.steps
    ]
    if not any(stands):
        return nothing
    added = add_effects(null.problem, choice.steps, known=sectors.known)
    gained = judge_gains(AllScenes.of(null), [*compress(added.chain, stands)])
    if np.delete(gained, BRIGHTNESS).sum() <= RULES.confirmed_nats:
        return nothing
    effects = [
        named(step, values, does=changes(null.problem, one))
        for step, values, one in zip(choice.steps, added.parameters, added.refits, strict=True)
    ]
    of_sensor = added.sensor.effects[len(sectors.known.effects) :]
    known = replace(sectors.known, effects=(*sectors.known.effects, *compress(of_sensor, stands)))
    return OfPieces(tuple(compress(effects, stands)), known, count)


def without_brightness(gain: Float[np.ndarray, "s 3"]) -> bool:
    """Whether what scenes gain in other channels than the intensity passes what all that is named must pass."""
    rest = clipped(np.delete(gain, BRIGHTNESS, axis=1).sum(1))
    return bool(rest.sum() > RULES.bar_nats and p_value(rest) <= RULES.agreement_level)
