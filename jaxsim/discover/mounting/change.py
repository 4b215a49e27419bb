"""A sensor that stands otherwise in a part of the recording alone: it was knocked between two drives, or two cars
recorded.

A mounting is put in place for all frames (`constant`). Where it is off from a moment on, or in the frames of a tag, the
mean of all is off for everyone, and a fit of the likelihood arrives nowhere from so far away. But each frame was
registered for itself: of their motions the questions of `regimes` are asked, whether scenes inside a region stand
otherwise than those outside by more than deals of the scenes make (max-T over regions). Then the frames of that region
are brought to where the sensor stood.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from jaxsim.discover.model.cast import sectors_a_drive
from jaxsim.discover.model.evidence import POSE_SD
from jaxsim.discover.mounting.constant import OF_POSE, brought, gains, of_frames, parameters
from jaxsim.discover.read import Comparison
from jaxsim.discover.read.control import NO_CONTROL
from jaxsim.discover.read.registration import MOTION_PARTS, POSE, Registration, least_motion
from jaxsim.discover.read.search import register
from jaxsim.discover.regimes.confine import frames_in
from jaxsim.discover.regimes.questions import Facts, Question, questions
from jaxsim.discover.regimes.sizes import OF_FIT
from jaxsim.discover.rules import RULES
from jaxsim.discover.scenes import Split, chance_of, clipped, false_discovery_rates, orders_in_parts, scaled_groups
from jaxsim.discover.verdict import Interval, Named, Regime
from jaxsim.effects.region import Region
from jaxsim.metrics.intervals import mean_interval


@dataclass(frozen=True)
class Knock:
    """Where the sensor stands in a part of the recording, from where the simulator has it."""

    where: Region
    divides: str
    """time or tag."""
    effects: tuple[str, ...]
    """Names of those of OF_POSE that there is surely more of than a frame's own pose."""
    registered: Registration
    """The registration of the find scenes inside alone: among all they are pulled to the mean of all."""
    p_value: float
    q_value: float

    def inside(self, comparison: Comparison) -> Bool[np.ndarray, " f"]:
        """The frames of a comparison that lie in it."""
        return frames_in(self.where, facts_of_frames(comparison))

    def brought(self, comparison: Comparison) -> Comparison:
        """The comparison with the simulated frames inside as seen from where the sensor stood."""
        motion = np.where(self.inside(comparison)[:, None], self.registered.motion, 0.0)
        effects = of_frames(motion, rows=comparison.scan.range_m.shape[1])
        return brought(comparison, {name: effects[name] for name in self.effects})


def find_knock(comparison: Comparison, candidates: Collection[str], parts: Split) -> Knock | None:
    """The part of the recording in which the sensor stands otherwise, as the find scenes show it and by effects among
    the `candidates`; None where there is none, where the sensor is off everywhere, and beside a control."""
    registered = comparison.registration
    if registered is None or registered.early_or_late or registered.sure or comparison.control is not NO_CONTROL:
        return None
    if sectors_a_drive(comparison.scenes) > 1:
        # What some of few drives have and others have not may be anything.
        return None
    facts = facts_of_frames(comparison)
    # Sectors divide no pose.
    asked = [question for question in questions(facts) if question.divides != "azimuth"]
    names = np.array(list(dict.fromkeys(comparison.scenes)))
    poses = np.stack([np.median(registered.frames[facts.scene == n], axis=0) for n in range(len(names))])
    found = list(_divided(asked, poses, facts=facts, find=np.isin(names, parts.find)))
    if not found:
        return None
    rates = false_discovery_rates(np.array([p for _, _, p in found]))
    best = int(np.argmin(rates))
    question, k, p = found[best]
    if rates[best] > RULES.regime_level:
        return None
    whole = question.inside[k][:, 0]
    inside = np.array([whole[facts.scene == n].all() for n in range(len(names))])
    learn = np.isin(comparison.scenes, names[inside & np.isin(names, parts.find)])
    of_region = _registered(comparison, learn)
    outside = np.median(poses[~inside], axis=0)
    # Off on both sides of a moment it is no knock of a sensor that stood right.
    effects = tuple(
        name
        for name in OF_POSE
        if name in candidates and name in of_region.sure and _far(outside[MOTION_PARTS[name]]) <= least_motion(name)
    )
    if not effects:
        return None
    return Knock(question.regions[k], question.divides, effects, of_region, p, float(rates[best]))


def _registered(comparison: Comparison, frames: Bool[np.ndarray, " f"]) -> Registration:
    """The registration of some of the frames alone."""
    scan = comparison.scan
    rasters = {name: getattr(scan, name)[frames] for name in ("range_m", "hit", "slopes", "phase")}
    range_m, valid = comparison.measured.range_m[frames], comparison.measured.valid[frames]
    return register(replace(scan, **rasters), range_m, valid, scenes=np.array(comparison.scenes)[frames].tolist())


def _divided(
    asked: Sequence[Question], poses: Float[np.ndarray, "n 8"], *, facts: Facts, find: Bool[np.ndarray, " n"]
) -> Iterator[tuple[Question, int, float]]:
    """Gives, for each question, the region whose find scenes stand most otherwise than the rest, and how often
    chance makes some region stand so."""
    few = RULES.regime_fewest_scenes
    z = poses[:, POSE] / POSE_SD
    for question in asked:
        whole = question.between_scenes(facts.scene)
        if whole is None:
            continue
        count = whole[:, find].sum(1)
        # What stands where the simulator has it is the other part.
        off = np.array([_far(z[one].mean(0)) > _far(z[~one].mean(0)) for one in whole])
        enough = np.flatnonzero(off & (count >= few) & (find.sum() - count >= few))
        if len(enough):
            k, p = apart(z[find], whole[enough][:, find])
            # A cut lies anywhere between two find scenes: that one which all scenes bear out best.
            same = enough[(whole[enough][:, find] == whole[enough[k], find]).all(1)]
            between = [_far(z[whole[one]].mean(0) - z[~whole[one]].mean(0)) for one in same]
            yield question, int(same[np.argmax(between)]), p


def apart(z: Float[np.ndarray, "n m"], whole: Bool[np.ndarray, "k n"]) -> tuple[int, float]:
    """The group of scenes (a row says which are in it) whose mean vector lies farthest from that of the others, and how
    often some group's does when vectors are dealt out to the scenes anew. In no number of it does a scene count for
    more than the third largest."""
    off = np.stack([clipped(number - np.median(number)) for number in z.T], axis=1)
    off = off - off.mean(0)
    scaled = scaled_groups(whole)
    observed = np.linalg.norm(scaled @ off, axis=1)
    best = int(observed.argmax())
    farthest = [np.linalg.norm(scaled @ off[some], axis=2).max(1) for some in orders_in_parts(len(off))]
    return best, chance_of(np.concatenate(farthest), observed[best])


def _far(z: Float[np.ndarray, " m"]) -> float:
    return float(np.linalg.norm(z))


def named_knock(
    knock: Knock, comparison: Comparison, parts: Split
) -> tuple[tuple[Named, ...], tuple[Named, ...], tuple[Regime, ...]]:
    """The effects of a knock that are confirmed on judge scenes, those that are not, and the regimes of the former."""
    registered = comparison.registration
    assert registered is not None, "a knock was found without a registration"
    held = knock.inside(comparison)
    inside = [name for name, part in zip(comparison.scenes, held, strict=True) if part]
    parts_inside = replace(
        parts,
        find=tuple(name for name in parts.find if name in inside),
        judge=tuple(name for name in parts.judge if name in inside),
    )
    confirmed: list[Named] = []
    unconfirmed: list[Named] = []
    regimes: list[Regime] = []
    for name in knock.effects:
        part = MOTION_PARTS[name]
        on_find, on_judge = gains(registered.frames[held], part, scenes=inside, parts=parts_inside)
        gain = clipped(on_find)
        nats = Interval.of_scenes(gain, "nats per scene inside")
        effect = Named.alone(name, knock.p_value, nats, parameters=parameters(knock.registered, name))
        judged = float(on_judge.mean()) if len(on_judge) else 0.0
        if gain.sum() <= RULES.bar_nats or judged <= 0:
            unconfirmed.append(effect)
            continue
        confirmed.append(effect)
        regimes.append(_regime(knock, part, comparison, judge_nats=judged))
    return tuple(confirmed), tuple(unconfirmed), tuple(regimes)


def _regime(knock: Knock, part: slice, comparison: Comparison, *, judge_nats: float) -> Regime:
    """The verdict's entry: how far each scene stands along the motion of those inside."""
    registered = comparison.registration
    assert registered is not None
    held = knock.inside(comparison)
    z = registered.frames[:, part] / POSE_SD[part]
    towards = z[held].mean(0)
    size = z @ towards / (towards @ towards)
    scene = np.unique(comparison.scenes, return_inverse=True)[1]
    count = np.bincount(scene)
    of_scene = np.bincount(scene, size) / count
    holds = np.bincount(scene, held) > 0
    time_s = np.bincount(scene, np.asarray(comparison.scan.time_s, float)) / count
    counted = len(np.unique(time_s)) < len(time_s)
    order = np.argsort(time_s, kind="stable")

    def interval(sizes: Float[np.ndarray, " n"]) -> Interval:
        return Interval(float(sizes.mean()), *mean_interval(sizes), OF_FIT)

    x = np.arange(len(order), dtype=float) if counted else time_s[order]
    return Regime(
        effect=next(name for name, of in MOTION_PARTS.items() if of == part),
        divides=knock.divides,
        where=knock.where,
        share=float(held.mean()),
        inside=interval(of_scene[holds]),
        outside=interval(of_scene[~holds]),
        p_value=knock.p_value,
        q_value=knock.q_value,
        judge_nats=judge_nats,
        applied=knock.where.acts,
        x=tuple(map(float, x)),
        sizes=tuple(map(float, of_scene[order])),
        held=tuple(map(bool, holds[order])),
        counted=counted,
    )


def facts_of_frames(comparison: Comparison) -> Facts:
    """The facts of all frames, a block each."""
    frames = np.arange(len(comparison.scenes))
    number = {name: k for k, name in enumerate(dict.fromkeys(comparison.scenes))}
    scene = np.array([number[name] for name in comparison.scenes])
    return Facts(comparison.scan, comparison.scenes, frames, scene, np.zeros((len(frames), 1), int))
