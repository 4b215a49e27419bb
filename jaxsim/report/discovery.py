"""The report of a discovery: one page that opens from disk, and its charts as files."""

from __future__ import annotations

import re
from pathlib import Path

from markupsafe import Markup

from jaxsim.discover.verdict import NullDraws, Result, Verdict
from jaxsim.files import write_text
from jaxsim.progress import counted
from jaxsim.report import page
from jaxsim.report.accounts import could_show, learned, own_effects, residual_clouds, where_it_stood
from jaxsim.report.canvas import AFTER, BEFORE, Canvas, save_figure
from jaxsim.report.charts import scaled, ticks, x_axis
from jaxsim.report.evidence import contrast, curves, dependence_table, gap, levels, maps, moved, objects
from jaxsim.report.named import named_effects, ranking_chart, repeats, unexplained
from jaxsim.report.page import EMPTY, DrawChart, code, number
from jaxsim.report.regimes import regimes
from jaxsim.report.words import verdict_sentence

FIGURES = r"chance|(map|curve|parameter|unexplained|learned|regime)_.*"
"""Names of a report's figures."""
LEFT, RIGHT = 96, 700
BOTTOM = 112
FAN = 4.0
"""Pixels between neighbours of a row, in turn up and down, so that equal gains do not hide one another."""


def write_report(folder: Path, result: Result) -> Path:
    """Writes report.html, self-contained, and its charts as figures/NAME.svg; gives the path of the page.

    Figures that an earlier report of the folder drew and this one does not are removed.
    """
    folder = Path(folder)
    html, charts, captions = report_page(result)
    for old in (folder / "figures").glob("*.*"):
        # Of earlier versions, figures were PNG.
        stale = old.suffix == ".png" or (old.suffix == ".svg" and old.stem not in charts)
        if stale and re.fullmatch(FIGURES, old.stem):
            old.unlink()
    for name, canvas in charts.items():
        save_figure(folder / "figures", name, canvas, words=captions[name])
    return write_text(folder / "report.html", html)


def write_answer(folder: Path, result: Result) -> Path:
    """Writes all that a discovery leaves: sensor.json, the report with its figures and, last, verdict.json. Gives the
    path of the page."""
    result.effects_model.save(folder / "sensor.json")
    written = write_report(folder, result)
    result.verdict.save(folder)
    return written


def report_page(result: Result) -> tuple[str, dict[str, Canvas], dict[str, str]]:
    """The page, and its charts and their captions by name."""
    charts: dict[str, Canvas] = {}
    captions: dict[str, str] = {}

    def draw(name: str, canvas: Canvas | None, caption: str) -> Markup:
        if canvas is None:
            return page.paragraph(f"{caption} Nothing to draw: no ray could be compared.")
        charts[name] = canvas
        captions[name] = caption
        drawn = page.figure(canvas, caption, name=name)
        if not canvas.rows:
            return drawn
        heads, *rows = canvas.rows
        return drawn + page.folded("as a table", page.table(heads, rows, text=0))

    verdict, grid = result.verdict, result.grid
    turning, scenes = residual_clouds(result)
    outside = verdict.verdict == "not_in_catalogue"
    html = page.whole_page(
        title=f"jaxsim discover: {verdict.verdict.replace('_', ' ')}",
        sentence=verdict_sentence(verdict),
        facts=[
            ("frames", str(verdict.frames)),
            ("grid", f"{len(grid.elevation_rad)} rows × {len(grid.azimuth_rad)} columns"),
            ("scenes to find with", str(len(verdict.find))),
            ("scenes to judge on", str(len(verdict.judge))),
            ("time", f"{verdict.seconds:.0f} s"),
        ],
        sections=[
            unexplained(verdict.unexplained, draw, missing=True) if outside else EMPTY,
            named_effects(verdict.effects, draw, shown=[(c.channel, c.covariate) for c in result.curves]),
            regimes(verdict.regimes, draw, frames=result.frames),
            own_effects(verdict.own),
            learned(verdict, draw),
            repeats(verdict.repeats),
            where_it_stood(verdict.registered),
            dependence_table(verdict.where),
            turning,
            maps(result, draw),
            curves(result.curves, draw),
            gap(verdict),
            ranking_chart(verdict.ranking, verdict.effects),
            _chance(verdict, draw),
            EMPTY if outside else unexplained(verdict.unexplained, draw),
            could_show(verdict.sensitivity, [one.name for one in verdict.effects]),
            levels(verdict.levels),
            contrast(verdict.contrast),
            objects(verdict.objects),
            moved(verdict),
            _scenes(verdict),
        ],
        scenes=scenes,
    )
    return html, charts, captions


def _scenes(verdict: Verdict) -> Markup:
    parts = [f"Note: {note}." for note in verdict.notes]
    for word, scenes in (("To find and fit", verdict.find), ("To judge", verdict.judge)):
        parts.append(page.names(Markup("<b>{} ({}):</b> {}").format(word, len(scenes), ", ".join(scenes))))
    taken = "SHA-256 of this division, taken before anything was fitted"
    parts.append(page.names(Markup("{}: {}").format(taken, code(verdict.sha256))))
    return page.section("Scenes", *parts)


def _chance(verdict: Verdict, draw: DrawChart) -> Markup:
    """How often naming errs on these very data, if nulls were drawn; else nothing."""
    nulls = verdict.nulls
    if nulls is None:
        return EMPTY
    count = len(nulls.gains)
    words = (
        f"{counted(count, 'measurement')} in which nothing is missing {'was' if count == 1 else 'were'} drawn (this "
        "simulation with what is left of these data, its sign changed scene by scene) and named in like the measured "
        f"one. On {nulls.answered} of them something would have been said with the bar that was set on other streets. "
        f"Here an effect must gain more than that bar and than the strongest on any of them ({number(nulls.bar)} nats "
        f"a scene), a free curve more than any did ({number(nulls.free_bar)}). So many draws hold false names to about "
        f"one in {count + 1}."
    )
    caption = (
        f"Gains that pass every test but the bar, nats a scene. Below: of the strongest effect on each of {count} "
        "nulls; above: of the candidates on the measurement, filled if named. The line is the bar."
    )
    return page.section("What chance gives on these data", words, draw("chance", _null_strip(nulls, verdict), caption))


def _null_strip(nulls: NullDraws, verdict: Verdict) -> Canvas:
    """Two rows of dots on one axis, and the bar as a line."""
    named = {effect.name for effect in verdict.effects}
    rows = (
        ("measured", 34, [(max(rank.gain, 0.0), rank.name in named) for rank in verdict.ranking]),
        ("nulls", 82, [(gain, False) for gain in nulls.gains]),
    )
    reach = 1.05 * max([1.5 * nulls.bar, *(gain for _, _, dots in rows for gain, _ in dots)])
    canvas = Canvas(720, 158)
    across = scaled((0, reach), (LEFT, RIGHT))
    words = "gain, nats a scene"
    x_axis(canvas, across, ticks(0, reach, 6), left=LEFT, right=RIGHT, bottom=BOTTOM, words=words)
    canvas.line([(across(nulls.bar), 12), (across(nulls.bar), BOTTOM)], colour=BEFORE, width=1.5)
    for name, y, dots in rows:
        canvas.text(LEFT - 14, y + 4, name, anchor="end", size=12)
        for k, (gain, strong) in enumerate(dots):
            canvas.dot(across(gain), y + FAN * (k % 5 - 2), colour=AFTER, radius=4, hollow=not strong)
    return canvas
