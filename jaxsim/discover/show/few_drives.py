"""What one drive, or a few, show of effects that are bound to directions of the sensor.

Frames of few drives are cut into sectors of azimuth, which stand for scenes (`model/cast.py`). What hides one sector,
or grows over the turn, is then in one scene of each drive or a number of each, and scenes cannot agree on it. Pieces of
the drives see all sectors, so such effects are asked of these first, and put in place before sectors are asked for the
rest. Pieces pass the same walls, and a wall that is darker than it is simulated looks like a dirty window on its side:
what intensities say does not count.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import compress

import numpy as np
from jaxtyping import Float

from jaxsim.discover.add import add_effects
from jaxsim.discover.find.division import AllScenes, NullModel
from jaxsim.discover.name.select import choose
from jaxsim.discover.rules import RULES
from jaxsim.discover.scenes import clipped, p_value
from jaxsim.discover.show import judge_gains
from jaxsim.discover.show.explain import all_named
from jaxsim.discover.verdict import Named
from jaxsim.effects import Effect
from jaxsim.effects.chain import SensorModel
from jaxsim.effects.effect import CHANNELS
from jaxsim.progress import Log, counted

OF_DIRECTIONS = ("sector_occlusion", "motion_distortion", "window_contamination")
"""Effects of a direction of the sensor, or of the moment within a turn."""
BRIGHTNESS = CHANNELS.index("intensity")
"""The channel that does not count."""


@dataclass(frozen=True)
class OfPieces:
    """What was named by pieces of one drive or a few."""

    effects: tuple[Named, ...]
    known: SensorModel
    """What was known, with these effects."""
    pieces: int
    drives: str = ""
    """How many drives there are, in words."""

    @property
    def how(self) -> str:
        """How they were found, in words."""
        return (
            f"found by {self.pieces} pieces of {self.drives}, each of which sees all directions, and confirmed on a "
            "third of them; everything else was asked, and the gap is shown, with it in place"
        )


def ask_pieces(sectors: NullModel, catalogue: Sequence[Effect], *, log: Log) -> OfPieces:
    """The effects of the catalogue that pieces of drives show and judge pieces confirm, where the null model is of
    drives that were cut into `sectors`; none where these have too few frames, and of enough drives to be scenes."""
    nothing = OfPieces((), sectors.known, 0)
    whole = sectors.division
    bound = [effect for effect in catalogue if effect.name in OF_DIRECTIONS]
    of_frame = pieces_of(whole.scenes)
    count = len(set(of_frame))
    if whole.blocks.sectors == 1 or not bound or count < RULES.fewest_scenes:
        return nothing
    null_model = NullModel.of(whole.divided_by(of_frame), sectors.known)
    drives = counted(len(set(whole.scenes)), "drive")
    log(f"{drives}: {' and '.join(effect.name for effect in bound)} are asked of {count} pieces")
    if not choose(null_model.problem, bound, log=log).steps:
        return nothing
    # Alone they stand in for what goes by range or class, which differ from side to side: now beside all others.
    choice = choose(null_model.problem, catalogue, log=log)
    stands = [
        step.chosen.effect.name in OF_DIRECTIONS and without_brightness(step.chosen.gain) for step in choice.steps
    ]
    if not any(stands):
        return nothing
    added = add_effects(null_model.problem, choice.steps, known=sectors.known)
    gained = judge_gains(AllScenes.of(null_model), [*compress(added.chain, stands)])
    if np.delete(gained, BRIGHTNESS).sum() <= RULES.confirmed_nats:
        return nothing
    effects = tuple(compress(all_named(null_model.problem, choice.steps, added), stands))
    # By their names: a model has its effects in physical order, an answer in that in which they were found.
    named = {effect.name for effect in effects}
    found = tuple(pair for pair in added.effects_model.effects if pair[0] in named)
    known = replace(sectors.known, effects=(*sectors.known.effects, *found))
    return OfPieces(effects, known, count, drives)


def pieces_of(drives: Sequence[str]) -> list[str]:
    """The piece that each frame is of: consecutive frames of a drive, about as many pieces of each, `Rules.sectors` in
    all or one a frame where these are fewer."""
    frames_of = Counter(drives)
    each = -(-RULES.sectors // len(frames_of))
    passed: Counter[str] = Counter()
    pieces: list[str] = []
    for drive in drives:
        count = min(each, frames_of[drive])
        # Of a single drive the number alone says which.
        name = f"{drive} " if len(frames_of) > 1 else ""
        pieces.append(f"{name}piece {passed[drive] * count // frames_of[drive]:02d}")
        passed[drive] += 1
    return pieces


def without_brightness(gain: Float[np.ndarray, "s 3"]) -> bool:
    """Whether what scenes gain in other channels than the intensity passes what all that is named must pass."""
    rest = clipped(np.delete(gain, BRIGHTNESS, axis=1).sum(1))
    return bool(rest.sum() > RULES.bar_nats and p_value(rest) <= RULES.agreement_level)
