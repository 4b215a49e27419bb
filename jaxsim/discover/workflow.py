"""The whole method: find, name, add, show."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxsim.devices import one_blas_thread
from jaxsim.discover import explain as account
from jaxsim.discover.add import in_place, intervals, parameters_of, refit
from jaxsim.discover.find.interactions import interactions, spelled
from jaxsim.discover.find.localise import CHANCE, NAMED, Place, localise, reported
from jaxsim.discover.model.cast import Blocks, Cast, blocks, cast
from jaxsim.discover.model.evidence import Evidence, gather
from jaxsim.discover.model.fit import CLUTTER, Problem
from jaxsim.discover.model.null import fit_null
from jaxsim.discover.model.parameters import to_z
from jaxsim.discover.model.residuals import standardised
from jaxsim.discover.model.surfaces import with_planes
from jaxsim.discover.name.answer import decide
from jaxsim.discover.name.null_bar import bars_of, run_nulls
from jaxsim.discover.name.select import BAR, choose
from jaxsim.discover.read import Comparison, read_comparison
from jaxsim.discover.scenes import Split, split
from jaxsim.discover.show.judge import judge, placebo_of, runner_up
from jaxsim.discover.verdict import Gap, Interval, Result, Verdict, Where
from jaxsim.effects import EFFECTS, get_effect
from jaxsim.effects.chain import SensorModel
from jaxsim.effects.rays import Scan

MOST = 8
"""Dependences listed."""

Say = Callable[[str], None]

NOTHING_YET = SensorModel()


def discover_folders(
    *,
    simulated: Path,
    measured: Path,
    effects: Iterable[str] = tuple(EFFECTS),
    known: SensorModel = NOTHING_YET,
    nulls: int = 0,
    say: Say = lambda line: None,
) -> Result:
    """`discover` on two folders of polar frames (docs/polar-frames.md)."""
    return discover(read_comparison(simulated, measured), effects=effects, known=known, nulls=nulls, say=say)


@one_blas_thread
def discover(
    comparison: Comparison,
    *,
    effects: Iterable[str] = tuple(EFFECTS),
    known: SensorModel = NOTHING_YET,
    nulls: int = 0,
    say: Say = lambda line: None,
) -> Result:
    """Finds where simulation and measurement disagree, names the missing effect, adds it, and shows what is left.

    `effects` are the candidates, by default the whole catalogue. `known` is what the sensor model already has and the
    simulated frames do not show: it is put in place first, as it stands, and no candidate. So an answer can be fed
    back. `nulls` asks to set the bar on so many measurements drawn from these very data, in
    which nothing is missing (`calibrate`): what is named must gain more than anything did on any of them.

    Raises ValueError where the scenes are too few to decide anything, for unknown effects and for a negative number.
    """
    if nulls < 0:
        raise ValueError(f"discover: nulls is {nulls}; give how many to draw, 20 or more to calibrate, or 0 for none")
    there = [name for name, _ in known.effects]
    catalogue = [get_effect(name) for name in effects if name not in there]
    begun = time.monotonic()
    scenes = _Scenes.of(comparison)
    parts = scenes.parts

    # Find: the null model with its nuisances, and what its residuals still depend on.
    say(f"{len(parts.find)} scenes to find with, {len(parts.judge)} to judge on: split {parts.sha256}")
    null, unit, places, where = _find(scenes, known)
    everyone = np.ones(len(unit), np.float32)

    # Name: the catalogue, one effect after another; then free curves for what is not in it.
    say(f"fitting {len(catalogue)} effects")
    choice, drawn = choose(null, catalogue, say=say), None
    if nulls:
        drawn = run_nulls(null, choice.problem, unit, catalogue, nulls, say=say)
        bars = bars_of(drawn, len(parts.find))
        say(f"the bar of these data: {bars.effect:.1f} nats, of free curves {bars.free:.1f}")
        choice = choose(null, catalogue, bars=bars, say=say) if bars.effect > BAR else replace(choice, bars=bars)
    answer, choice, unexplained = decide(null, choice, places, everyone, unit)

    # Add: every effect fitted again with the others in place.
    say("fitting what was named together")
    added = [step.chosen.effect for step in choice.steps]
    fitted = refit(null, added, [step.fitted.z for step in choice.steps], everyone)
    parameters = [intervals(effect, problem, found) for effect, problem, found in fitted]
    sensor = SensorModel((*known.effects, *((e.name, parameters_of(e, found.z)) for e, _, found in fitted)))

    # Show: the scenes that nothing has seen.
    say("judging on unseen scenes")
    both, both_unit = scenes.evidence((*parts.find, *parts.judge), known)
    chain = [(e, found.z) for e, _, found in fitted]
    noise, rival = choice.problem.noise, runner_up(choice)
    placebo = placebo_of(null, rival, everyone) if rival else None
    shown = judge(scenes.scan, both, both_unit, len(parts.find), null, noise, chain, placebo)
    verdict = Verdict(
        verdict=answer,
        effects=tuple(account.named(step, values) for step, values in zip(choice.steps, parameters, strict=True)),
        where=where,
        unexplained=unexplained,
        gap=shown.gap,
        closure=shown.closure,
        find=parts.find,
        judge=parts.judge,
        sha256=parts.sha256,
        frames=len(comparison.names),
        seconds=time.monotonic() - begun,
        moved=account.moved(null, choice, [found.z for _, _, found in fitted]),
        ranking=account.ranking(choice),
        nulls=drawn,
        notes=account.notes(comparison, parts, there, choice),
    )
    grid = comparison.scan.grid
    ranking = choice.steps[0].ranking if choice.steps else choice.last
    return Result(verdict, sensor, grid, shown.maps_before, shown.maps_after, shown.curves, ranking)


@one_blas_thread
def disagreements(comparison: Comparison, *, known: SensorModel = NOTHING_YET) -> tuple[Where, ...]:
    """Only the first step of `discover`, in seconds: on which covariates the find scenes' residuals depend, strongest
    first. Raises ValueError where the scenes are too few to decide anything."""
    return _find(_Scenes.of(comparison), known)[-1]


@one_blas_thread
def judge_known(
    comparison: Comparison, known: Mapping[str, Mapping[str, Any]]
) -> tuple[dict[str, Gap], Interval | None]:
    """The gap on judge scenes that an answer known in advance reaches: `known` are the effects and the parameters that
    their fits begin at. What `discover` finds can be held against it; nothing is named, and there is no placebo.

    Raises ValueError for unknown effects and where the scenes are too few.
    """
    effects = [get_effect(name) for name in known]
    scenes = _Scenes.of(comparison)
    parts = scenes.parts
    ev, unit = scenes.evidence(parts.find)
    everyone = np.ones(len(unit), np.float32)
    null, _ = fit_null(scenes.scan, ev, everyone)
    starts = [to_z(effect, dict(known[effect.name]), ev.rays.row.shape[-1]) for effect in effects]
    fitted = refit(null, effects, starts, everyone)
    chain = [(effect, found.z) for effect, _, found in fitted]
    problem = in_place(null, chain)
    problem, _ = fit_null(problem.scan, problem.ev, everyone, clutter=problem.clutter)
    both, both_unit = scenes.evidence((*parts.find, *parts.judge))
    shown = judge(scenes.scan, both, both_unit, len(parts.find), null, problem.noise, chain, None)
    return shown.gap, shown.closure


def _find(scenes: _Scenes, known: SensorModel) -> tuple[Problem, np.ndarray, list[Place], tuple[Where, ...]]:
    """The null on the find scenes, each block's unit, the places by gain, and what is said of them."""
    ev, unit = scenes.evidence(scenes.parts.find, known)
    everyone = np.ones(len(unit), np.float32)
    null, _ = fit_null(scenes.scan, ev, everyone, clutter=bool({name for name, _ in known.effects} & {*CLUTTER}))
    left = standardised(null, everyone)
    places = localise(*left, unit)
    told = reported([*places, *interactions(*left, unit, level=CHANCE)])[:MOST]
    return null, unit, places, tuple(Where(p.channel, spelled(p.covariate, NAMED), p.p_value, p.share) for p in told)


@dataclass(frozen=True)
class _Scenes:
    """A comparison on the device, and which of its columns find and judge."""

    scan: Scan
    given: Scan
    """As the folder has it, with the incidence that was given."""
    measured: Any
    chosen: Blocks
    rays: Cast
    parts: Split

    @classmethod
    def of(cls, comparison: Comparison) -> _Scenes:
        given, measured = (jax.tree.map(jnp.asarray, side) for side in (comparison.scan, comparison.measured))
        chosen = blocks(comparison.scenes, *comparison.scan.range_m.shape[1:])
        scan = with_planes(given)
        return cls(scan, given, measured, chosen, cast(scan, chosen.frame, chosen.column), split(chosen.unit))

    def evidence(self, names: Sequence[str], known: SensorModel = NOTHING_YET) -> tuple[Evidence, np.ndarray]:
        """The evidence of the named units, and the place of each block's unit among `names`; `known` effects in
        place."""
        keep = np.array([unit in names for unit in self.chosen.unit])
        order = {name: k for k, name in enumerate(names)}
        unit = np.array([order[name] for name, kept in zip(self.chosen.unit, keep, strict=True) if kept])
        frame, column = self.chosen.frame[keep], self.chosen.column[keep]
        rays, given_rad = self.rays.part(keep), self.given.incidence_rad
        ev = gather(self.scan, self.measured, frame=frame, column=column, unit=unit, given_rad=given_rad, rays=rays)
        return (replace(ev, rays=known.apply(ev.rays, self.scan)) if known.effects else ev), unit
