"""The whole method: place, ask, complete, conclude."""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from jaxsim.devices import by_small_steps
from jaxsim.discover.find.dependences import find_dependences
from jaxsim.discover.find.division import NOTHING_YET
from jaxsim.discover.read import Comparison, read_comparison
from jaxsim.discover.read.control import NO_CONTROL, Control
from jaxsim.discover.regimes.find import find_regimes
from jaxsim.discover.stages.ask import ask
from jaxsim.discover.stages.complete import complete
from jaxsim.discover.stages.conclude import result_of, show
from jaxsim.discover.stages.place import Standing, place
from jaxsim.discover.verdict import Result, Where
from jaxsim.effects import EFFECTS, get_effect
from jaxsim.effects.chain import SensorModel
from jaxsim.progress import Log


def discover_folders(
    *,
    simulated: Path,
    measured: Path,
    effects: Iterable[str] | None = None,
    known: SensorModel = NOTHING_YET,
    control: Control = NO_CONTROL,
    nulls: int = 0,
    every_frame: bool = False,
    log: Log = lambda line: None,
) -> Result:
    """`discover` on two folders of polar frames (docs/polar-frames.md), beside the `control` of an earlier answer."""
    control.check_new(simulated, measured)
    comparison = replace(read_comparison(simulated, measured), control=control)
    return discover(comparison, effects=effects, known=known, nulls=nulls, every_frame=every_frame, log=log)


@by_small_steps
def discover(
    comparison: Comparison,
    *,
    effects: Iterable[str] | None = None,
    known: SensorModel = NOTHING_YET,
    nulls: int = 0,
    every_frame: bool = False,
    log: Log = lambda line: None,
) -> Result:
    """Finds where simulation and measurement disagree, names the missing effect, adds it, and shows what is left.

    `effects` are the candidates, by default the whole catalogue and the effects of one's own that were loaded
    (`jaxsim.effects.own.known_effects`). `known` is what the sensor model already has and the
    simulated frames do not show: it is put in place first, as it stands, and no candidate. So an answer can be fed
    back. `nulls` asks to set the bar on so many measurements drawn from these very data, in which nothing is missing:
    what is named must gain more than anything did on any of them. `every_frame` also judges what was named on the
    frames that were not read because so many do not fit. `log` is given lines on the progress.

    Raises ValueError where the scenes are too few to decide anything, for unknown effects and for a negative number.
    """
    begun = time.monotonic()
    if nulls < 0:
        raise ValueError(f"discover: nulls is {nulls}; give how many to draw, 20 or more to calibrate, or 0 for none")
    modelled = known.beside(comparison.control.mounting)
    catalogue = [get_effect(name) for name in (EFFECTS if effects is None else effects) if name not in modelled.names]

    # Place the sensor where it stands, and find on what the disagreement that is left depends.
    placed = place(comparison, catalogue, modelled, log=log)
    # Name: the catalogue, one effect after another; then free curves for what is not in it.
    asked = ask(placed, nulls=nulls, log=log)
    found = asked.placed.found
    # Regimes: effects that act in a part of the recording alone take the place of the same everywhere.
    divided = find_regimes(found.null_model, asked.answer, without=asked.without, log=log)
    # Add: every effect fitted again with the others in place, and what repeats in the sensor's own coordinates.
    completed = complete(found, divided, asked.others, log=log)
    # Show: the scenes that nothing has seen.
    shown = show(asked, completed, every_frame=every_frame, log=log)
    seconds = time.monotonic() - begun
    return result_of(asked, divided, completed, shown=shown, given=known, seconds=seconds)


@by_small_steps
def disagreements(comparison: Comparison) -> tuple[Where, ...]:
    """Only the first step of `discover`, in seconds: on which covariates the find scenes' residuals depend, strongest
    first. Raises ValueError where the scenes are too few to decide anything."""
    standing = Standing.of(comparison, EFFECTS, NOTHING_YET, log=lambda line: None)
    return find_dependences(standing.division, standing.mounting.known).where
