"""A report's evidence: where the two disagree, residual maps and curves, the gap on unseen scenes, what moved."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from markupsafe import Markup

from jaxsim.discover.rules import RULES
from jaxsim.discover.verdict import CurveLine, Result, Verdict
from jaxsim.discover.verdict.names import CATEGORICAL
from jaxsim.discover.verdict.parts import Contrast, Fidelity, Gained, Gap, Interval, Level, Where
from jaxsim.report import page
from jaxsim.report.canvas import AFTER, BEFORE
from jaxsim.report.charts import SHARE_SHOWN, curve_chart, draw_maps, root_mean_square
from jaxsim.report.page import EMPTY, DrawChart, number, percent, probability
from jaxsim.report.words import AXES, SIGN_WORDS, Axis, nuisance, nuisance_title, span

NO_CHANGE = 0.005
"""A change below this share of the distance is none that matters, however sure its sign."""


def dependence_table(places: Sequence[Where]) -> Markup:
    """Channels and the covariates on which their residuals depend."""
    title = "Where simulation and measurement disagree"
    if not places:
        text = "No dependence of the residuals on any covariate was found, once the nuisances are fitted."
        return page.section(title, text)
    rows = [
        [
            page.shows(p.channel, channel=p.channel, figures=[_curve(p.channel, p.covariate)]),
            p.covariate,
            probability(p.p_value),
            _share(p.share),
        ]
        for p in places
    ]
    words = (
        "Dependences of the residuals after class reflectances, gain, noise and pose were fitted; each covariate "
        "counts for what it adds to those above it in its channel, a pair (A × B) for what no single one explains. "
        "p: that the strongest of all covariates, or pairs, of all channels agrees so well by chance. "
        "Share: of the residual variance on held-out scenes."
    )
    return page.section(title, words, page.table(["channel", "covariate", "p", "share"], rows, text=2))


def of_channel(channel: str, words: str) -> Markup:
    """Words by which the viewer colours rays by a channel, and marks its map."""
    return page.shows(words, channel=channel, figures=[f"map_{page.file_name(channel)}"])


def _curve(channel: str, covariate: str, *, spread: bool = False) -> str:
    """Name of a curve's figure."""
    return page.file_name("curve", channel, covariate, *(["spread"] if spread else []))


def _share(share: float) -> str:
    return "< 1 %" if 0 < share < 0.005 else percent(share)


def maps(result: Result, draw: DrawChart) -> Markup:
    """Residuals on the polar grid, before and after."""
    parts = []
    for channel, sides in SIGN_WORDS.items():
        before, after = result.maps_before.get(channel), result.maps_after.get(channel)
        if before is None or after is None:
            continue
        shown = [("before", before), ("after", after)] if result.verdict.changed else [("residual", before)]
        sizes = " → ".join(number(root_mean_square(values)) for _, values in shown)
        parts.append(
            draw(
                f"map_{page.file_name(channel)}",
                draw_maps(shown, result.grid, unit=sides.unit, name=channel),
                f"{channel.capitalize()}. Red: {sides.positive}; blue: {sides.negative}; grey: nothing compared. "
                f"Root mean square over cells: {sizes}.",
            )
        )
    explain = (
        "Mean residual of each cell over the judge scenes, measured minus simulated. Colours end at the "
        f"{SHARE_SHOWN}th percentile of its size, or at its root mean square if that is larger."
    )
    return page.section("Residual maps on judge scenes", explain, *parts) if parts else EMPTY


def curves(lines: Iterable[CurveLine], draw: DrawChart) -> Markup:
    """Residuals along covariates, before and after."""
    parts = []
    for order, curve in enumerate(lines):
        axis = AXES.get(curve.covariate, Axis(curve.covariate))
        pair = (("before", np.asarray(curve.before, float), BEFORE), ("after", np.asarray(curve.after, float), AFTER))
        chart = curve_chart(
            axis.shown(np.asarray(curve.x, float)),
            pair,
            np.asarray(curve.band, float),
            x_label=axis.label,
            y_label=curve.unit if curve.spread or curve.channel not in SIGN_WORDS else SIGN_WORDS[curve.channel].unit,
            joined=curve.covariate != "class",
            whole=curve.covariate in CATEGORICAL,
            name=f"curve {order}" if curve.edges is not None else "",
        )
        caption = f"{curve.channel.capitalize()} along {curve.covariate}: {curve.unit}."
        parts.append(draw(_curve(curve.channel, curve.covariate, spread=curve.spread), chart, caption))
    if not parts:
        return EMPTY
    legend = page.key(
        [("before, with its 90 % band from the scatter between scenes", "before", True), ("after", "after", False)]
    )
    intro = (
        "Mean residual on judge scenes along the covariates by which the effect betrays itself; of an effect that "
        "makes readings scatter, also their spread over the one that each ray is expected to have."
    )
    return page.section("Along the effect's own covariates", intro, legend, *parts)


LEVEL_TITLES = {
    "range_noise": ("range noise", "range", 100.0, "cm"),
    "intensity_noise": ("intensity noise, in proportion", "intensity", 100.0, "%"),
    "intensity_noise_constant": ("intensity noise, the same for all", "intensity", 1.0, ""),
    "random_loss": ("rays lost within surfaces", "drop", 100.0, "%"),
    "intensity_step": ("steps of the intensity", "intensity", 1.0, ""),
    "range_step": ("steps of the range", "range", 100.0, "cm"),
}
"""Titles of levels, the channel that shows each, and the unit that they are shown in."""


def levels(compared: Sequence[Level]) -> Markup:
    """Noise, losses and lattices of both sides, and what the simulator lacks of them."""
    rows = []
    for one in compared:
        title, channel, factor, unit = LEVEL_TITLES[one.name]
        sides = [_level(side, factor, unit) for side in (one.simulated, one.measured, one.missing)]
        rows.append([of_channel(channel, title), *sides, "more than usual" if one.beyond_usual else ""])
    if not rows:
        return EMPTY
    words = (
        "Told from neighbouring rays of one surface, each side by itself; with 90 % intervals over scenes. No "
        "discovery: what is missing goes into sensor.json as levels, which simulations draw. A sensor's intensity "
        "noise holds texture finer than its rays."
    )
    return page.section("Levels", words, page.table(["level", "simulated", "measured", "missing", ""], rows, text=1))


SCALE_TITLES = {
    "cells": "a cell, and the eight about it",
    "patches": "these, and the patch about them",
}
"""What is held against what on a scale of the simulator's contrast, where that is no class."""


def contrast(finding: Contrast | None) -> Markup:
    """How far the sensor follows the simulator's contrast, where its slopes differ by scale."""
    if finding is None:
        return EMPTY
    usual = "a cell, and what is usual at its angle and range of"
    rows = [
        [SCALE_TITLES.get(scale, f"{usual} {scale.replace('_', ' ')}"), number(one.value), span(one)]
        for scale, one in finding.slopes.items()
    ]
    words = (
        "A law of the sensor bends readings one by one, so that measured differences follow simulated ones by one "
        "slope on every scale and in every class. Here they do not, and that is the simulator's error: what it learned "
        "or blurred is too weak from cell to cell (above 1), and of the differences between surfaces of a class, at "
        "the same angle and range, part is made up, or materials are other ones (below "
        f"1). Scenes that were not fitted gained {number(finding.gain.value)} nats each by it. All that is named was "
        "asked with these slopes free: it counts by what it explains along ranges, angles and rows and between "
        "classes, and no curve along intensities or colours was asked."
    )
    head = ["differences between", "measured over simulated", "90 % interval"]
    return page.section("The simulator's contrast", words, page.table(head, rows, text=1))


def objects(kinds: Sequence[Fidelity]) -> Markup:
    """Points and mean intensity a target, simulated against measured, before anything is added."""
    if not kinds:
        return EMPTY
    rows = [
        [one.kind, str(one.targets), *map(_error, (one.points, one.points_more, one.intensity, one.intensity_more))]
        for one in kinds
    ]
    words = (
        "How many points each target has and how bright it is, before anything is added: error of the simulation in "
        "per cent of the measured value, as mean absolute error and signed (above 0: the simulation has more); means "
        "over scenes with 90 % intervals."
    )
    head = ["target", "seen", "points, error", "points, signed", "intensity, error", "intensity, signed"]
    return page.section("Targets", words, page.table(head, rows, text=1))


def _error(one: Interval) -> str:
    if not np.isfinite(one.value):
        return "-"
    value, interval = f"{one.value:.1f} %", f"{one.low:.1f} to {one.high:.1f}"
    return page.below(value.replace("-", "−"), interval.replace("-", "−"))


def _level(side: Interval, factor: float, unit: str) -> str:
    if side.value == 0 and not side.high > 0:
        return "none"
    value = f"{number(factor * side.value)} {unit}".strip()
    if side.low == side.high:
        return value
    return page.below(value, f"{number(factor * side.low)} to {number(factor * side.high)}")


def gap(verdict: Verdict) -> Markup:
    """Errors by channel before and after, what the likelihood gains, beside floor and placebo, and the closure."""
    if not verdict.gap:
        return EMPTY
    added, rival = verdict.changed, _has_rival(verdict)
    rows = [
        [
            page.below(of_channel(name, name), g.unit),
            number(g.before),
            *([number(g.after), _change(g), percent(g.win_rate)] if added else []),
            number(g.floor),
            *([number(g.placebo)] if rival else []),
        ]
        for name, g in verdict.gap.items()
    ]
    columns = ["after", "before − after, 90 %", "scenes better"] if added else []
    head = ["channel", "before", *columns, "floor", *(["placebo"] if rival else [])]
    words = (
        "Mean errors of the simulation on scenes that nothing was fitted to; a scene counts once. "
        "Floor: what a free additive model reaches with the same data."
    )
    if rival:
        words += " Placebo: with the runner-up added instead, fitted in the same way."
    if added:
        words += (
            " Intervals: Student's t over scenes, each held against itself. Not worse: at 95 %, the error grew by "
            f"less than {percent(RULES.not_worse_share)}."
        )
    return page.section("The gap on judge scenes", words, page.table(head, rows, text=1), _gained(verdict))


def _has_rival(verdict: Verdict) -> bool:
    """Whether a runner-up was fitted as a placebo: it takes the place of an effect, and a law alone has none."""
    return bool(verdict.effects or verdict.unconfirmed)


def _gained(verdict: Verdict) -> Markup:
    """What the likelihood of judge scenes gains by channel, and the closure."""
    sides = {name: g.gained for name, g in verdict.gap.items() if g.gained}
    if not sides or not verdict.changed:
        return EMPTY
    bar = verdict.ranking[0].bar if verdict.ranking else 0.0
    rival = _has_rival(verdict)
    rows = [
        [
            name,
            number(g.value),
            page.below(f"{number(g.low)} to {number(g.high)}", _gain(g, bar)),
            percent(g.win_rate),
            number(g.floor),
            *([number(g.placebo)] if rival else []),
        ]
        for name, g in sides.items()
    ]
    words = (
        "Log-likelihood that the same scenes gain with all in place that was found, nats per scene: the measure that "
        "effects are named by, here on scenes that nothing was fitted to. It also counts scatter, lattices and rare "
        "readings, which a mean error does not see."
    )
    head = ["channel", "gained", "90 %", "scenes better", "floor", *(["placebo"] if rival else [])]
    parts = [words, page.table(head, rows, text=1)]
    if verdict.closure:
        c = verdict.closure
        parts.append(
            f"Closure, gained / gained by the floor over the channels that what was found changes: "
            f"{percent(c.value)} (90 % interval {percent(c.low)} to {percent(c.high)})."
        )
    return page.join_parts(parts)


def _gain(gained: Gained, bar: float) -> str:
    """What the interval says; less than an effect must gain to be named is as good as nothing."""
    if max(abs(gained.low), abs(gained.high)) < bar:
        return "as before"
    return "gains" if gained.low > 0 else "loses" if gained.high < 0 else "undecided"


def _change(gap: Gap) -> str:
    """The interval of a channel's change, and what it says."""
    if not (np.isfinite(gap.low) and np.isfinite(gap.high)):
        return "not compared"
    small = max(abs(gap.low), abs(gap.high)) < NO_CHANGE * gap.before
    unclear = "not worse" if gap.not_worse else "may be worse"
    word = "unchanged" if small else "shrank" if gap.low > 0 else "grew" if gap.high < 0 else unclear
    return page.below(f"{number(gap.low)} to {number(gap.high)}", word)


def moved(verdict: Verdict) -> Markup:
    """Nuisances without the effects and with them."""
    if not verdict.moved or not verdict.changed:
        return EMPTY
    rows = [
        [nuisance_title(name), nuisance(name, before), nuisance(name, after)]
        for name, (before, after) in verdict.moved.items()
    ]
    words = (
        "Noise scales and rates of the null model, and natural logarithms of the overall gain and of each class's "
        "reflectance over the simulator's, fitted without the effects and again with them; of several effects also "
        "their parameters, as fitted when each was added and with the others in place."
    )
    table = page.table(["", "before", "after"], rows, text=1)
    return page.section("What moved when the effects were added", words, table)
