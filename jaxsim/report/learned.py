"""A report's account of what was learned: laws that no effect describes, and the formula that is near one."""

from __future__ import annotations

import numpy as np
from markupsafe import Markup

from jaxsim.discover.covariates import NAMED
from jaxsim.discover.verdict import ClosedLaw, Verdict
from jaxsim.effects.learned import Learned
from jaxsim.report.canvas import AFTER
from jaxsim.report.charts import curve_chart
from jaxsim.report.page import NOTHING, Draw, code, file_name, formula, paragraph, section, table, together
from jaxsim.report.words import AXES, CHANNELS, Axis, number, span

OUTSIDE = {
    **dict.fromkeys(("curve", "product"), "Outside its knots it holds its end values."),
    "periodic": "From its last knot it goes on to the first.",
    "table": "What it does not hold is left as it is.",
    "wave": "They are those of its cosine and its sine.",
}
"""What becomes of rays that a law was not fitted to, by its kind."""
BAND = 2.0
"""Standard deviations to either side of a learned law that its band shows."""


def learned(verdict: Verdict, draw: Draw) -> Markup:
    """Each learned law with its band and what it gains on judge scenes, and the formula."""
    if not verdict.learned:
        return NOTHING
    parts = [_law(law, verdict, draw, mark=str(k) if k else "") for k, law in enumerate(verdict.learned)]
    return section("What was learned and added", together(parts) + (_formula(verdict.law) if verdict.law else NOTHING))


def _law(law: Learned, verdict: Verdict, draw: Draw, *, mark: str) -> Markup:
    words = (
        f"No effect of the catalogue describes this, so it enters sensor.json as it is: a {law.kind} of "
        f"{len(law.values)} heights of {law.channel} along {' and '.join(law.covariates)}. "
    ) + OUTSIDE[law.kind]
    gained = verdict.gap[law.channel].gained if law.channel in verdict.gap else None
    if gained:
        words += (
            f" With all that was added the judge scenes' {law.channel} gains {number(gained.value)} {gained.unit} "
            f"(90 % interval {number(gained.low)} to {number(gained.high)})."
        )
    name, *others = law.covariates
    if others or law.kind == "wave":
        return paragraph(words)
    # Finer looks at a covariate have no axis of their own.
    axis = AXES.get(name, Axis(name))
    chart = curve_chart(
        axis.shown(np.array(law.knots).ravel()),
        [("learned", np.array(law.values), AFTER)],
        BAND * np.array(law.sd),
        x_label=axis.label,
        y_label=CHANNELS[law.channel].unit,
        joined=law.kind != "table",
        whole=law.kind == "table",
    )
    file = file_name("learned", law.channel, NAMED.get(name, name), *filter(None, [mark]))
    caption = (
        f"The learned law of {law.channel} along {name}, with two standard deviations to either side (jackknife over "
        "groups of scenes)."
    )
    return paragraph(words) + draw(file, chart, caption)


def _formula(law: ClosedLaw) -> Markup:
    words = (
        f"A formula comes near: it tells {100 * law.share:.0f} % of the law's variation, and gains "
        f"{number(law.held_out_nats)} nats over a level on groups of scenes that its fit had not seen."
    )
    rows = [[code(name), number(one.value), span(one), one.unit] for name, one in law.parameters.items()]
    heads = ["parameter", "value", "90 % interval", "unit"]
    return paragraph(words) + formula(law.formula) + table(heads, rows, text=1)
