"""An answer is one only if scenes that nothing was fitted to gain by it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from jaxsim.discover.rules import RULES
from jaxsim.discover.verdict import Gap, Named, Verdict
from jaxsim.effects.chain import SensorModel

WHY_NOT = "scenes that it was not fitted to do not gain by it"


def judged_nats(effect: Named, gap: Mapping[str, Gap]) -> float:
    """What judge scenes gain in the channels of an effect, in their mean, with all that was named in place: nats."""
    told = [gap[channel].gained for channel in effect.channels if channel in gap]
    return sum(one.value for one in told if one is not None)


def confirmed(verdict: Verdict) -> Verdict:
    """The verdict without the effects by which its judge scenes do not gain: these are kept as `unconfirmed`. The gap
    still shows what all of them do.

    The mean decides, not its interval: judge scenes are few, and right effects may be rare or weak
    (`Rules.confirmed_nats`).
    """
    lost = tuple(effect for effect in verdict.effects if judged_nats(effect, verdict.gap) <= RULES.confirmed_nats)
    if not lost:
        return verdict
    confirmed_effects = tuple(effect for effect in verdict.effects if effect not in lost)
    names = [effect.name for effect in lost]
    note = (
        f"not confirmed on unseen scenes: {', '.join(names)} explained the scenes that the search saw, but the "
        f"{len(verdict.judge)} judge scenes do not gain in the mean; it is not named. The gap is shown with it in place"
    )
    answer = verdict.verdict
    if answer == "named" and not confirmed_effects:
        # What is not confirmed leaves a disagreement: it is named as such where a curve showed one.
        answer = "not_in_catalogue" if verdict.unexplained else "none"
    return replace(
        verdict,
        verdict=answer,
        effects=confirmed_effects,
        unconfirmed=lost,
        ranking=tuple(replace(rank, why_not=WHY_NOT) if rank.name in names else rank for rank in verdict.ranking),
        notes=(*verdict.notes, note),
    )


def with_mounting(verdict: Verdict, sure: tuple[Named, ...], others: tuple[Named, ...]) -> Verdict:
    """The verdict with the effects of a mounting before what was named with them in place; `others` were found and not
    confirmed."""
    if not sure and not others:
        return verdict
    names = ", ".join(effect.name for effect in (*sure, *others))
    note = (
        f"{names}: found by registering the ranges of both sides; everything else was asked, and the gap is shown, "
        "with the simulated frames as seen from there"
    )
    return replace(
        verdict,
        verdict="named" if sure and verdict.verdict == "none" else verdict.verdict,
        effects=(*sure, *verdict.effects),
        unconfirmed=(*others, *verdict.unconfirmed),
        notes=(*verdict.notes, note),
    )


def sensor_of(verdict: Verdict, added: SensorModel, known: SensorModel) -> SensorModel:
    """What the sensor model holds after the verdict: what was `known`, the effects that it names of a mounting, and
    what was `added`, but for effects that are not confirmed."""
    held = {name for name, _ in known.effects}
    added_names = {name for name, _ in added.effects}
    lost = {effect.name for effect in verdict.unconfirmed} - held
    mounting = [(one.name, one.values) for one in verdict.effects if one.name not in added_names | held]
    stated = [pair for pair in known.effects if pair[0] not in added_names]
    kept = [pair for pair in added.effects if pair[0] not in lost]
    if not mounting and not stated and len(kept) == len(added.effects):
        return added
    return replace(added, effects=(*stated, *mounting, *kept))
