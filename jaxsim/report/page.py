"""The parts of a self-contained HTML page."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from html import escape

from jaxsim.report.canvas import AFTER, BEFORE, Canvas, data_uri
from jaxsim.report.pictures import Rgb

Draw = Callable[[str, Canvas | None, str], str]
"""Keeps a chart under a name and gives its HTML with a caption; nothing but the words for a chart without values."""

STYLE = """
:root { color-scheme: light; }
body { margin: 0 auto; padding: 2.5rem 1.5rem 4rem; max-width: 61.5rem; color: #222; background: #fff;
       font: 1rem/1.5 Charter, "Bitstream Charter", "Source Serif 4", Georgia, "DejaVu Serif", serif; }
h1 { font: 600 0.85rem/1.3 system-ui, "Helvetica Neue", Arial, sans-serif; color: #6b6b6b; margin: 0 0 0.6rem; }
h2 { font-size: 1.25rem; line-height: 1.3; margin: 3rem 0 0.6rem; padding-top: 0.7rem; border-top: 1px solid #c9c9c9; }
h3 { font-size: 1.05rem; margin: 1.6rem 0 0.4rem; }
p, figcaption { max-width: 44rem; }
p { margin: 0.4rem 0 0.8rem; }
.verdict { font-size: 1.5rem; line-height: 1.35; max-width: 48rem; margin: 0 0 1.2rem; }
dl { display: flex; flex-wrap: wrap; gap: 0.4rem 2.2rem; margin: 0; font: 0.85rem/1.4 system-ui, Arial, sans-serif; }
dt { color: #6b6b6b; } dd { margin: 0; font-variant-numeric: tabular-nums; }
code, pre { font: 0.9em/1.45 ui-monospace, "SF Mono", Menlo, Consolas, "DejaVu Sans Mono", monospace; }
pre { margin: 0.5rem 0; padding: 0.5rem 0.8rem; background: #f5f5f5; white-space: pre-wrap; }
table { border-collapse: collapse; margin: 0.6rem 0 1rem; font: 0.85rem/1.4 system-ui, Arial, sans-serif;
        font-variant-numeric: tabular-nums; }
th { font-weight: 600; color: #6b6b6b; border-bottom: 1px solid #222; }
td { border-bottom: 1px solid #e6e6e6; vertical-align: top; }
th, td { text-align: right; padding: 0.3rem 0 0.3rem 1.2rem; white-space: nowrap; }
th.t, td.t { text-align: left; white-space: normal; } th:first-child, td:first-child { padding-left: 0; }
td small { color: #767676; }
figure { margin: 1rem 0 1.6rem; }
figure svg { display: block; width: 100%; height: auto; }
figcaption { font: 0.85rem/1.4 system-ui, Arial, sans-serif; color: #444; margin-top: 0.2rem; }
svg text { font-family: system-ui, "Helvetica Neue", Arial, sans-serif; }
svg.bar { width: 11rem; height: 1.1rem; display: block; }
.alike { border-left: 3px solid #d55e00; padding-left: 0.8rem; }
.key { font: 0.85rem/1.4 system-ui, Arial, sans-serif; } .key span { margin-right: 1.6rem; }
.key i { display: inline-block; width: 0.55rem; height: 0.55rem; border: 2px solid; border-radius: 50%;
         margin-right: 0.4rem; }
.names { font-size: 0.85rem; overflow-wrap: anywhere; max-width: none; }
@page { margin: 18mm 15mm; }
@media print { body { padding: 0; font-size: 10pt; } th, td { padding-left: 0.8rem; } h2, h3 { break-after: avoid; }
               figure, tr, pre, .alike { break-inside: avoid; }
               * { -webkit-print-color-adjust: exact; print-color-adjust: exact; } }
"""


def whole_page(*, title: str, sentence: str, facts: Sequence[tuple[str, str]], sections: Sequence[str]) -> str:
    """The page: the answer first, what it rests on, then the evidence."""
    about = "".join(f"<div><dt>{escape(name)}</dt><dd>{escape(value)}</dd></div>" for name, value in facts)
    return f"""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{escape(title)}</title>
<style>{STYLE}</style>
</head>
<body>
<h1>{escape(title)}</h1>
<p class="verdict">{escape(sentence)}</p>
<dl>{about}</dl>
{"".join(part for part in sections if part)}
</body>
</html>
"""


def section(title: str, body: str) -> str:
    """A headed part of the page; `body` is HTML."""
    return f"<section><h2>{escape(title)}</h2>{body}</section>\n"


def paragraph(text: str) -> str:
    return f"<p>{escape(text)}</p>"


def figure(drawing: str, words: str) -> str:
    """A drawing, HTML, above its words."""
    return f"<figure>{drawing}<figcaption>{escape(words)}</figcaption></figure>"


def image(rgb: Rgb, words: str) -> str:
    """A picture inside the page, as wide as it; `words` are for who cannot see it."""
    return f'<img src="{data_uri(rgb)}" style="width:100%" alt="{escape(words)}">'


def table(heads: Sequence[str], rows: Sequence[Sequence[str]], *, text: int, last_text: bool = False) -> str:
    """Cells are HTML; the first `text` columns are words, and the last if `last_text`; the others are numbers."""
    words = [k < text or (last_text and k == len(heads) - 1) for k in range(len(heads))]

    def line(cells: Sequence[str], tag: str) -> str:
        marks = [' class="t"' if word else "" for word in words]
        return "".join(f"<{tag}{mark}>{cell}</{tag}>" for cell, mark in zip(cells, marks, strict=True))

    head = line([escape(name) for name in heads], "th")
    body = "".join(f"<tr>{line(row, 'td')}</tr>" for row in rows)
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def bar_cell(share: float | int, bar: float | int, *, strong: bool) -> str:
    """A bar of `share` of the cell's width with a line at `bar`; shares below 0 are drawn as nothing."""
    length = 240 * min(max(share, 0.0), 1.0) if share == share else 0.0
    at = 240 * min(max(bar, 0.0), 1.0)
    fill = AFTER if strong else "#b9c7d1"
    return (
        f'<svg class="bar" viewBox="0 0 240 18" aria-hidden="true"><rect y="3" width="{length:.1f}" height="12" '
        f'fill="{fill}"/><line x1="{at:.1f}" x2="{at:.1f}" y1="0" y2="18" stroke="{BEFORE}" stroke-width="2"/></svg>'
    )


def key(entries: Sequence[tuple[str, str, bool]]) -> str:
    """A legend: (words, colour, hollow)."""
    spans = (
        f"<span><i style='border-color:{colour};background:{'#fff' if hollow else colour}'></i>{escape(words)}</span>"
        for words, colour, hollow in entries
    )
    return f'<p class="key">{"".join(spans)}</p>'


def file_name(*parts: str) -> str:
    """Parts as a name that every file system takes."""
    return re.sub(r"[^A-Za-z0-9_-]+", "-", "_".join(parts))
