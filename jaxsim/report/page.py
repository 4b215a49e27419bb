"""The parts of a self-contained HTML page, by jinja2 templates that escape whatever is no Markup; and its numbers.

Parts are Markup; joining them to plain text, or formatting text into them, escapes the text.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from importlib.resources import files
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from jaxsim.report.canvas import Canvas, data_uri
from jaxsim.report.pictures import Rgb

DrawChart = Callable[[str, Canvas | None, str], Markup]
"""Keeps a chart under a name and gives its HTML with a caption; nothing but the words for a chart without values."""
EMPTY = Markup()
Real = float | int
RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


@cache
def _templates() -> Environment:
    return Environment(loader=PackageLoader("jaxsim.report"), autoescape=True, undefined=StrictUndefined)


def _part(name: str, *values: Any) -> Markup:
    """A macro of parts.html."""
    return getattr(_templates().get_template("parts.html").module, name)(*values)


def own_text(name: str) -> Markup:
    """A file of the package that a page holds as it is: its style or its script."""
    return Markup((files("jaxsim.report") / "templates" / name).read_text(encoding="utf-8"))


def whole_page(
    *, title: str, sentence: str, facts: Sequence[tuple[str, str]], sections: Sequence[Markup], scenes: Markup = EMPTY
) -> str:
    """The page: the answer first, what it rests on, then the evidence. `scenes` is what `scenes.packed` gives for the
    viewer."""
    return (
        _templates()
        .get_template("page.html")
        .render(
            title=title,
            sentence=sentence,
            facts=facts,
            sections=[part for part in sections if part],
            style=own_text("page.css"),
            scenes=scenes,
            script=own_text("cloud.js") + own_text("viewer.js") if scenes else "",
        )
    )


def join_parts(parts: Iterable[str]) -> Markup:
    """Parts one after the other; text that is no Markup is a paragraph."""
    return EMPTY.join(part if isinstance(part, Markup) else paragraph(part) for part in parts)


def section(title: str, *parts: str, name: str = "") -> Markup:
    """A headed part of the page, its own parts joined; `name` is where links lead."""
    return _part("section", title, join_parts(parts), name)


def paragraph(text: str) -> Markup:
    """A text as a paragraph of the page; what it holds of HTML is shown as it stands, unless it is Markup."""
    return Markup("<p>{}</p>").format(text)


def code(text: str) -> Markup:
    """A text in the type of code, within a line."""
    return Markup("<code>{}</code>").format(text)


def shows(words: str, *, scene: int | None = None, channel: str = "", figures: Sequence[str] = ()) -> Markup:
    """Words by which the viewer shows a scene (its number) or a channel, and marks figures; plain without scripts."""
    what = {"scene": "" if scene is None else str(scene), "channel": channel, "figures": " ".join(figures)}
    data = EMPTY.join(Markup(' data-{}="{}"').format(name, value) for name, value in what.items() if value)
    return Markup('<span class="shows"{}>{}</span>').format(data, words)


def formula(text: str) -> Markup:
    """A formula in lines of its own, broken where the text is."""
    return Markup("<pre>{}</pre>").format(text)


def names(text: str) -> Markup:
    """A paragraph of long names, which may break anywhere."""
    return Markup('<p class="names">{}</p>').format(text)


def below(text: str, small: str) -> Markup:
    """A cell with a second, small line."""
    return Markup("{}<br><small>{}</small>").format(text, small)


def figure(drawn: Canvas | Rgb, words: str, *, label: str = "", name: str = "") -> Markup:
    """A drawing, or pixels as wide as the page, above its words; `label` is for who cannot see it, else these are."""
    label = label or words
    if isinstance(drawn, Canvas):
        return _part("figure", drawn.svg(label), words, name)
    pixels = Markup('<img src="{}" style="width:100%" alt="{}">').format(data_uri(drawn), label)
    return _part("figure", pixels, words, name)


def folded(title: str, body: str) -> Markup:
    """What is shown on demand."""
    return _part("folded", title, body)


def table(heads: Sequence[str], rows: Sequence[Sequence[str]], *, text: int, last_text: bool = False) -> Markup:
    """The first `text` columns are words, and the last if `last_text`; the others are numbers. Raises ValueError for a
    row of another length than the heads'."""
    if odd := [row for row in rows if len(row) != len(heads)]:
        raise ValueError(f"page: a row of {len(odd[0])} cells under {len(heads)} heads; each head needs one")
    words = [k < text or (last_text and k == len(heads) - 1) for k in range(len(heads))]
    return _part("table", heads, rows, words)


def bar_cell(share: float | int, bar: float | int, *, strong: bool) -> Markup:
    """A bar of `share` of the cell's width with a line at `bar`; shares below 0 are drawn as nothing."""
    length = 240 * min(max(share, 0.0), 1.0) if share == share else 0.0
    return _part("bar", length, 240 * min(max(bar, 0.0), 1.0), strong)


def key(entries: Sequence[tuple[str, str, bool]]) -> Markup:
    """A legend: (words, side, hollow), the side `before` or `after`."""
    return _part("key", entries)


def explorer(words: str, *, has_map: bool) -> Markup:
    """Where the viewer shows the page's scenes; hidden without scripts. `words` say what the cloud shows."""
    return _part("explorer", words, has_map)


def file_name(*parts: str) -> str:
    """Parts as a name that every file system takes."""
    return re.sub(r"[^A-Za-z0-9_-]+", "-", "_".join(parts))


def number(value: Real | None) -> str:
    """Three significant digits with a true minus sign, and a power of ten where it is tiny or huge; a dash where there
    is no value."""
    if value is None or not math.isfinite(value):
        return "–"
    if value == 0 or 1e-4 <= abs(value) < 1e5:
        places = max(0, 2 - math.floor(math.log10(abs(value)))) if value else 0
        text = f"{value + 0.0:.{places}f}"
    else:
        digits, power = f"{value:.2e}".split("e")
        text = f"{digits}·10{str(int(power)).translate(RAISED)}"
    return text.replace("-", "−")


def probability(p: Real) -> str:
    """A probability (0..1) in two digits; a dash where it is not finite."""
    if not math.isfinite(p):
        return "–"
    return "< 0.0001" if p < 1e-4 else f"{p:.2g}"


def percent(value: Real) -> str:
    """A share (1 is all) in whole per cent; a dash where it is not finite."""
    # Adding 0 takes the sign from what rounds to it.
    return f"{round(100 * value) + 0} %".replace("-", "−") if math.isfinite(value) else "–"
