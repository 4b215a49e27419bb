"""A verdict in words: the sentence that says it, and how its names are written."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jaxsim.data.cityscapes import NAMES
from jaxsim.discover.verdict import Interval, Named, Regime, Repeat, Unexplained, Verdict
from jaxsim.discover.verdict.names import HUE_ANGLE, SCALES
from jaxsim.effects import EFFECTS
from jaxsim.report.page import Real, number, percent

_Line = Float[np.ndarray, " k"]


class SignWords(NamedTuple):
    """A channel in words: what the two signs of its residual mean."""

    unit: str
    """Unit of the residual."""
    positive: str
    """What a residual above 0 means."""
    negative: str
    """What one below 0 means."""
    readings: str
    """What the channel's readings are called."""


SIGN_WORDS = {
    "intensity": SignWords("ln I, nats", "measured brighter than simulated", "measured darker", "the intensities"),
    "range": SignWords("range, m", "measured farther than simulated", "measured nearer", "the ranges"),
    "drop": SignWords("share of rays", "more rays lost than expected", "fewer lost", "the returns"),
}
"""Names of residuals, measured minus simulated."""


class Axis(NamedTuple):
    """How a covariate's values are shown."""

    label: str
    shown: Callable[[_Line], _Line] = np.asarray
    """From the values that residuals are compared along to those on the axis."""
    x: str = ""
    """What a formula's x is, if not what the axis shows."""


AXES = {
    "range": Axis("range, m", np.exp, "the natural logarithm of the range in m"),
    "incidence": Axis("incidence angle, °", np.rad2deg, "the incidence angle in rad"),
    "height": Axis("height over the sensor, m"),
    "row": Axis("row (0 = top beam)"),
    "even rows": Axis("0 on even rows, 1 on odd ones"),
    "column": Axis("column (0 = leftmost)"),
    "even columns": Axis("0 on even columns, 1 on odd ones"),
    "azimuth": Axis("azimuth, ° (grows to the left)", np.rad2deg, "the azimuth in rad"),
    "class": Axis("Cityscapes id"),
    "power": Axis("simulated ln P, nats"),
    "intensity": Axis("simulated ln I, nats"),
    "step": Axis("depth step to the side, ln(1 + |step| / 0.3 m)"),
    "step side": Axis("depth step to the side, ln(1 + |step| / 0.3 m), above 0 to the right"),
    "time": Axis("place within the scan, 0..1"),
    "speed x time": Axis("speed times place within the scan, less half, times the cosine of the azimuth, m/s"),
    "frame": Axis("time since the first frame, s"),
    "speed": Axis("speed, m/s"),
    "heading": Axis("direction in the world, °", np.rad2deg, "the direction in the world in rad"),
    "rgb": Axis("brightness of the camera pixel, 0..1"),
    "hue": Axis("red less blue of the camera pixel, −1..1"),
    HUE_ANGLE: Axis("hue angle of the camera pixel, °", np.rad2deg, "the hue angle of the camera pixel in rad"),
}
"""Names of the covariates of rays (jaxsim.effects.rays), finer looks at others among them."""

NUISANCES = {
    "intensity": ("spread of ln I that nothing explains", "nats"),
    "normals": ("noise on the simulator's normals", "rad"),
    "range_": ("spread of the range that nothing explains", "m"),
    "aim": ("angle by which beams miss their direction", "rad"),
    "edge": ("spread of the range at edges", "m"),
    "wide": ("ranges far off, on smooth surfaces", ""),
    "wide_edge": ("ranges far off, at edges", ""),
    "switch_edge": ("edges where a neighbour's range is read", ""),
    "drop": ("rays lost, on smooth surfaces", ""),
    "drop_edge": ("rays lost, at edges", ""),
    "drop_sky": ("rays lost, beside the sky", ""),
    "false": ("returns where the simulated ray hits nothing", ""),
    "false_edge": ("the same, beside a surface", ""),
}
"""Meaning and unit of jaxsim.discover.model.noise.Noise: logarithms of scales, or log odds of rates (no unit)."""


def nuisance_title(name: str) -> str:
    """What a nuisance is called; classes by Cityscapes' names, as targets are."""
    kind, _, of = name.partition(" ")
    return NAMES.get(int(of), name) if kind == "class" and of.isdecimal() else NUISANCES.get(name, (name, ""))[0]


def nuisance(name: str, value: Real) -> str:
    """A noise scale with its unit, or a rate as a share."""
    if name not in NUISANCES:
        return number(value)
    unit = NUISANCES[name][1]
    return f"{number(math.exp(value))} {unit}" if unit else f"{number(100 / (1 + math.exp(-value)))} %"


def span(interval: Interval) -> str:
    """`low to high`."""
    return f"{number(interval.low)} to {number(interval.high)}"


def listed(names: Sequence[str], join: str = "and") -> str:
    """`a`, `a and b`, `a, b and c`."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} {join} {names[-1]}"


def title_of(name: str) -> str:
    """What the catalogue calls an effect; empty for one that it does not hold."""
    return EFFECTS[name].title if name in EFFECTS else ""


def title_as_found(effect: Named) -> str:
    """What the catalogue calls an effect, or its opposite where that is what was found; empty for one that it does not
    hold."""
    known = EFFECTS.get(effect.name)
    if known is None or not known.opposite:
        return title_of(effect.name)
    first = next(iter(known.parameters))
    found = effect.parameters.get(first)
    below = isinstance(found, Interval) and found.value < known.parameters[first].neutral
    return known.opposite if below else known.title


def verdict_sentence(verdict: Verdict) -> str:
    """The answer in one plain sentence, or two where the data leave a choice."""
    named = [f"{e.name} ({title})" if (title := title_as_found(e)) else e.name for e in verdict.effects]
    lacks = f"The simulation lacks {listed(named)}" if named else ""
    besides = f" Besides, {repeat_in_words(verdict.repeats[0])}." if verdict.repeats else ""
    besides += _together(verdict)
    besides = "".join(_acts(one) for one in verdict.regimes) + besides
    unexplained = verdict.unexplained
    repeats = unexplained and verdict.repeats and unexplained.formula == verdict.repeats[0].formula
    if verdict.verdict == "named":
        if unexplained and not repeats:
            besides = f" Besides, there is a {dependence(unexplained)} that is not in the catalogue.{besides}"
        return lacks + _closed(verdict) + "." + _choice(verdict) + besides
    if verdict.verdict == "not_in_catalogue":
        rest = f": a {dependence(unexplained)}" if unexplained else ""
        if repeats:
            # What repeats is all that there is.
            rest, besides = f": {repeat_in_words(verdict.repeats[0])}", ""
        head = f"{lacks}, and something else" if lacks else "The simulation lacks something"
        return f"{head} that is not in the catalogue{rest}." + _choice(verdict) + besides
    return (
        "No missing effect was found: nothing in the catalogue explains held-out scenes better than the null model "
        f"by enough to be named, with {len(verdict.find)} scenes to find it in.{besides}{_unseen(verdict)}"
    )


def _unseen(verdict: Verdict) -> str:
    """What *none* does not rule out."""
    hidden = [one.name for one in verdict.not_testable]
    if not hidden:
        return ""
    return (
        f" These frames could not have shown {listed(hidden)} at half of a clearly visible size: what to record "
        "instead stands below."
    )


def _together(verdict: Verdict) -> str:
    """What keeps the two sides apart, or kept them; empty where nothing does."""
    registered = verdict.registered
    words = ""
    if verdict.unrelated:
        words += " The two sides' intensities have no relation to each other, so no effect on them could be asked."
    if verdict.control and verdict.control.names:
        words += f" Aside stands what the simulator lacks by itself (the control): {listed(verdict.control.names)}."
    if verdict.contrast:
        slopes = verdict.contrast.slopes
        weakest = min((one for one in slopes if one not in SCALES), key=lambda one: slopes[one].high)
        words += (
            f" The sensor follows the simulator's differences of ln I by {number(slopes['cells'].value)} from cell to "
            f"cell and, least of all, by {number(slopes[weakest].value)} within {weakest.replace('_', ' ')}: the "
            "simulator's error, beside which all was asked."
        )
    if registered and registered.other_moments:
        words += " The measured frames are of other moments than the simulated ones."
    elif registered and registered.sure:
        words += f" So registered, ranges agree on {percent(registered.near[1])} of the points, as given on "
        words += f"{percent(registered.near[0])}."
    return words


WIDEST = 2.0
"""Shares of a gap whose interval is wider than this say nothing: what is shared is next to nothing."""


def _closed(verdict: Verdict) -> str:
    """What adding the effects did on judge scenes."""
    c, count = verdict.closure, len(verdict.judge)
    it = "them" if len(verdict.effects) > 1 else "it"
    where = f"{count} scenes that nothing was fitted to"
    if c is None or c.high - c.low > WIDEST:
        rest = "nothing for certain" if c is None else "too little to be measured by"
        return _gained(verdict, f"; adding {it} makes {{}} of {where} more probable", rest)
    if min(c.value, c.low) > 0.999:
        return f"; adding {it} brings the two as near as free curves can, or nearer, on {where}"
    return (
        f"; adding {it} closes {percent(c.value)} of the explainable gap (90 % interval {percent(c.low)} to "
        f"{percent(c.high)}) on {where}"
    )


def _gained(verdict: Verdict, words: str, rest: str) -> str:
    """The channel of the named effects that gains most for certain, and that free curves gain `rest`; empty where none
    does."""
    channels = {channel for effect in verdict.effects for channel in effect.channels}
    sides = {name: g.gained for name, g in verdict.gap.items() if name in channels and g.gained and g.gained.low > 0}
    if not sides:
        return ""
    name, g = max(sides.items(), key=lambda side: side[1].value)
    gains = words.format(SIGN_WORDS[name].readings)
    interval = f"90 % interval {number(g.low)} to {number(g.high)}"
    return f"{gains}, by {number(g.value)} nats per scene ({interval}), where free curves gain {rest}"


def _choice(verdict: Verdict) -> str:
    """Look-alikes, if the data leave any."""
    parts = [f"{e.name} from {listed(e.look_alikes, 'or')}" for e in verdict.effects if e.look_alikes]
    return f" These data cannot tell {listed(parts, 'nor')}." if parts else ""


def repeat_in_words(one: Repeat) -> str:
    """What comes back in every scene, where, and how large."""
    size = f"{number(one.size.value)} {one.size.unit}"
    period = "" if one.period is None else f", period {number(one.period)} {_counted(one.along)}"
    return f"{one.channel} off by {size} in every scene at the same {_counted(one.along)} ({one.place}{period})"


def part_of(one: Regime) -> str:
    """Tells where an effect acts, in words."""
    where = one.where
    if where.azimuth_rad:
        low, high = np.rad2deg(where.azimuth_rad).tolist()
        return f"between {_degrees(low)} and {_degrees(high)} of azimuth"
    if where.time_s:
        first, last = where.time_s
        if last is None:
            return f"from {number(first)} s on"
        return f"until {number(last)} s" if first is None else f"from {number(first)} s to {number(last)} s"
    if where.tag is not None:
        return f"in frames tagged {where.tag}"
    return f"in {len(where.scenes)} drives that nothing in grid.json tells from the others"


def _degrees(angle: float) -> str:
    return f"{round((angle + 180) % 360 - 180)}°".replace("-", "−")


def _acts(one: Regime) -> str:
    """Tells where a named effect acts, and that it is not applied where simulations cannot know."""
    where_not = "" if one.applied else "; simulations cannot know where, and do not apply it"
    return f" {one.effect} acts {part_of(one)} alone ({percent(one.share)} of the rays){where_not}."


def _counted(along: str) -> str:
    return {"row": "rows", "column": "columns"}.get(along, "rows and columns")


def dependence(one: Unexplained) -> str:
    """Tells what depends on what, and its character where it has one."""
    kind = "dependence" if one.character == "other" else f"{one.character} dependence"
    along = "the time since the first frame" if one.covariate == "frame" else one.covariate
    return f"{kind} of {one.channel} on {along}"
