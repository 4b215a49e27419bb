"""Ask: which effect is missing, of frames whose sensor is in its place (`place`); beside what other frames show."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path

from jaxsim.discover.add import may_never_act
from jaxsim.discover.find.correlation import correlations, of_one_material, of_ranges, unrelated
from jaxsim.discover.find.levels import range_noise_grows
from jaxsim.discover.law.learn import ranked_beside
from jaxsim.discover.mounting.constant import brought_back, place_mounting
from jaxsim.discover.name.answer import Answer, FreeCurve, name_effects
from jaxsim.discover.name.candidates import Candidate
from jaxsim.discover.name.closer_look import believed, fulfilled, lattices_of, told_whole, undecided
from jaxsim.discover.name.doubts import Doubts
from jaxsim.discover.name.look_alikes import with_look_alikes
from jaxsim.discover.name.other_sides import OtherSides
from jaxsim.discover.name.simulator_contrast import contrast_off
from jaxsim.discover.name.stepped import stepped
from jaxsim.discover.read import read_comparison
from jaxsim.discover.read.control import Control
from jaxsim.discover.stages.place import Placed
from jaxsim.effects import Effect, Law
from jaxsim.progress import Log

HIDDEN_BY_NOISE = (("intensity", "rgb"), ("intensity", "hue"), ("intensity", "hue angle"))
"""What noise on the simulator's intensities hides of its surfaces, colours tell: a curve along these is no sensor's."""
HIDDEN_BY_CONTRAST = (*HIDDEN_BY_NOISE, ("intensity", "intensity"), ("intensity", "power"))
"""Where the sensor does not follow the simulator's contrast, readings regress to the mean, by a curve of their own: a
curve along the intensity is no sensor's either."""


@dataclass(frozen=True)
class Asked:
    """What naming said, and what it was asked beside."""

    placed: Placed
    """The same with the simulator's contrast left free, where the sensor does not follow it."""
    catalogue: tuple[Effect, ...]
    """The candidates, with their look-alikes on these frames."""
    answer: Answer
    others: Sequence[Callable[[], OtherSides]]
    """The other sides that it asked: the sides exchanged where the simulator has noise, and the control's frames where
    they are there."""
    contrast: Candidate | None
    """The simulator's contrast, where the sensor does not follow it."""
    unrelated: str | None
    """A note, where intensities of the two sides have nothing to do with each other; nothing is asked of them then."""
    without: tuple[str, ...]
    """Channels of which nothing is asked."""
    one_material: tuple[str, ...]
    """A note, where simulated intensities are those of one material."""


def ask(placed: Placed, *, nulls: int, log: Log) -> Asked:
    """Which effects of the catalogue are missing; then free curves for what is not in it. The bar is set on so many
    `nulls` drawn from these data, where any are asked for."""
    null = placed.found.null_model.problem
    one_material = tuple(of_one_material(null.ev))
    note = unrelated(correlations(null.ev), one_material=bool(one_material))
    candidates = [effect for effect in placed.catalogue if not note or of_ranges(effect)]
    catalogue = with_look_alikes(candidates, null.ev.rays, null.scan)
    log(f"fitting {len(catalogue)} effects")
    control = placed.division.control
    beside = cache(partial(sides_of_control, control, *control.folders)) if control.folders else None
    without = ("intensity",) if note else ()
    asked = partial(answer_of, catalogue=catalogue, nulls=nulls, without=without, control_sides=beside, log=log)
    answer, others = asked(placed)
    contrast = None if note else contrast_off(placed.found.null_model, answer.choice)
    if contrast:
        log(f"the sensor does not follow the simulator's contrast ({contrast.total:.0f} nats): all is asked beside it")
        placed = placed.with_free_contrast()
        answer, others = asked(placed)
    hopeful = undecided(answer)
    nearer = placed.closer() if hopeful else placed
    if nearer is not placed:
        columns = nearer.division.blocks.column.shape[1]
        log(f"undecided: {', '.join(hopeful)}; asked once more, of {columns} columns a frame")
        hoped = [one for one in catalogue if one.name in hopeful]
        if fulfilled(hoped, nearer.found.null_model.problem, bar=answer.choice.bars.effect):
            lattices = [one for one in catalogue if one.name in lattices_of(answer)]
            again, beside_these = asked(nearer, catalogue=[*lattices, *hoped])
            if believed(again, answer):
                placed, answer = nearer, told_whole(again, answer)
                others = beside_these
    return Asked(placed, tuple(catalogue), answer, others, contrast, note, without, one_material)


def sides_of_control(control: Control, simulated: Path, measured: Path) -> OtherSides:
    """The control's frames, to which what is about to be said of others is held.

    Raises ValueError where they are none any more."""
    comparison = replace(read_comparison(simulated, measured), control=control)
    return OtherSides.of_control(place_mounting(comparison, (), control.mounting).comparison)


def answer_of(
    placed: Placed,
    *,
    catalogue: Sequence[Effect],
    nulls: int,
    without: Sequence[str],
    control_sides: Callable[[], OtherSides] | None,
    log: Log,
) -> tuple[Answer, Sequence[Callable[[], OtherSides]]]:
    """What naming says of what was found, and the other sides that it asked."""
    found, comparison = placed.found, placed.comparison
    null, simulator = found.null_model.problem, placed.division.simulator
    back = brought_back if comparison.other_moments else None
    exchanged = cache(partial(OtherSides.exchanged, comparison, found.null_model, back=back))
    # Of a simulator without noise the sides are no two readings of one street, but for what casting adds.
    two_readings = simulator.noisy or comparison.other_moments
    others = [*([exchanged] if two_readings else ()), *([control_sides] if control_sides else ())]
    doubts = Doubts(
        others,
        exchanged=None if two_readings else exchanged,
        noise_grows=cache(partial(range_noise_grows, comparison)),
        may_never_act=may_never_act,
        apart=placed.division.apart,
        classless=comparison.classless,
    )

    def beside(curve: FreeCurve, effects: Sequence[Law], bar: float) -> Sequence[Candidate]:
        return ranked_beside(null, curve, effects, bar=bar)

    answer = name_effects(
        null,
        catalogue,
        found.single,
        nulls=nulls,
        without=without,
        unasked=HIDDEN_BY_CONTRAST if simulator.free_contrast else HIDDEN_BY_NOISE if simulator.intensities else (),
        doubts=doubts,
        beside=beside,
        log=log,
    )
    if "intensity" not in without:
        answer = stepped(null, answer, doubts=doubts, beside=beside, log=log)
    return answer, others
