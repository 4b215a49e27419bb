"""What a control does beside a simulator that learned: `python -m benchmarks.blind.control OUT [--sealed] [--help]`.

Streets of the hidden world, 48 a case, one sensor. Boosted trees (scikit-learn, the extra `trees`) learn its
intensities from the first 16, by the absolute error. They see range, row, class and colour, but no angles (but for
`--angles`), so that the cosine of incidence is what they lack; what they predict stands in the simulated frames. The
next 16 are the control, and the effect is hidden in the last 16 alone. `discover` answers these twice: alone, and
beside its answer of the control (`--control`). One JSON line a case goes to OUT/cases.jsonl; the same command again
goes on where it stopped. `--table` runs nothing.

Development cases have seeds below 10000; `--sealed` ones, on which nothing may be tuned, from 10000 on.
"""

from __future__ import annotations

import argparse
import shutil
import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from benchmarks.blind.hidden import Key, case_name, key_path, make_case, score
from benchmarks.blind.hidden.part import Part
from benchmarks.blind.plan import Job
from benchmarks.blind.rows import code_version, run_cases
from benchmarks.blind.tables import rate
from jaxsim.compilation import enable_compilation_cache
from jaxsim.discover import Comparison, Control, discover, read_comparison
from jaxsim.discover.read.control import write_sides
from jaxsim.files import need

EACH = 16
"""Streets to learn from, of the control, and of what is asked."""
HIDDEN = (
    *("none", "range_falloff", "none", "beam_gain", "none", "gamma_response", "none", "atmospheric_extinction"),
    *("none", "random_dropout", "none", "intensity_offset", "none", "beam_range_bias", "none", "window_contamination"),
)
"""What is hidden, case by case."""
TREES = {"loss": "absolute_error", "max_iter": 150, "learning_rate": 0.15, "max_leaf_nodes": 63, "random_state": 0}
EVERY = 3
"""Every so many cells are learned from."""
Row = dict[str, Any]


def main(argv: list[str] | None = None) -> None:
    args = _arguments(argv)
    settings = {"sealed": args.sealed, "scenes": 3 * EACH, "angles": args.angles}
    enable_compilation_cache()
    jobs = [
        Job(effect, args.severity, "default", 1000 * repeat + k)
        for repeat in range(args.repeats)
        for k, effect in enumerate(HIDDEN)
        if not args.only or effect in args.only
    ]
    cases = {job.key: partial(run, job, args.out / "cases", settings) for job in jobs}
    run_cases(args.out, {} if args.table else cases, summary=summary, settings=settings, most=args.most)


def run(job: Job, folder: Path, settings: Row) -> Row:
    """One case from its making to both answers."""
    case = folder / case_name(job.place(sealed=settings["sealed"]))
    shutil.rmtree(case, ignore_errors=True)
    key_path(case).unlink(missing_ok=True)
    seed = job.seed(sealed=settings["sealed"])
    late = Part("time", tuple(range(2 * EACH, 3 * EACH)), None, None, ((),) * 3 * EACH)
    key = make_case(case, effect=job.effect, severity=job.severity, seed=seed, scenes=3 * EACH, part=late)
    error = learn(case, angles=settings["angles"])
    before, now = divide(case, "control", 1), divide(case, "now", 2)
    began = time.process_time()
    answered = discover(read_comparison(*before))
    answered.verdict.save(case / "answer")
    answered.effects_model.save(case / "answer" / "sensor.json")
    write_sides(case / "answer", *before)
    comparison = read_comparison(*now)
    alone = score_of(key, comparison)
    beside = score_of(key, replace(comparison, control=Control.load(case / "answer")))
    row = {
        "key": job.key,
        "settings": settings,
        "seed": seed,
        "code": code_version(),
        "cpu_seconds": round(time.process_time() - began, 1),
        "kind": "null" if job.effect == "none" else "single",
        "truth": job.effect,
        "learned_error": round(error, 4),
        "control": [effect.name for effect in answered.verdict.effects],
        "alone": alone,
        "beside": beside,
    }
    shutil.rmtree(case)
    return row


def learn(case: Path, *, angles: bool) -> float:
    """Puts what trees predict, that learned from the first streets, into all simulated frames; returns their mean
    absolute error of ln I on the control's streets."""
    trees = need("sklearn.ensemble", extra="trees", by="control")
    names = sorted(path.name for path in (case / "measured").glob("*.npz"))
    features, targets = zip(*(cells(case, name, angles=angles) for name in names[:EACH]), strict=True)
    model = trees.HistGradientBoostingRegressor(**TREES)
    model.fit(np.concatenate(features)[::EVERY], np.concatenate(targets)[::EVERY])
    errors = []
    for name in names:
        path = case / "simulated" / name
        with np.load(path) as stored:
            arrays = dict(stored)
        predicted = np.square(model.predict(features_of(arrays, angles=angles))).reshape(arrays["range"].shape)
        arrays["intensity"] = np.where(arrays["range"] > 0, np.clip(predicted, 1e-4, 1), 0).astype(np.float32)
        np.savez(path, **arrays)
        if name in names[EACH : 2 * EACH]:
            with np.load(case / "measured" / name) as measured:
                both = (measured["range"] > 0) & (arrays["range"] > 0) & (measured["intensity"] > 0)
                errors.append(np.abs(np.log(measured["intensity"][both] / arrays["intensity"][both])).mean())
    return float(np.mean(errors))


def cells(case: Path, name: str, *, angles: bool) -> tuple[Float[np.ndarray, "n k"], Float[np.ndarray, " n"]]:
    """Features and roots of measured intensities of the cells of a frame that both sides show."""
    with np.load(case / "simulated" / name) as simulated, np.load(case / "measured" / name) as measured:
        both = ((simulated["range"] > 0) & (measured["range"] > 0)).ravel()
        return features_of(dict(simulated), angles=angles)[both], np.sqrt(measured["intensity"].ravel()[both])


def features_of(arrays: dict[str, np.ndarray], *, angles: bool) -> Float[np.ndarray, "n k"]:
    """What the trees see of each cell of a simulated frame."""
    rows = np.broadcast_to(np.arange(arrays["range"].shape[0])[:, None], arrays["range"].shape)
    told = [arrays["range"], rows, arrays["semantic"], *np.moveaxis(arrays["rgb"], -1, 0)]
    told += [arrays["incidence"]] if angles else []
    return np.stack([raster.ravel() for raster in told], axis=1).astype(np.float32)


def divide(case: Path, name: str, part: int) -> tuple[Path, Path]:
    """Moves the streets of a part to folders of their own: simulated, measured."""
    moved = []
    for side in ("simulated", "measured"):
        into = case / name / side
        into.mkdir(parents=True)
        for path in sorted((case / side).glob("*.npz")):
            if int(path.stem) // EACH == part:
                path.rename(into / path.name)
        (into / "grid.json").write_text((case / side / "grid.json").read_text())
        moved.append(into)
    return moved[0], moved[1]


def score_of(key: Key, comparison: Comparison) -> Row:
    """What `discover` answers of a comparison, scored."""
    verdict = discover(comparison).verdict.to_json()
    scored = score(key, verdict)
    parts = ("verdict", "answer", "named", "first_right", "false_names", "in_set")
    return {name: scored[name] for name in parts} | {"notes": [n for n in verdict["notes"] if "not said" in n]}


def summary(rows: Sequence[Row]) -> str:
    """Both answers side by side: all cases together, and one by one."""
    lines = ["| | alone | with the control |", "|---|---|---|"]
    nulls = [row for row in rows if row["kind"] == "null"]
    single = [row for row in rows if row["kind"] == "single"]
    asked = [
        ("nulls: an effect named", nulls, lambda one: one["named"]),
        ("nulls: *none*", nulls, lambda one: one["verdict"] == "none"),
        ("effects: right first", single, lambda one: one["first_right"]),
        ("effects: a false name", single, lambda one: bool(one["false_names"])),
    ]
    for words, some, told in asked:
        counts = [rate(told(row[side]) for row in some) for side in ("alone", "beside")]
        lines.append(f"| {words} | {counts[0]} | {counts[1]} |")
    lines += ["", "| hidden | control | alone | with the control |", "|---|---|---|---|"]
    for row in sorted(rows, key=lambda row: (row["truth"] != "none", row["key"])):
        told = [", ".join(row[side]["answer"]) or row[side]["verdict"] for side in ("alone", "beside")]
        lines.append(f"| {row['truth']} | {', '.join(row['control']) or '-'} | {told[0]} | {told[1]} |")
    return "\n".join(lines)


def _arguments(argv: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--sealed", action="store_true", help="the sealed cases instead of the development ones")
    parser.add_argument("--repeats", type=int, default=1, help="of every case")
    parser.add_argument("--severity", type=float, default=2.0)
    parser.add_argument("--angles", action="store_true", help="trees see the angle of incidence, too")
    parser.add_argument("--only", nargs="+", metavar="EFFECT", help="cases that hide this alone, as in 'none'")
    parser.add_argument("--most", type=int, default=None, help="stop after so many new cases")
    parser.add_argument("--table", action="store_true", help="run nothing; show what OUT holds")
    return parser.parse_args(argv)


if __name__ == "__main__":
    main()
