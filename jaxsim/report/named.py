"""A report's account of the answer: the effects that are named, why these, and what no effect explains."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from markupsafe import Markup

from jaxsim.discover.verdict import Interval, Named, Rank, Repeat, Unexplained
from jaxsim.discover.verdict.names import ALTERNATING, CATEGORICAL
from jaxsim.effects import EFFECTS, Effect, Parameter
from jaxsim.report import page
from jaxsim.report.canvas import BEFORE
from jaxsim.report.charts import curve_chart, interval_chart
from jaxsim.report.page import EMPTY, DrawChart, code, number, probability
from jaxsim.report.words import AXES, SIGN_WORDS, Axis, dependence, span, title_as_found


def named_effects(effects: Sequence[Named], draw: DrawChart, *, shown: Sequence[tuple[str, str]] = ()) -> Markup:
    """Each named effect with its formula, gain, parameters and look-alikes. `shown` are (channel, covariate) of the
    curves that the page has."""
    if not effects:
        return EMPTY
    return page.section("What the simulation lacks", *(_effect(effect, draw, shown) for effect in effects))


def _effect(named: Named, draw: DrawChart, shown: Sequence[tuple[str, str]]) -> Markup:
    """An effect: what it is, how sure it is, its parameters, and what it could be taken for."""
    parts: list[str] = [Markup("<h3>{} {}</h3>").format(code(named.name), title_as_found(named))]
    known = EFFECTS.get(named.name)
    if known:
        parts.append(page.formula(known.formula))
    places = _evidence(named, known, shown)
    figures = [figure for _, figure in places]
    changes = Markup(", ").join(page.shows(channel, channel=channel, figures=figures) for channel in named.channels)
    p = probability(named.p_value)
    gains = (
        f"On held-out scenes it gains {number(named.gain.value)} {named.gain.unit} (90 % interval {span(named.gain)}; "
        f"p {p if p.startswith('<') else f'= {p}'}, an exact test over scenes)."
    )
    parts.append(page.paragraph(Markup("Changes {}. {}").format(changes, gains)))
    parts += [_does(channel, change) for channel, change in named.does.items()]
    rows, charts = [], []
    links = Markup(", ").join(Markup('<a href="#{}">{}</a>').format(name, words) for words, name in places)
    parts.append(Markup('<p class="links">Its evidence: {}.</p>').format(links))
    for name, value in named.parameters.items():
        of = known.parameters.get(name) if known else None
        if isinstance(value, Interval):
            cells = number(value.value), span(value), value.unit, number(of.neutral) if of else "–"
            rows.append([code(name), of.meaning if of else "", *cells])
        else:
            charts.append(_vector(named.name, name, of, values=value, draw=draw))
    if rows:
        parts.append(
            page.table(["parameter", "meaning", "value", "90 % interval", "unit", "fit starts from"], rows, text=2)
        )
    parts += charts
    for other in named.look_alikes:
        apart = named.tell_apart.get(other) or "no measurement is known"
        words = Markup('<p class="alike"><b>Could also be {}.</b> To tell them apart: {}.</p>')
        parts.append(words.format(code(other), apart))
    return page.join_parts(parts)


def _does(channel: str, change: Interval) -> str:
    """How much an effect changes on the compared rays, in words."""
    what = {"intensity": "the intensity", "range": "the range", "drop": "what returns"}[channel]
    unit = "cm" if channel == "range" else "%"
    # What is lost is told as a change too: less returns.
    sign = -1 if channel == "drop" else 1

    def told(value: float) -> str:
        return f"{100 * sign * value:+.1f} {unit}".replace("-", "−")

    return (
        f"On the rays compared it alone changes {what} by {told(change.value)} in the mean, nine of ten by "
        f"{' to '.join(told(end) for end in sorted((change.low, change.high), key=lambda end: sign * end))}."
    )


def _evidence(named: Named, known: Effect | None, shown: Sequence[tuple[str, str]]) -> list[tuple[str, str]]:
    """Words and names of the figures that show what the effect does: its curves, its maps, its parameters."""
    covariates = known.covariates if known else ()
    places = [
        (f"{channel} along {covariate}", page.file_name("curve", channel, covariate))
        for channel, covariate in shown
        if channel in named.channels and covariate in covariates
    ]
    places += [(f"map of {channel}", page.file_name("map", channel)) for channel in named.channels]
    return places + [
        (f"parameter {name}", page.file_name("parameter", named.name, name))
        for name, value in named.parameters.items()
        if not isinstance(value, Interval)
    ]


def _vector(effect: str, name: str, known: Parameter | None, *, values: Sequence[Interval], draw: DrawChart) -> Markup:
    """One interval a beam or class, as a chart."""
    unit = values[0].unit if values else ""
    neutral = known.neutral if known else 0.0
    what = "class" if known and known.shape == "class" else "beam"
    sure = sum(not v.low <= neutral <= v.high for v in values)
    chart = interval_chart(
        values,
        neutral=neutral,
        x_label=AXES["class" if what == "class" else "row"].label,
        y_label=f"{name}, {unit}" if unit else name,
        name="row" if what == "beam" else "",
    )
    return draw(
        page.file_name("parameter", effect, name),
        chart,
        f"{name}: one value a {what} with its 90 % interval; {sure} of {len(values)} intervals leave out "
        f"{number(neutral)}, at which it does nothing.",
    )


def ranking_chart(ranks: Sequence[Rank], effects: Sequence[Named]) -> Markup:
    """The candidates of the first step as bars, with the bar that they had to pass."""
    if not ranks:
        return EMPTY
    named = {effect.name for effect in effects}
    reach = max([1.5 * ranks[0].bar, *(r.gain for r in ranks if np.isfinite(r.gain))]) or 1.0
    rows = [
        [
            Markup("<b>{}</b>").format(code(r.name)) if r.name in named else code(r.name),
            page.bar_cell(r.gain / reach, r.bar / reach, strong=r.name in named),
            number(r.gain),
            probability(r.p_value),
            r.why_not or "named",
        ]
        for r in ranks
    ]
    words = (
        "Held-out gain of each candidate over the model without it, nats a scene, at the first step. The line is the "
        f"bar that a candidate must pass ({number(ranks[0].bar)}); its gain must also agree between scenes."
    )
    heads = ["effect", "gain, and the bar", "nats", "p", "why not"]
    alike = {other for effect in effects for other in effect.look_alikes}
    others = [r for r in ranks if r.name not in named | alike]
    loser = []
    if effects and others:
        why = others[0].why_not or "no reason was recorded"
        loser = [f"Runner-up, look-alikes left out: {others[0].name}. Why it lost: {why}."]
    return page.section("Why this answer", words, page.table(heads, rows, text=2, last_text=True), *loser)


def repeats(patterns: Sequence[Repeat]) -> Markup:
    """What comes back at the same rows and columns in every scene, the named effects in place."""
    if not patterns:
        return EMPTY
    rows = [
        [
            one.channel,
            one.place,
            code(one.formula),
            number(one.period),
            number(one.size.value),
            span(one.size),
            one.size.unit,
            probability(one.p_value),
            probability(one.p_judge),
        ]
        for one in patterns
    ]
    words = (
        "Patterns in sensor coordinates that no named effect explains: at the same rows or columns in every scene, "
        "found on the scenes to find with and seen again on those to judge on. p: that chance makes scenes agree so "
        "well on any pattern of any scale and channel (signs of whole scenes); beside it, that judge scenes agree by "
        "chance on this one. Period: columns, or rows for what runs along rows alone."
    )
    heads = ["channel", "where", "pattern", "period", "size", "90 % interval", "unit", "p", "p, judge scenes"]
    return page.section("What repeats in every scene", words, page.table(heads, rows, text=3))


def unexplained(one: Unexplained | None, draw: DrawChart, *, missing: bool = False) -> Markup:
    """A dependence outside the catalogue: what the simulation lacks if `missing`, else what remains."""
    title = "What the simulation lacks" if missing else "What stays unexplained"
    if one is None:
        none = "No further dependence was found: free curves along the covariates that matter most gain too little."
        return page.section(title, none)
    along = one.along or one.covariate
    axis = AXES.get(along, Axis(along))
    meaning = f"; x is {axis.x or axis.label}"
    words = f"A {dependence(one)} that no effect of the catalogue accounts for."
    formula = page.paragraph(code(one.formula) + meaning)
    if not one.x:
        return page.section(title, words, formula)
    x, y = axis.shown(np.array(one.x, float)), np.array(one.y, float)
    band = np.array(one.band or (0.0,) * len(one.y), float)
    unit = SIGN_WORDS[one.channel].unit if one.channel in SIGN_WORDS and not one.adds else one.channel
    chart = curve_chart(
        x,
        [("fitted", y, BEFORE)],
        band,
        x_label=axis.label,
        y_label=unit,
        joined=along not in ("class", *ALTERNATING),
        whole=along in CATEGORICAL,
    )
    name = page.file_name("unexplained", one.channel, one.covariate)
    caption = f"A free curve of {one.channel} along {along}, with its 90 % band."
    return page.section(title, words, formula, draw(name, chart, caption))
