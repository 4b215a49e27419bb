"""A report's accounts, in their order: both sides (where the sensor stood, by ranges alone, and what the frames could
show); what was learned, laws that no effect describes and the formula that is near one; effects of one's own, where
each comes from, what it gained and what it looks like; and judge scenes.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
from markupsafe import Markup

from jaxsim.discover.rules import RULES
from jaxsim.discover.verdict import ClosedLaw, JudgeFrame, OwnCandidate, Registered, Result, Sensitivity, Verdict
from jaxsim.discover.verdict.names import MAP_COLUMNS, NAMED
from jaxsim.effects import EFFECTS
from jaxsim.effects.learned import Learned
from jaxsim.effects.origin import Origin
from jaxsim.effects.page import parameter_in_words
from jaxsim.frame import Cloud, PolarGrid, PolarImage
from jaxsim.geometry import polar_to_points
from jaxsim.report import page
from jaxsim.report.canvas import AFTER
from jaxsim.report.charts import colour_limit, curve_chart, root_mean_square
from jaxsim.report.page import EMPTY, DrawChart, code, number, percent, probability
from jaxsim.report.regimes import picks_of, title
from jaxsim.report.scenes import Channel, Side, TurnedScene, packed
from jaxsim.report.words import AXES, SIGN_WORDS, Axis, span, title_of

OUTSIDE = {
    **dict.fromkeys(("curve", "product"), "Outside its knots it holds its end values."),
    "periodic": "From its last knot it goes on to the first.",
    "table": "What it does not hold is left as it is.",
    "wave": "They are those of its cosine and its sine.",
}
"""What becomes of rays that a law was not fitted to, by its kind."""
BAND = 2.0
"""Standard deviations to either side of a learned law that its band shows."""


def where_it_stood(registered: Registered | None) -> Markup:
    """The motion between the sides, if it is more than noise: a table of its numbers, and how far ranges then agree."""
    if registered is None or not (registered.sure or registered.other_moments or registered.speeds):
        return EMPTY
    meanings = {key: of.meaning for effect in EFFECTS.values() for key, of in effect.parameters.items()}
    rows = [
        [code(key), meanings[key], number(one.value), span(one), one.unit] for key, one in registered.motion.items()
    ]
    words = (
        "The sensor's motion from where the simulator has it, that makes ranges agree best over all frames. They agree "
        f"(within 0.5 m or 5 %) on {percent(registered.near[1])} of the measured points as registered, on "
        f"{percent(registered.near[0])} as given; half of the points lie within {number(registered.off_m[1])} m and "
        f"{number(registered.off_m[0])} m."
    )
    if registered.other_moments:
        words += " Frames of one name are of different moments: each was brought to its own place."
    parts = [words, page.table(["number", "meaning", "value", "90 % interval", "unit"], rows, text=2)]
    if registered.speeds:
        drives = [[name, number(speed)] for name, speed in registered.speeds.items()]
        parts.append("Speeds that the frames' own distortion tells, where none is given:")
        parts.append(page.table(["drive", "m/s"], drives, text=1))
    return page.section("Where the sensor stood", *parts)


def could_show(asked: Sequence[Sensitivity], named: Collection[str] = ()) -> Markup:
    """Effects that these frames could not show, why, and what to record; then the size from which each other one
    would be seen. What is `named` was shown."""
    if not asked:
        return EMPTY
    hidden = [one for one in asked if not one.testable and one.name not in named]
    words = (
        f"{len(asked)} effects were put on the rays that were compared, at half of a clearly visible size, and the "
        "gain was computed that naming could expect, nuisances being free to take up what they can. "
    )
    if hidden:
        words += "That none of the following is named says nothing about it:"
    else:
        words += "These scenes would show every one of them."
    rows = [[_name(one), one.why, one.record] for one in hidden]
    parts = [words]
    if rows:
        parts.append(page.table(["effect", "why it cannot be told here", "what to record"], rows, text=3))
    seen = [[_name(one), _from(one)] for one in asked if one.testable]
    if seen:
        heads = ["effect", "these scenes would show it from about"]
        parts.append(
            page.folded(f"From which size the other {len(seen)} would be seen", page.table(heads, seen, text=2))
        )
    return page.section("What these frames could show", *parts)


def _name(one: Sensitivity) -> Markup:
    return page.below(code(one.name), title_of(one.name))


def _from(one: Sensitivity) -> str:
    """The smallest size, parameter by parameter; those that only shape the effect stay as they are."""
    known = EFFECTS.get(one.name)
    words = []
    for name, smallest in one.smallest.items():
        of = known.parameters.get(name) if known else None
        unit = f" {of.unit}" if of and of.unit else ""
        many = " (root mean square)" if of and of.shape != "scalar" else ""
        words.append(f"{name} {number(smallest)}{unit}{many}")
    return ", ".join(words)


def learned(verdict: Verdict, draw: DrawChart) -> Markup:
    """Each learned law with its band and what it gains on judge scenes, and the formula."""
    if not verdict.learned:
        return EMPTY
    parts = [_law(law, verdict, draw, mark=str(k) if k else "") for k, law in enumerate(verdict.learned)]
    return page.section("What was learned and added", *parts, *([_formula(verdict.law)] if verdict.law else []))


def _law(law: Learned, verdict: Verdict, draw: DrawChart, *, mark: str) -> Markup:
    words = (
        f"No effect of the catalogue describes this, so it enters sensor.json as it is: a {law.kind} of "
        f"{len(law.values)} heights of {law.channel} along {' and '.join(law.covariates)}"
        f"{', which are added to it' if law.adds else ''}. "
    ) + OUTSIDE[law.kind]
    gained = verdict.gap[law.channel].gained if law.channel in verdict.gap else None
    if gained:
        words += (
            f" With all that was added the judge scenes' {law.channel} gains {number(gained.value)} {gained.unit} "
            f"(90 % interval {number(gained.low)} to {number(gained.high)})."
        )
    name, *others = law.covariates
    if others or law.kind == "wave":
        return page.paragraph(words)
    axis = AXES.get(name, Axis(name))
    chart = curve_chart(
        axis.shown(np.array(law.knots).ravel()),
        [("learned", np.array(law.values), AFTER)],
        BAND * np.array(law.sd),
        x_label=axis.label,
        y_label="intensity" if law.adds else SIGN_WORDS[law.channel].unit,
        joined=law.kind != "table",
        whole=law.kind == "table",
    )
    file = page.file_name("learned", law.channel, NAMED.get(name, name), *filter(None, [mark]))
    caption = (
        f"The learned law of {law.channel} along {name}, with two standard deviations to either side (jackknife over "
        "groups of scenes)."
    )
    return page.paragraph(words) + draw(file, chart, caption)


def _formula(law: ClosedLaw) -> Markup:
    words = (
        f"A formula comes near: it tells {100 * law.share:.0f} % of the law's variation, and gains "
        f"{number(law.held_out_nats)} nats over a level on groups of scenes that its fit had not seen."
    )
    rows = [[code(name), number(one.value), span(one), one.unit] for name, one in law.parameters.items()]
    heads = ["parameter", "value", "90 % interval", "unit"]
    return page.paragraph(words) + page.formula(law.formula) + page.table(heads, rows, text=1)


def own_effects(candidates: Sequence[OwnCandidate]) -> Markup:
    """Each candidate that is no part of the catalogue; nothing where there is none."""
    if not candidates:
        return EMPTY
    words = (
        "Candidates beside the catalogue, each with the file or package that it comes from. A look-alike is an effect "
        "of the catalogue that, fitted to its expectation on these frames at a visible size, reproduces at least "
        f"{percent(RULES.alike_share)} of it; the bar shows how much."
    )
    return page.section("Effects of your own", words, *map(_candidate, candidates))


def _candidate(one: OwnCandidate) -> Markup:
    known = EFFECTS.get(one.name)
    title = known.title if known else ""
    parts: list[str] = [Markup("<h3>{} {}</h3>").format(code(one.name), title)]
    parts.append(page.names(f"From {Origin(**one.origin)}"))
    if known:
        parts.append(page.formula(known.formula))
        parts += [f"{name}: {parameter_in_words(p)}" for name, p in known.parameters.items()]
    text = f"Not named: {one.why_not}." if one.why_not else "Named."
    gain = f"{number(one.gain)} nats per held-out scene (p {probability(one.p_value)})"
    parts.append(f"At the first step it gains {gain}. {text}")
    if not one.look_alikes:
        return page.join_parts([*parts, "Nothing of the catalogue looks like it on these frames."])
    rows = [
        [
            code(other.name),
            page.bar_cell(other.share, RULES.alike_share, strong=False),
            percent(other.share),
            other.apart,
        ]
        for other in one.look_alikes
    ]
    heads = ["look-alike", "of its expectation reproduced, and the bar", "share", "what tells them apart"]
    return page.join_parts([*parts, page.table(heads, rows, text=2, last_text=True)])


def residual_clouds(result: Result) -> tuple[Markup, Markup]:
    """The section with the viewer and its table, and the viewer's scenes; nothing where no frame was kept."""
    if not result.frames:
        return EMPTY, EMPTY
    sides = [side for one in result.frames for side in (one.before, one.after)]
    channels = [
        Channel(name, f"residual of {name}", -limit, limit, words.unit, "diverging")
        for name, words in SIGN_WORDS.items()
        if (limit := colour_limit([side[name] for side in sides])) is not None
    ]
    if not channels:
        return EMPTY, EMPTY
    rows, columns = len(result.grid.elevation_rad), len(result.grid.azimuth_rad)
    scenes = [_scene(frame, result) for frame in result.frames]
    groups = min(columns, MAP_COLUMNS)
    words = (
        "Frames of judge scenes, which nothing was fitted to: measured points coloured by what is left between "
        "simulation and measurement. Grey: not compared. A lost ray lies where it was simulated."
    )
    label = "Cloud of a judge frame in 3D, coloured by residual"
    viewer = page.explorer(label, has_map=True)
    shown = packed(scenes, channels, rows=rows, columns=columns, groups=groups)
    return page.section("Residuals ray by ray", words, viewer, _table(result), name="turn"), shown


def _scene(frame: JudgeFrame, result: Result) -> TurnedScene:
    picks = {"row": frame.row, "column": frame.column}
    picks |= {f"curve {k}": group for k, group in enumerate(frame.groups)}
    picks |= picks_of(result.verdict.regimes, frame, columns=len(result.grid.azimuth_rad))
    before = Side("before", places(frame, result.grid), frame.before, picks)
    if not result.verdict.changed:
        return TurnedScene(title(frame), (before,))
    return TurnedScene(title(frame), (before, Side("after", None, frame.after)))


def places(frame: JudgeFrame, grid: PolarGrid) -> np.ndarray:
    """Places of the rays (n, 3), metres in the sensor's axes."""
    shape = (len(grid.elevation_rad), len(grid.azimuth_rad))
    range_m = np.zeros(shape, np.float32)
    range_m[frame.row, frame.column] = frame.range_m
    ones = np.ones(shape, bool)
    cloud: Cloud = polar_to_points(PolarImage(range_m, np.zeros(shape, np.float32), ones), grid)
    return np.asarray(cloud.xyz_m).reshape(*shape, 3)[frame.row, frame.column]


def _table(result: Result) -> Markup:
    """Root mean square residuals of each frame, for who cannot see the cloud."""
    heads = ["frame", "rays"]
    changed = result.verdict.changed
    for name, sides in SIGN_WORDS.items():
        heads.append(sides.unit if sides.unit.startswith(name) else f"{name}, {sides.unit}")
    rows = []
    for k, frame in enumerate(result.frames):
        row = [page.shows(title(frame), scene=k), str(len(frame.row))]
        for name in SIGN_WORDS:
            sizes = [
                number(root_mean_square(side[name]))
                for side in ((frame.before, frame.after) if changed else (frame.before,))
            ]
            row.append(" → ".join(sizes))
        rows.append(row)
    return page.paragraph(
        f"Root mean square residual of the rays that were compared{', before → after' if changed else ''}:"
    ) + page.table(heads, rows, text=1)
