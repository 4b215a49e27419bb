"""A report's account of effects of one's own: where each comes from, what it gained, and what it looks like."""

from __future__ import annotations

from collections.abc import Sequence

from markupsafe import Markup

from jaxsim.discover.rules import RULES
from jaxsim.discover.verdict import OwnCandidate
from jaxsim.effects import EFFECTS
from jaxsim.effects.origin import Origin
from jaxsim.effects.page import in_words
from jaxsim.report.page import NOTHING, bar_cell, code, formula, names, paragraph, section, table, together
from jaxsim.report.words import number, percent, probability


def own_effects(candidates: Sequence[OwnCandidate]) -> Markup:
    """Each candidate that is no part of the catalogue; nothing where there is none."""
    if not candidates:
        return NOTHING
    words = (
        "Candidates beside the catalogue, each with the file or package that it comes from. A look-alike is an effect "
        "of the catalogue that, fitted to its expectation on these frames at a visible size, reproduces at least "
        f"{percent(RULES.alike_share)} of it; the bar shows how much."
    )
    return section("Effects of your own", paragraph(words) + together(map(_candidate, candidates)))


def _candidate(one: OwnCandidate) -> Markup:
    known = EFFECTS.get(one.name)
    title = known.title if known else ""
    parts = [Markup("<h3>{} {}</h3>").format(code(one.name), title)]
    parts.append(names(f"From {Origin(**one.origin)}"))
    if known:
        parts.append(formula(known.formula))
        parts += [paragraph(f"{name}: {in_words(p)}") for name, p in known.parameters.items()]
    said = f"Not named: {one.why_not}." if one.why_not else "Named."
    gain = f"{number(one.gain)} nats per held-out scene (p {probability(one.p_value)})"
    parts.append(paragraph(f"At the first step it gains {gain}. {said}"))
    if not one.look_alikes:
        return together([*parts, paragraph("Nothing of the catalogue looks like it on these frames.")])
    rows = [
        [
            code(other.name),
            bar_cell(other.share, RULES.alike_share, strong=False),
            percent(other.share),
            other.apart,
        ]
        for other in one.look_alikes
    ]
    heads = ["look-alike", "of its expectation reproduced, and the bar", "share", "what tells them apart"]
    return together([*parts, table(heads, rows, text=2, last_text=True)])
