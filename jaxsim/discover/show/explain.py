"""The entries of a verdict: what was named, what ranked below, what changed beside it, and notes."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from jaxsim.discover.add import Added, effect_on_rays, parameters_of
from jaxsim.discover.find.division import Division
from jaxsim.discover.model.fit import Problem
from jaxsim.discover.model.noise_levels import Levels
from jaxsim.discover.model.null_model import Residuals
from jaxsim.discover.model.parameters import to_values
from jaxsim.discover.model.random_effects import shared_levels
from jaxsim.discover.name.answer import Answer
from jaxsim.discover.name.candidates import Candidate
from jaxsim.discover.name.doubts import (
    BY_PLACE,
    NEGLIGIBLE,
    OF_MATERIALS,
    OF_POSTS,
    OUTDONE,
    RARELY_IF_EVER,
    SHOWN_ELSEWHERE,
    UNFOUNDED,
    goes_by,
)
from jaxsim.discover.name.select import Choice, Selection, Step, too_rich
from jaxsim.discover.read import Comparison
from jaxsim.discover.read.control import NO_CONTROL
from jaxsim.discover.rules import RULES
from jaxsim.discover.scenes import MEDIAN_TO_SD, clipped
from jaxsim.discover.verdict import Interval, Level, Named, OwnCandidate, Rank
from jaxsim.effects import EFFECTS
from jaxsim.effects.origin import OwnEffect
from jaxsim.progress import counted

CANNOT_TELL = "these data cannot tell it from the one that is named"
"""Why a look-alike is not what was named."""
REFUSED = {
    NEGLIGIBLE: f"Each is less than {100 * RULES.negligible:.0f} % of what is clearly visible of it: so many rays show "
    "what is too small to matter, and as much comes of rounding, smoothing or a surface's model",
    UNFOUNDED: "Weak echoes lie farther from the prediction, but the noise of neighbouring readings does not grow as "
    "echoes weaken: what grows is what the simulator does not know of grazing surfaces and of the sensor's pose",
    OF_MATERIALS: "The simulated frames tell no classes: where one material stands near by, low or slanted and another "
    "far off, high or upright, and the simulator has one of them a little too bright, that gains as much. Frames with "
    "`semantic` tell the two apart",
    RARELY_IF_EVER: "The 90 % interval of how often it acts holds never: what a few rays of some scenes show beside "
    "edges and bright things is not enough to say that the sensor does it",
    OF_POSTS: "Glare goes round a very bright target, and is read straight below it alone: there stands a post, which "
    "single rays of one side meet and those of the other pass",
}
"""What it means that something was found which is not said because it is too little, by why."""
OF_SURFACES = (
    "It is taken for something of these surfaces that the simulator does not know, as soil that undulates, glass or "
    "crowns that let rays through, and not for the sensor's"
)
NOT_ONE = "Its numbers would have to differ from class to class, which an effect of a sensor's do not"
"""What it means that classes speak against what was found: something of their surfaces, or another effect."""
USUAL_SIZES = {
    "random_dropout": RULES.usual_random_loss,
    "range_quantization": RULES.usual_range_step_m,
    "intensity_quantization": RULES.usual_intensity_step,
}
"""Share of rays lost, and steps of lattices, up to which these are what sensors usually have."""


def named(
    step: Step[Any],
    parameters: dict[str, Any],
    *,
    does: dict[str, Interval] | None = None,
    more_alike: Sequence[str] = (),
    remedy: str = "scenes in which their covariates differ more",
) -> Named:
    """An effect that was named, with what it `does` to the rays, its look-alikes (`more_alike` besides) and what would
    tell them apart: `remedy`, where the catalogue does not say."""
    effect = step.chosen.effect
    alike = list(dict.fromkeys([*(candidate.effect.plain_name for candidate in step.alike), *more_alike]))
    # Look-alikes of one's own effect are those of these frames, which the candidates carry.
    every = {**EFFECTS, **{candidate.effect.plain_name: candidate.effect for candidate in (step.chosen, *step.alike)}}
    own = effect.look_alikes
    return Named(
        name=effect.plain_name,
        look_alikes=tuple(alike),
        tell_apart={name: own.get(name) or every[name].look_alikes.get(effect.plain_name) or remedy for name in alike},
        channels=effect.channels,
        p_value=step.chosen.chance,
        # No scene decides alone.
        gain=Interval.of_scenes(clipped(step.chosen.by_scene), "nats per scene"),
        parameters=parameters,
        does=does or {},
    )


def all_named(null: Problem, steps: Sequence[Step[Any]], added: Added) -> tuple[Named, ...]:
    """The effects that were named on top of a null, as they were fitted together."""
    return tuple(
        named(step, values, does=effect_on_rays(null, refit))
        for step, values, refit in zip(steps, added.parameters, added.refits, strict=True)
    )


def usual_last(effects: Sequence[Named]) -> tuple[Named, ...]:
    """The effects in their order, but losses at random and lattices that sensors usually have after all others: beside
    a renderer that loses and rounds nothing every sensor has them, and of nats a lattice gains more than all else."""
    return tuple(sorted(effects, key=_is_usual))


def _is_usual(effect: Named) -> bool:
    most = USUAL_SIZES.get(effect.name, 0.0)
    sizes = [size for size in effect.parameters.values() if isinstance(size, Interval)]
    return bool(most and all(size.value <= most for size in sizes))


def ranking(choice: Selection[Any], why_not: Callable[[Any, Any], str], *, bar: float = 0.0) -> tuple[Rank, ...]:
    """The first step's best candidates and why (`why_not` of candidate and choice) each was not named; `bar` is what
    all scenes together must gain."""
    listed = choice.first_ranking[: RULES.candidates_listed]
    return tuple(
        Rank(c.effect.name, c.total / len(c.by_scene), c.chance, bar / len(c.by_scene), why_not(c, choice))
        for c in listed
    )


def own_candidates(choice: Choice) -> tuple[OwnCandidate, ...]:
    """The candidates of the first step that are no part of the catalogue, best first."""
    return tuple(
        OwnCandidate(
            name=candidate.effect.name,
            origin=candidate.effect.origin.to_json(),
            gain=candidate.total / len(candidate.by_scene),
            p_value=candidate.chance,
            why_not=why_not(candidate, choice),
            look_alikes=candidate.effect.alike,
        )
        for candidate in choice.first_ranking
        if isinstance(candidate.effect, OwnEffect)
    )


def why_not(candidate: Candidate, choice: Choice) -> str:
    """Why a candidate of the first step is not what was named first; empty if it is."""
    # In the order in which naming asks: the first that fails is why.
    name = candidate.effect.name
    steps = choice.steps
    order = [step.chosen.effect.plain_name for step in steps]
    if name in order:
        return "" if name == order[0] else f"named too, after {', '.join(order[: order.index(name)])}"
    if steps and name in {candidate.effect.plain_name for candidate in steps[0].alike}:
        return CANNOT_TELL
    if name in choice.refused:
        return choice.refused[name]
    if name in choice.needless:
        return "what is named explains what it does, and more"
    if candidate.total <= choice.bars.effect:
        return "its gain is within what a null reaches"
    if candidate.smooth_is_enough:
        return "a smooth change along the rows gains as much"
    if not candidate.scenes_agree:
        return "the scenes disagree on it"
    if not steps:
        strongest = (choice.last or (candidate,))[0]
        if candidate.total < RULES.weak_share * strongest.total and not strongest.accepted(choice.bars.effect):
            return f"it is weak beside {strongest.effect.name}, on which the scenes disagree"
        return "a free curve explains clearly more"
    if too_rich(candidate, steps[0].chosen):
        return "it has more numbers to fit than the one that is named, and gains hardly more"
    return "it explains clearly less than the one that is named"


def nuisance_changes(null: Problem, choice: Choice, z: Sequence[dict[str, Any]]) -> dict[str, tuple[float, float]]:
    """Noise scales, rates, gain and reflectances without the effects and with them; and of several effects (`z` of
    each) the parameters when each was added, and in the end."""
    names = null.noise.__dataclass_fields__
    changes = {n: (float(getattr(null.noise, n)), float(getattr(choice.problem.noise, n))) for n in names}
    nuisances = [
        np.asarray(shared_levels(p.ev, p.equations, p.ev.all_blocks))[: -p.ev.after_kinds].tolist()
        for p in (null, choice.problem)
    ]
    changes |= {name: (a, b) for name, a, b in zip(["gain", *null.ev.kinds], *nuisances, strict=True)}
    if len(choice.steps) > 1:
        for step, at in zip(choice.steps, z, strict=True):
            effect = step.chosen.effect
            first = parameters_of(effect, step.fit.z)
            last = parameters_of(effect, at)
            # Numbers of single beams or classes are left to `parameters`.
            single = [name for name, value in first.items() if isinstance(value, float)]
            changes |= {f"{effect.plain_name}.{name}": (first[name], last[name]) for name in single}
    return changes


def notes(comparison: Comparison, division: Division, answer: Answer, *, held: Sequence[str] = ()) -> tuple[str, ...]:
    """What a reader must know; `held` are the effects that the sensor model already had."""
    return (
        *comparison.notes,
        *_of_the_scenes(comparison, division, answer, held=held),
        *_of_the_simulator(comparison, division),
        *_not_said(answer),
        *_of_places(comparison, answer),
        *_of_averages(comparison, division, answer),
        *(
            f"not confirmed on unseen scenes: {curve} explained the scenes that the search saw, but the judge scenes "
            "do not gain in the mean; it is not added"
            for curve in answer.unconfirmed
        ),
    )


def _of_the_scenes(comparison: Comparison, division: Division, answer: Answer, *, held: Sequence[str]) -> Iterator[str]:
    """What scenes cannot tell: those that were judged before, those of few drives, and few of them."""
    if held:
        yield (
            f"beside what the sensor model already had: {', '.join(held)}, held as given; the judge scenes are "
            "those of any other run on these frames: after several rounds, what they show is no longer new"
        )
    if division.blocks.sectors > 1:
        yield (
            f"{counted(len(set(comparison.scenes)), 'drive')} alone: each frame is cut into {division.blocks.sectors} "
            "sectors with gaps between them; sectors of a drive are less independent than drives, and whether an "
            f"effect is in some drives only is not asked. {RULES.fewest_scenes} drives or more tell that"
        )
    for step in answer.choice.steps:
        if step.chosen.chance > RULES.agreement_level:
            yield f"{step.chosen.effect.plain_name}: a rare event; few scenes show it, without the test over scenes"
    if len(division.parts.judge) < RULES.few_judge_scenes:
        yield f"{len(division.parts.judge)} judge scenes: intervals of the gap are wide"


def coarse_shapes(ranges: Residuals, levels: Sequence[Level]) -> Iterator[str]:
    """What a reader must know where the simulator's shapes are coarse: ranges of smooth surfaces, beside all that is
    named, are off by far more than neighbouring readings scatter."""
    [noise] = [level for level in levels if level.name == "range_noise"]
    noise_m = max(math.hypot(noise.measured.value, noise.simulated.value), RULES.noisy_range_m)
    # Of the median: single readings that are far off are told by other means.
    off_m = MEDIAN_TO_SD * float(np.median(np.abs(ranges.off[ranges.counts]))) if ranges.counts.any() else 0.0
    if off_m > RULES.coarse_shapes * noise_m:
        yield (
            f"simulated surfaces are off the measured ones by {100 * off_m:.2g} cm, where noise makes "
            f"{100 * noise_m:.2g} cm: the simulator's shapes are coarse, or ranges have an error that is not named. "
            "What coarse shapes and materials do in every scene can look like a weak effect of a sensor; drives on "
            "which the sensor was as it should be tell the two apart (--control)"
        )


def _of_the_simulator(comparison: Comparison, division: Division) -> Iterator[str]:
    """What of the simulated frames is not the sensor's to explain."""
    if noises := ", ".join(_noises(division.simulator.noise)):
        yield (
            f"the simulated frames have noise of their own ({noises}; read off neighbouring rays, so texture as "
            "fine as these is part of it): surfaces were made smooth, and compared is what the simulator means; "
            "effects count by what they explain between surfaces, ranges and angles. Frames without noise tell more"
        )
    if division.left_out:
        yield (
            f"{division.left_out} met a surface that one side alone has: neighbouring rays read nearly the same, and "
            "not what is simulated there. Kerbs, vehicles or plants that the other side lacks, or has elsewhere, do "
            "that; such rays are left out, for no effect of a sensor explains them"
        )
    if comparison.control is not NO_CONTROL:
        lacks = ", ".join(comparison.control.model.names) or "nothing"
        yield (
            f"in place from the start is what the control says that the simulator lacks by itself ({lacks}): what is "
            "named comes on top of it, and so do the gap and sensor.json"
        )
        if comparison.control.folders is None:
            yield (
                "the control's frames are not where its answer found them: what the simulator lacks by itself too "
                "weakly to be named there could not be told from what is new"
            )
    if division.simulator.free_contrast:
        yield (
            "the sensor does not follow the simulator's contrast: slopes differ between cells, patches and classes, "
            "which no law of the sensor explains (`contrast`); they are left free, and effects on intensities count by "
            "what they explain along ranges, angles and rows and between classes"
        )


def _not_said(answer: Answer) -> Iterator[str]:
    """What was found and yet is no part of the answer, each with why."""

    def passed(why: str) -> list[str]:
        return [name for name, reason in answer.elsewhere if reason == why]

    for why, meaning in SHOWN_ELSEWHERE.items():
        if names := passed(why):
            yield _found(names, f"{_capital(why)}: so it is {meaning}")
    for why, meaning in REFUSED.items():
        # Curves that were passed over are told beside effects.
        if names := [*answer.refused_for(why), *passed(why)]:
            yield _found(names, meaning)
    for name, why in answer.denied:
        yield _found([name], f"{_capital(why)}. {NOT_ONE if why.startswith(OUTDONE) else OF_SURFACES}")


def _found(names: Sequence[str], why_not: str) -> str:
    return f"found, and not said: {', '.join(names)}. {why_not}"


def _capital(sentence: str) -> str:
    # Not str.capitalize, which would make names of effects and classes small.
    return f"{sentence[0].upper()}{sentence[1:]}"


def _of_places(comparison: Comparison, answer: Answer) -> Iterator[str]:
    """Effects that materials look like, where the simulator tells no classes."""
    by_place = [step.chosen.effect for step in answer.choice.steps if goes_by(step.chosen.effect, BY_PLACE)]
    if by_place and comparison.classless:
        yield (
            f"{', '.join(effect.plain_name for effect in by_place)}: the simulated frames tell no classes. Where one "
            "material stands near by and another far off, or in the rows of some beams, in every scene, and the "
            "simulator has one of them too bright, that looks the same; frames with `semantic` tell the two apart"
        )


def _of_averages(comparison: Comparison, division: Division, answer: Answer) -> Iterator[str]:
    """Larger contrasts than a simulator has that may have shrunk them itself."""
    for step in answer.choice.steps:
        effect = step.chosen.effect
        larger = effect.plain_name == "gamma_response" and float(to_values(effect, step.fit.z)["gamma"]) > 1
        if larger and comparison.control is NO_CONTROL and _noises(division.simulator.noise):
            yield (
                "gamma_response: measured contrasts are larger than simulated ones. A simulator that learned, or that "
                "averages, shrinks them by itself (it regresses to the mean), which looks the same; an answer on "
                "drives where the sensor was as it should be tells the two apart (--control)"
            )


def _noises(noise: Levels) -> list[str]:
    """Noise that the simulated frames carry themselves, in words."""
    levels = (
        ("range", 100 * noise.range_m, " cm"),
        ("intensity", 100 * noise.intensity_share, " %"),
        ("intensity, the same for all,", noise.intensity, ""),
        ("rays lost", 100 * noise.loss, " %"),
    )
    return [f"{what} {value:.2g}{unit}" for what, value, unit in levels if value > 0]
