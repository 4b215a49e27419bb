"""The rates that docs/discover-rates.md quotes, from the rows of a run, in Markdown."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from benchmarks.blind.plan import ONLY_JOINTLY
from benchmarks.blind.rivals import RIVALS, judge_rival
from jaxsim.effects import EFFECTS

Row = dict[str, Any]


def wilson(hits: int, n: int) -> tuple[float, float]:
    """95 % interval of a share (Wilson 1927)."""
    if not n:
        return 0.0, 1.0
    z, p = 1.96, hits / n
    middle = (p + z * z / (2 * n)) / (1 + z * z / n)
    half = z * np.sqrt(p * (1 - p) / n + z * z / (4 * n * n)) / (1 + z * z / n)
    return max(float(middle - half), 0.0), min(float(middle + half), 1.0)


def rate(good: Iterable[Any]) -> str:
    """A share with its interval."""
    values = [bool(value) for value in good]
    if not values:
        return "no case"
    low, high = wilson(sum(values), len(values))
    share = f"{100 * np.mean(values):.0f} %"
    return f"{share} ({sum(values)} of {len(values)}; {100 * low:.0f} to {100 * high:.0f} %)"


def coverage(parameters: Iterable[Row]) -> str:
    """Share of the 90 % intervals that hold the truth, a vector counting as one; empty where there is none."""
    inside = [p["inside"] for p in parameters if p["inside"] is not None]
    return f"{100 * np.mean(inside):.0f} % of {len(inside)}" if inside else ""


def of_kind(rows: Sequence[Row], kind: str, keep: Callable[[Row], bool] = lambda row: True) -> list[Row]:
    return [row for row in rows if row["kind"] == kind and keep(row)]


def separable(row: Row) -> bool:
    return not set(row["truth"]) & set(ONLY_JOINTLY)


def summary(rows: Sequence[Row]) -> str:
    """All tables."""
    if not rows:
        return "no case yet"
    parts = [
        _about(rows),
        _rates(rows),
        _parameters(rows),
        _gaps(rows),
        _drawn(rows),
        _rivals(rows),
        _by_effect(rows),
        _answers(rows),
    ]
    return "\n\n".join(part for part in parts if part)


def _table(head: str, lines: Iterable[str]) -> str:
    lines = list(lines)
    rule = "|" + "---|" * (head.count("|") - 1)
    return "\n".join([head, rule, *lines]) if lines else ""


def _about(rows: Sequence[Row]) -> str:
    failed = [row for row in rows if row["verdict"] == "error"]
    codes, seeds = sorted({row["code"] for row in rows}), [row["seed"] for row in rows]
    s = rows[0]["settings"]
    kind = "sealed" if s["sealed"] else "development"
    text = (
        f"{len(rows)} {kind} cases, seeds {min(seeds)} to {max(seeds)}, {s['scenes']} scenes of {s['rows']} x "
        f"{s['columns']} rays; code {', '.join(codes)}."
    )
    if len(codes) > 1:
        text += f" These rows were answered by {len(codes)} versions of the code: they are not one measurement."
    if failed:
        text += f" Ended with an error, counted as wrong ({len(failed)}): {', '.join(r['key'] for r in failed)}."
    return text


def _drawn(rows: Sequence[Row]) -> str:
    """What nulls drawn from the cases gained, where any were drawn."""
    some = [row["drawn"] for row in rows if row.get("drawn")]
    if not some:
        return ""
    answered = [k < one["answered"] for one in some for k in range(len(one["gains"]))]
    raised = [max(one["gains"]) >= one["bar"] for one in some]
    curves = [max(one["free"]) >= one["free_bar"] for one in some]
    return (
        f"On {rate(answered)} of the nulls drawn from the cases, {len(some[0]['gains'])} from each, something passes "
        f"the standing bar. They raise it for effects in {sum(raised)} and for free curves in {sum(curves)} of "
        f"{len(some)} cases; the highest bars are {max(one['bar'] for one in some):.1f} and "
        f"{max(one['free_bar'] for one in some):.1f} nats a scene."
    )


def _rates(rows: Sequence[Row]) -> str:
    lines = []
    for severity in sorted({row["severity"] for row in of_kind(rows, "single")}):
        some = of_kind(rows, "single", lambda row, at=severity: row["severity"] == at)
        lines.append(f"| severity {severity:g}: right name first | {rate(r['first_right'] for r in some)} |")
        lines.append(f"| severity {severity:g}: in the set | {rate(r['in_set'] for r in some)} |")
    strong = of_kind(rows, "single", lambda row: separable(row) and row["severity"] >= 2)
    every = of_kind(rows, "single", lambda row: row["severity"] >= 1)
    sizes = [row["set_size"] for row in every if row["set_size"]]
    lines += [
        f"| separable effects, severity >= 2: right name first | {rate(r['first_right'] for r in strong)} |",
        f"| all effects, severity >= 1: right name first | {rate(r['first_right'] for r in every)} |",
        f"| all effects, severity >= 1: in the set | {rate(r['in_set'] for r in every)} |",
        f"| mean size of the set | {np.mean(sizes):.2f} |" if sizes else "| mean size of the set | no case |",
        f"| all effects, severity >= 1: a place of `where` is right | {rate(r['where_right'] for r in every)} |",
    ]
    for level in ("exact", "misspecified"):
        some = of_kind(rows, "none", lambda row, at=level: row["level"] == at)
        lines.append(f"| {level} nulls: an effect named | {rate(r['named'] for r in some)} |")
        lines.append(f"| {level} nulls: anything but none | {rate(not r['right'] for r in some)} |")
    outside, several = of_kind(rows, "outside"), of_kind(rows, "combination")
    scores = [row["f1"] or 0.0 for row in several]
    lines += [
        f"| outside the catalogue: not named, right channel and covariate | {rate(r['right'] for r in outside)} |",
        f"| outside the catalogue: an effect named | {rate(r['named'] for r in outside)} |",
        f"| pairs and triples: exact set | {rate(r['exact'] for r in several)} |",
        f"| pairs and triples: mean F1 | {np.mean(scores):.2f} of {len(scores)} |" if scores else "",
        f"| seconds a case: median, largest | {np.median([r['seconds'] for r in rows]):.0f}, "
        f"{max(r['seconds'] for r in rows):.0f} (processor: {np.median([r['cpu_seconds'] for r in rows]):.0f}) |",
    ]
    return _table("| measure | value (95 % interval) |", [line for line in lines if line])


def _parameters(rows: Sequence[Row]) -> str:
    """Coverage of the intervals; error at severity 2."""
    every = [p for row in rows for p in row["parameters"]]
    middle = [
        p["relative_error"]
        for row in of_kind(rows, "single", lambda row: row["severity"] == 2)
        for p in row["parameters"]
        if p["relative_error"] is not None
    ]
    if not coverage(every):
        return ""
    lines = [f"| 90 % intervals that cover | {coverage(every)} |"]
    if middle:
        lines.append(f"| median relative error at severity 2 | {100 * np.median(middle):.0f} % of {len(middle)} |")
    by: dict[str, list[Row]] = defaultdict(list)
    for p in every:
        by[f"{p['effect']}.{p['parameter']}"].append(p)
    poor = {name: np.mean([p["inside"] for p in some if p["inside"] is not None]) for name, some in by.items()}
    worst = sorted((share, name) for name, share in poor.items() if share < 0.75)
    told = ", ".join(f"{name} {100 * share:.0f} % of {len(by[name])}" for share, name in worst)
    lines.append(f"| parameters that fewer than 75 % cover | {told or 'none'} |")
    return _table("| parameters of rightly named effects | value |", lines)


def closures(row: Row) -> tuple[float, float] | None:
    """(answer, placebo) as shares of what the judge scenes' log-likelihood gains with the true effects, fitted from
    their true parameters, in the channels that these change; None where that is less than LEAST."""
    channels = sorted({channel for name in row["truth"] for channel in EFFECTS[name].channels})
    reach = sum(row["known"]["gained"][name][0] for name in channels)
    if reach < LEAST:
        return None
    answer, _, placebo = np.sum([row["gained"][name] for name in channels], axis=0)
    return float(answer / reach), float(placebo / reach)


LEAST = 1.0
"""Nats per scene below which there is no gap that the truth could close: about what the bar asks for."""


def _gaps(rows: Sequence[Row]) -> str:
    right = [row for row in rows if row.get("known")]
    found = [pair for pair in map(closures, right) if pair]
    named = [row["closure"] for row in rows if row.get("closure") is not None and row["exact"] and row["truth"]]
    if not found:
        return ""
    reached, placebo = np.array(found).T
    return _table(
        "| gap on judge scenes (log-likelihood), exactly named cases | value |",
        [
            f"| median closure against free curves | {np.median(named):.2f} of {len(named)} |",
            f"| median share of what the true effects reach, fitted from their true parameters | "
            f"{np.median(reached):.2f} of {len(reached)} |",
            f"| of these at least 90 % | {rate(reached >= 0.9)} |",
            f"| median share that the placebo reaches | {np.median(placebo):.2f} |",
            f"| placebo at most half | {rate(placebo <= 0.5)} |",
            f"| the truth gains less than {LEAST:g} nat per scene | {len(right) - len(found)} of {len(right)} |",
        ],
    )


def _rivals(rows: Sequence[Row]) -> str:
    """What simpler methods reach on the same cases, and what an oracle detects."""
    rows = [row for row in rows if row["verdict"] != "error"]
    single = of_kind(rows, "single")
    severities = sorted({row["severity"] for row in single})
    names = [*(f"severity {s:g}: right first" for s in severities), "exact nulls: named", "misspecified: named",
             "outside: named", "pairs and triples: F1"]  # fmt: skip
    lines = []
    for name in ("discover", *RIVALS):

        def judged(some: Sequence[Row], part: str, who: str = name) -> list[Any]:
            if who == "discover":
                return [row["first_right" if part == "right" and row["kind"] == "single" else part] for row in some]
            return [judge_rival(row, row["rivals"][who])[part] for row in some]

        cells = [_share(judged([r for r in single if r["severity"] == s], "right")) for s in severities]
        cells += [
            _share(judged(of_kind(rows, "none", lambda row, at=level: row["level"] == at), "named"))
            for level in ("exact", "misspecified")
        ]
        cells.append(_share(judged(of_kind(rows, "outside"), "named")))
        scores = [f1 or 0.0 for f1 in judged(of_kind(rows, "combination"), "f1")]
        cells.append(f"{np.mean(scores):.2f}" if scores else "-")
        lines.append(f"| {name} | {' | '.join(cells)} |")
    power = [[row["oracle"] for row in single if row["severity"] == s] for s in severities]
    cells = [f"{100 * np.mean(some):.0f} %" if some else "-" for some in power]
    lines.append(f"| oracle: detects, without naming | {' | '.join([*cells, '5 %', '5 %', '-', '-'])} |")
    return _table(f"| method | {' | '.join(names)} |", lines)


def _share(good: Sequence[Any]) -> str:
    return f"{100 * np.mean([bool(value) for value in good]):.0f} %" if good else "-"


def _by_effect(rows: Sequence[Row]) -> str:
    """Right first / in the set, of so many cases, by effect and severity."""
    single = of_kind(rows, "single")
    severities = sorted({row["severity"] for row in single})
    lines = []
    for name in sorted({row["truth"][0] for row in single}):
        cells = []
        for s in severities:
            some = [row for row in single if row["truth"] == [name] and row["severity"] == s]
            right = sum(row["first_right"] for row in some)
            covered = sum(row["in_set"] for row in some)
            cells.append(f"{right} / {covered} of {len(some)}" if some else "-")
        lines.append(f"| {name}{'*' if name in ONLY_JOINTLY else ''} | {' | '.join(cells)} |")
    note = "\n\nRight first / in the set. * not counted as separable." if lines else ""
    return _table(f"| effect | {' | '.join(f'severity {s:g}' for s in severities)} |", lines) + note


def answer_of(row: Row) -> str:
    return " + ".join(row["answer"]) or row["verdict"]


def hidden_in(row: Row) -> str:
    return " + ".join(row["truth"]) or f"none, {row['level']}"


def _answers(rows: Sequence[Row]) -> str:
    table: dict[str, Counter[str]] = defaultdict(Counter)
    for row in rows:
        table[hidden_in(row)][answer_of(row)] += 1
    lines = [
        f"| {hidden} | {', '.join(f'{answer} {n}' for answer, n in table[hidden].most_common())} |"
        for hidden in sorted(table)
    ]
    return _table("| hidden | answers |", lines)
