"""Tables of Real2Sim2Real: the paper's two with ours beside them, and what they say."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from jaxsim.effects.chain import SensorModel
from jaxsim.metrics.cloud_checks import CloudCounts
from jaxsim.metrics.detection import COLUMNS, DIFFICULTIES
from jaxsim.report.markdown import markdown_table
from jaxsim.studies.real2sim2real.clouds import check_text, plain_rows
from jaxsim.studies.real2sim2real.scores import PAPER_OF_REAL, PAPER_ON_REAL, Average, read_average
from jaxsim.studies.real2sim2real.settings import REAL, Loop

Counts = Mapping[str, CloudCounts]
Paper = Mapping[str, Mapping[str, Sequence[float]]]
HEADS = ("3D@0.7", "BEV@0.7", "3D@0.5", "BEV@0.5", "2D@0.7", "AOS@0.7")


def score_rows(loop: Loop, *, of_real: bool) -> list[tuple[str, str, list[tuple[Average | None, float | None]]]]:
    """(kind, difficulty, cells) of the paper's second table, or `of_real` its third; a cell is ours, the paper's."""
    paper: Paper = PAPER_OF_REAL if of_real else PAPER_ON_REAL
    rows = []
    for kind in loop.config.kinds if of_real else loop.trained:
        trained, judged = (REAL, kind) if of_real else (kind, REAL)
        for difficulty in DIFFICULTIES:
            theirs = paper.get(kind, {}).get(difficulty)
            cells = [
                (
                    read_average(loop, trained, judged, column=column, difficulty=difficulty),
                    theirs[k] if theirs else None,
                )
                for k, column in enumerate(COLUMNS)
            ]
            rows.append((kind, difficulty, cells))
    return rows


def answer(loop: Loop) -> str:
    """Whether simulated intensity was worth anything: moderate 3D AP on real clouds, against depth alone."""
    found = [
        read_average(loop, kind, REAL, column=COLUMNS[0], difficulty="moderate")
        for kind in ("simulated_64", "raw_64", REAL)
    ]
    simulated, raw, real = found
    if simulated is None or raw is None:
        return "Not all detectors are scored yet."
    gain, seeds = simulated.mean - raw.mean, min(simulated.seeds, raw.seeds)
    spread = f"over {seeds} seeds" if simulated.spread is not None else "one seed, so the spread is not known"
    text = (
        f"Cars in real clouds, moderate, 3D AP: {simulated.mean:.1f} after training on simulated intensity, "
        f"{raw.mean:.1f} without it ({gain:+.1f}"
    )
    if simulated.spread is not None and raw.spread is not None:
        text += f"; standard deviation over seeds {simulated.spread:.1f} and {raw.spread:.1f}"
    return f"{text}; {spread})" + (f"; {real.mean:.1f} after training on real clouds." if real else ".")


def found_effects(loop: Loop) -> str:
    """What `discover` found the sensor to lack."""
    if not loop.effects.is_file():
        return "discover was not asked"
    return ", ".join(name for name, _ in SensorModel.load(loop.effects).effects) or "nothing"


def _cell(ours: Average | None, theirs: float | None) -> str:
    text = "-" if ours is None else f"{ours.mean:.2f}"
    text += f" ± {ours.spread:.2f}" if ours and ours.spread is not None else ""
    return f"{text} ({'-' if theirs is None else f'{theirs:.2f}'})"


def score_cells(loop: Loop, *, of_real: bool) -> list[list[str]]:
    """The rows of `score_rows` as text: ours, the paper's in brackets."""
    lines = []
    for kind, difficulty, cells in score_rows(loop, of_real=of_real):
        labels = next((str(ours.labels) for ours, _ in cells if ours), "-")
        lines.append([kind, difficulty, labels, *(_cell(ours, theirs) for ours, theirs in cells)])
    return lines


def loop_tables(loop: Loop, counts: Counts) -> str:
    """Markdown: both tables of scores, ours (the paper's), and the checks of the clouds."""
    on_real, of_real = score_cells(loop, of_real=False), score_cells(loop, of_real=True)
    return "\n\n".join(
        [
            answer(loop),
            f"The sensor was found to lack: {found_effects(loop)}.",
            f"Trained on a kind of cloud, scored on real ones; AP R40 of {loop.target}, last epochs (the paper's):",
            markdown_table(("trained on", "difficulty", "labels", *HEADS), on_real),
            "Trained on real clouds, scored on each kind:",
            markdown_table(("scored on", "difficulty", "labels", *HEADS), of_real),
            check_text(counts, loop.target),
        ]
    )


def plain_scores(loop: Loop, counts: Counts) -> dict[str, object]:
    """All tables for JSON."""

    def scores(of_real: bool) -> list[dict[str, object]]:
        return [
            {
                "clouds": kind,
                "difficulty": difficulty,
                "unit": "%",
                **{
                    head: {"value": a and a.mean, "spread": a and a.spread, "seeds": a and a.seeds, "paper": paper}
                    for head, (a, paper) in zip(HEADS, cells, strict=True)
                },
            }
            for kind, difficulty, cells in score_rows(loop, of_real=of_real)
        ]

    return {
        "answer": answer(loop),
        "on_real": scores(False),
        "of_real": scores(True),
        "clouds": plain_rows(counts, loop.target),
    }
