"""Whether an answer passes: thresholds a channel, effects that may be missing, and what was so before.

gate.json, all of it optional but one thing at least:

    {"thresholds": {"intensity": 0.10, "range": 0.05, "drop": 0.02},
     "allowed": ["random_dropout"],
     "baseline": "verdict.json",
     "effect_nats": 2.5,
     "frames": 15}

`save_gate` makes one from frames that are held to be right, so that nobody has to invent numbers.

Asked of a whole answer (`check_verdict`), or at every commit in seconds, of `distances` alone (`check_quick`).
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from jaxsim.discover.distances import DISTANCE_UNITS, QuickDistances
from jaxsim.discover.rules import RULES
from jaxsim.discover.verdict import Interval, Named, Verdict
from jaxsim.effects import EFFECTS
from jaxsim.files import check_keys, placed, read_json, real, write_text
from jaxsim.geometry.points import FAR_M
from jaxsim.progress import counted

Colour = Literal["pass", "gap", "unsure"]
NOT_NAMED = "not_in_catalogue"
"""Allowed where what nothing describes may be missing, too."""
NOT_COMPARED = "the channel was not compared"
OTHER_KIND = "an answer of another kind (--unpaired, or an older one)"
NOT_ASKED = "the two sides' intensities have no relation to each other, so no effect on them was asked"
LEFT = ("unexplained", "repeats")
"""Keys of a verdict.json for what no effect describes; it may stand beside effects that are named."""
GATE_KEYS = ("thresholds", "allowed", "baseline", "effect_nats", "frames")
"""What a gate.json may say."""


@dataclass(frozen=True)
class Gate:
    """What a gate asks."""

    thresholds: Mapping[str, float]
    """Largest distance a channel, in the units of the gap (`docs/verdict.md`) or, with --fast, of `DISTANCE_UNITS`."""
    allowed: frozenset[str]
    """Effects that may be missing; `not_in_catalogue` for what has no name. Only what is named beside these is a
    gap."""
    baseline: Mapping[str, Any]
    """A verdict.json of before: what it names may be missing, and distances may be as large. Empty where none is."""
    effect_nats: float = RULES.gate_effect_nats
    """What a named effect must gain on held-out scenes to be a gap, and what has no name on judge scenes beyond the
    named effects, nats each; of less the gate is unsure. Losses unpaired gain no nats and go by their p."""
    frames: int | None = None
    """How many frames must be compared at least. None: as many as the baseline had, less a tenth; with --fast, every
    measured frame."""

    @property
    def fewest_frames(self) -> int:
        """How many frames a whole answer must have compared."""
        return _most_of(self.baseline.get("frames") or 0) if self.frames is None else self.frames


@dataclass(frozen=True)
class Check:
    """One question of a gate and its answer."""

    name: str
    colour: Colour
    words: str


def read_gate(path: Path) -> Gate:
    """A gate.json. Raises ValueError where it is none, names an unknown channel or effect, or asks nothing."""
    content = read_json(path, by="gate", hint='{"thresholds": {"intensity": 0.1}, "allowed": [], "baseline": "x.json"}')
    if not isinstance(content, dict):
        raise ValueError(f"gate: {path} must be an object with any of {', '.join(GATE_KEYS)}")
    check_keys(content, GATE_KEYS, where=f"gate: {path}")
    if not content:
        raise ValueError(f"gate: {path} asks nothing; give any of {', '.join(GATE_KEYS)}")
    given = content.get("thresholds", {})
    if not isinstance(given, dict):
        raise ValueError(f"gate: {path}: thresholds must be an object of numbers by channel")
    check_keys(given, tuple(DISTANCE_UNITS), where=f"gate: {path}: thresholds")
    thresholds = {}
    for channel, value in given.items():
        thresholds[channel] = _number(value)
        if not thresholds[channel] > 0:
            raise ValueError(f"gate: {path}: the threshold of {channel} is {value!r}; it must be a number above 0")
    allowed = content.get("allowed", [])
    if not isinstance(allowed, list) or not all(isinstance(name, str) for name in allowed):
        raise ValueError(f"gate: {path}: allowed must be a list of effects' names")
    check_keys(dict.fromkeys(allowed), (*EFFECTS, NOT_NAMED), where=f"gate: {path}: allowed")
    given_nats = content.get("effect_nats", RULES.gate_effect_nats)
    nats = _number(given_nats)
    if not nats >= 0:
        raise ValueError(f"gate: {path}: effect_nats is {given_nats!r}; it must be a number, 0 or more")
    frames = _frames(content, path)
    return Gate(thresholds, frozenset(allowed), _baseline(path, content.get("baseline")), nats, frames)


def _frames(content: Mapping[str, Any], path: Path) -> int | None:
    """How many frames a gate or its baseline names. Raises ValueError where that is no whole number above 0."""
    frames = content.get("frames")
    if frames is not None and not (isinstance(frames, int) and not isinstance(frames, bool) and frames > 0):
        raise ValueError(f"gate: {path}: frames is {frames!r}; it must be a whole number above 0")
    return frames


def _most_of(frames: int) -> int:
    """How many frames must be there where there were so many."""
    return math.ceil(RULES.gate_frames_share * frames)


def _number(value: Any) -> float:
    """A number of a gate; -1 of what is none, so that a word and a number below 0 are refused in the same words."""
    try:
        return real(value)
    except (TypeError, ValueError):
        return -1.0


def thresholds_of(distances: Mapping[str, Interval]) -> dict[str, float]:
    """Thresholds of --fast from frames that are held to be right: a share of `Rules.gate_worse_share` above the upper
    end of each distance's interval, and at least `Rules.gate_least`, for frames on the measured ranges differ by
    nothing. Channels that no ray shows have none.

    Of simulators as right as these few turn red: docs/discover-rates.md#gates counts them.
    """
    return {
        name: max(distance.high * (1 + RULES.gate_worse_share), RULES.gate_least)
        for name, distance in distances.items()
        if np.isfinite(distance.high)
    }


def check_free(path: Path) -> None:
    """Raises ValueError where a file is there that is no gate, before one is written in its place."""
    if not path.exists():
        return
    with placed(f"gate: {path} is there, and is no gate", OSError, then="give another --write-gate"):
        content = read_json(path, by="gate")
        if not isinstance(content, dict) or not content or not {*content} <= {*GATE_KEYS}:
            raise ValueError(f"its keys are not among {', '.join(GATE_KEYS)}")


def save_gate(
    path: Path, *, thresholds: Mapping[str, float] | None = None, frames: int = 0, baseline: Path | None = None
) -> Path:
    """Writes a gate.json that asks for these thresholds (of --fast) on nearly as many `frames`, or for a verdict that
    is no worse than a baseline's, which is named by its place beside the gate.

    Raises ValueError where there would be nothing to ask, and where `path` is a file that is no gate.
    """
    check_free(path)
    content: dict[str, Any] = {}
    if thresholds:
        content["thresholds"] = {name: float(f"{value:.4g}") for name, value in thresholds.items()}
        if frames:
            content["frames"] = _most_of(frames)
    if baseline:
        content["baseline"] = os.path.relpath(baseline, path.parent)
    if not content:
        raise ValueError("gate: no ray of these frames shows a distance, so there is nothing to ask")
    return write_text(path, json.dumps(content, indent=1) + "\n")


def _baseline(path: Path, name: Any) -> Mapping[str, Any]:
    if name is None:
        return {}
    if not isinstance(name, str):
        raise ValueError(f"gate: {path}: baseline is {name!r}; it must be the path of a verdict.json")
    # Beside the gate, so that a checkout can be anywhere.
    file = path.parent / name
    content = read_json(file, by="gate")
    if not isinstance(content, dict) or not _is_verdict(content.get("effects"), content.get("gap", {})):
        raise ValueError(f"gate: {file} is no verdict.json; `jaxsim discover` writes one")
    _frames(content, file)
    return content


def _is_verdict(effects: Any, gap: Any) -> bool:
    """Whether these are a verdict's: named effects, and distances a channel, where it was compared."""
    if not isinstance(effects, list) or not isinstance(gap, dict):
        return False
    named = all(isinstance(effect, dict) and isinstance(effect.get("name"), str) for effect in effects)
    # A channel that was not compared is null, and the closure beside them has no `before`.
    distances = [channel.get("before") if isinstance(channel, dict) else channel for channel in gap.values()]
    return named and all(
        distance is None
        or (isinstance(distance, int | float) and not isinstance(distance, bool) and 0 <= distance <= FAR_M)
        for distance in distances
    )


def check_verdict(gate: Gate, verdict: Verdict) -> tuple[Check, ...]:
    """The checks of a whole answer."""
    before = {effect.get("name") for effect in gate.baseline.get("effects", [])}
    checks = [_named(gate, verdict, before)]
    if verdict.frames < gate.fewest_frames:
        checks.append(_too_few(verdict.frames, gate.fewest_frames))
    if verdict.unrelated and not gate.baseline.get("unrelated"):
        checks.append(Check("effects on intensity", "unsure", NOT_ASKED))

    def at_most(channel: str, most: float, *, name: str, limit: str, unit: str | None = None) -> Check:
        gap = verdict.gap.get(channel)
        if gap is None or not np.isfinite(gap.before):
            return Check(name, "unsure", NOT_COMPARED)
        if unit not in (None, gap.unit):
            return Check(name, "unsure", f"in {gap.unit} here and in {unit} in the baseline: {OTHER_KIND}")
        return Check(name, "pass" if gap.before <= most else "gap", f"{gap.before:.4g} {gap.unit}, {limit}")

    for channel, most in gate.thresholds.items():
        checks.append(at_most(channel, most, name=channel, limit=f"at most {most:g} may be"))
    for channel, old in (gate.baseline.get("gap") or {}).items():
        # What was not compared before is null, and the closure has no distance.
        if isinstance(old, dict) and isinstance(old.get("before"), int | float):
            # Of a distance of nothing a share is nothing, and rounding alone is more.
            most = max(old["before"] * (1 + RULES.gate_worse_share), RULES.gate_least)
            limit = f"{old['before']:.4g} before"
            name = f"{channel} against baseline"
            checks.append(at_most(channel, most, name=name, limit=limit, unit=old.get("unit")))
    return tuple(checks)


def _named(gate: Gate, verdict: Verdict, before: set[Any]) -> Check:
    new = [effect for effect in verdict.effects if effect.name not in gate.allowed | before]
    lacking = [
        f"{effect.name} ({', '.join(effect.channels)}, "
        f"p {effect.p_value:.2g}, {effect.gain.value:.3g} {effect.gain.unit})"
        for effect in new
    ]
    # An effect stands on the others that are named: if one of them is certain, so is that something is missing.
    certain = any(
        effect.gain.value >= gate.effect_nats if _in_nats(effect) else effect.p_value <= RULES.unpaired_level
        for effect in new
    )
    # What had no name before is nothing new, either.
    was_so = any(gate.baseline.get(key) for key in LEFT) or gate.baseline.get("verdict") == NOT_NAMED
    remains = verdict.verdict == NOT_NAMED or any(getattr(verdict, key) for key in LEFT)
    if remains and NOT_NAMED not in gate.allowed and not was_so:
        what = verdict.unexplained.covariate if verdict.unexplained else "its own coordinates"
        # Judge scenes gain by the named effects, too: only what is more than these gain for certain is its own.
        beside = sum(effect.gain.high for effect in verdict.effects if _in_nats(effect))
        nats = verdict.judged_nats(*verdict.gap) - beside
        beyond = " beyond the named effects" if verdict.effects else ""
        lacking.append(f"something that no effect describes, along {what} ({nats:.3g} nats a judge scene{beyond})")
        certain = certain or nats >= gate.effect_nats
    if certain:
        return Check("effects", "gap", f"the simulation lacks {', '.join(lacking)}")
    if lacking:
        least = f"under {gate.effect_nats:g} nats a scene chance may have found it"
        if not all(_in_nats(effect) for effect in new):
            least = f"{least}, and losses at a p above {RULES.unpaired_level:g}"
        return Check("effects", "unsure", f"the simulation may lack {', '.join(lacking)}; {least}")
    allowed = ", ".join(effect.name for effect in verdict.effects)
    return Check("effects", "pass", f"nothing but what may be: {allowed}" if allowed else "no effect is missing")


def _in_nats(effect: Named) -> bool:
    """Whether an effect's gain is a likelihood; of losses unpaired it is the share of rays that they cost."""
    return effect.gain.unit.startswith("nats")


def _too_few(frames: int, fewest: int) -> Check:
    words = f"{counted(frames, 'frame')} compared, and at least {fewest} must be: simulate the others"
    return Check("frames", "unsure", f'{words}, or give "frames" in the gate')


def check_distances(gate: Gate, distances: Mapping[str, Interval]) -> tuple[Check, ...]:
    """The checks of --fast: a channel is a gap where its whole interval lies above its threshold.

    Where the value alone does, chance can have done it, and the answer is unsure. Raises ValueError without thresholds,
    which are all that can be asked without naming.
    """
    if not gate.thresholds:
        raise ValueError("gate: --fast names nothing, so allowed and baseline say nothing to it; give thresholds")
    checks: list[Check] = []
    for channel, most in gate.thresholds.items():
        distance = distances[channel]
        if most > 1 and distance.unit.startswith("share"):
            raise ValueError(
                f"gate: the threshold of {channel} is {most:g}, and with --fast it is a {distance.unit}, which no "
                "simulation exceeds; give a number below 1, as 0.05"
            )
        between = f"({distance.low:.4g} .. {distance.high:.4g})"
        words = f"{distance.value:.4g} {between} {distance.unit}, at most {most:g} may be"
        if not np.isfinite(distance.value):
            checks.append(Check(channel, "unsure", "no ray shows it"))
        elif distance.value <= most:
            checks.append(Check(channel, "pass", words))
        else:
            checks.append(Check(channel, "gap" if distance.low > most else "unsure", words))
    return tuple(checks)


def check_quick(gate: Gate, shown: QuickDistances) -> tuple[Check, ...]:
    """The checks of --fast, and whether enough frames were compared."""
    fewest = shown.measured if gate.frames is None else gate.frames
    checks = check_distances(gate, shown.channels)
    return checks if shown.frames >= fewest else (*checks, _too_few(shown.frames, fewest))


def colour_of(checks: tuple[Check, ...]) -> Colour:
    """A gap where there is one, else unsure where something could not be judged."""
    colours = {check.colour for check in checks}
    return "gap" if "gap" in colours else "unsure" if "unsure" in colours else "pass"
