"""Effects that act in a part: `python -m benchmarks.blind.regimes OUT [--sealed] [--repeats 1] [--help]`.

Hides effects of severity 8 (`--severity`) in a part of the recording alone: from a moment on or under a tag (about half
of the scenes), in half of the scenes that nothing tells from the others, in a sector (a fifth to a third of the
columns); and everywhere, where no regime may be found. All frames have tags, most of which mean nothing. `discover`
answers with the whole catalogue, or with the candidates of `--effects`. One JSON line a case goes to OUT/cases.jsonl;
the same command again goes on.

F1 is that of cells (frames x columns): those in which the answer says that the hidden effect acts against those where
it does; 0 where it is not named. Bias is the mean over cases of <fitted, true> / <true, true> - 1, parameters as
distances from neutral in their scales: so it is relative to the hidden size, 0 is right and -0.5 half of it. Beside it
stand the effect fitted to all scenes and sectors, and an oracle that knows effect and part.

Development cases have seeds below 10000; `--sealed` ones, on which nothing may be tuned, from 10000 on.
"""

from __future__ import annotations

import argparse
import json
import shutil
import time
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.blind.hidden import case_name, key_path, make_case, score_case
from benchmarks.blind.hidden.simulator import SIMULATORS
from benchmarks.blind.plan import Job
from benchmarks.blind.rows import code_version, run_cases
from benchmarks.blind.tables import rate
from jaxsim.compilation import enable_compilation_cache
from jaxsim.devices import by_small_steps
from jaxsim.discover import Comparison, discover, read_comparison
from jaxsim.discover.find.division import Division, NullModel
from jaxsim.discover.model.fit import fit
from jaxsim.discover.model.parameters import to_values
from jaxsim.effects import EFFECTS, Effect, get_effect
from jaxsim.effects.region import Region, within

HIDDEN = ("beam_gain", "range_falloff", "beam_range_bias", "gamma_response", "random_dropout")
PARTS = ("time", "tag", "sector", "scenes", "everywhere")
Row = dict[str, Any]


def main(argv: list[str] | None = None) -> None:
    args = _arguments(argv)
    settings = {"sealed": args.sealed, "scenes": 16, "regimes": True, "simulator": args.simulator}
    enable_compilation_cache()
    about = {"settings": settings, "folder": args.out / "cases", "catalogue": args.effects}
    cases = {
        job.key: partial(answer, effect, part, job, **about)
        for effect, part, job in plan(range(args.first, args.first + args.repeats), args.severity)
    }
    run_cases(args.out, cases, summary=summary, settings=settings, most=args.most)


def plan(numbers: Sequence[int], severity: float) -> list[tuple[str, str, Job]]:
    """Effect, part and case; each effect with each part once before any twice, no two neighbours with the same."""
    return [
        (effect, part, Job(f"{effect} in {part}", severity, "default", repeat))
        for repeat in numbers
        for shift in range(len(HIDDEN))
        for effect, part in zip(HIDDEN, PARTS[shift:] + PARTS[:shift], strict=True)
    ]


def answer(effect: str, part: str, job: Job, *, settings: Row, folder: Path, catalogue: Sequence[str]) -> Row:
    """Makes a case, lets `discover` answer, and only then opens the key."""
    case = folder / case_name(job.place(sealed=settings["sealed"]))
    shutil.rmtree(case, ignore_errors=True)
    key_path(case).unlink(missing_ok=True)
    seed = job.seed(sealed=settings["sealed"])
    make_case(case, effect=effect, severity=job.severity, seed=seed, part=part, simulator=settings["simulator"])
    begun = time.process_time()
    comparison = read_comparison(case / "simulated", case / "measured")
    result = discover(comparison, effects=catalogue or None)
    spent = time.process_time() - begun
    result.verdict.save(case / "out")
    scored = score_case(case)
    key = json.loads(key_path(case).read_text())
    grid = json.loads((case / "measured" / "grid.json").read_text())
    for side in ("simulated", "measured"):
        shutil.rmtree(case / side)
    verdict = result.verdict.to_json()
    true = cells(key["part"], grid)
    told = [one for one in verdict["regimes"] if one["effect"] == effect]
    named = effect in scored["answer"]
    claimed = cells_of(told[0]["where"], grid) if told else np.full(true.shape, named)
    entry, law = key["effects"][0]["parameters"], get_effect(effect)
    everywhere = next(one for one in result.candidates if one.effect.name == effect)
    fits = [values_of(law, to_values(law, one.z)) for one in everywhere.fits]
    fitted = next((one["parameters"] for one in verdict["effects"] if one["name"] == effect), None)
    return {
        "key": job.key,
        "settings": settings,
        "seed": seed,
        "code": code_version(),
        "cpu_seconds": round(spent, 1),
        "part": part,
        "regimes": verdict["regimes"],
        "in_part": named,
        "divides": told[0]["divides"] if told else None,
        "f1": f1(claimed, true),
        "f1_everywhere": f1(np.full(true.shape, True), true),
        "bias": bias(law, {n: v["value"] for n, v in fitted.items()}, entry) if fitted else None,
        "bias_everywhere": float(np.mean([bias(law, one, entry) for one in fits])),
        "bias_oracle": bias(law, oracle(comparison, law, key["part"], entry), entry),
        **scored,
    }


def values_of(effect: Effect, given: Mapping[str, Any]) -> dict[str, Any]:
    """Plain numbers."""
    return {name: np.asarray(given[name], float) for name in effect.parameters if name in given}


def bias(effect: Effect, found: Mapping[str, Any], true: Mapping[str, Any]) -> float:
    """<found, true> / <true, true> - 1 over all parameters that the key knows."""
    parts: list[tuple[np.ndarray, np.ndarray]] = []
    for name, value in true.items():
        p = effect.parameters.get(name)
        if p is None or not p.to_fit or name not in found:
            continue
        t = np.array([np.nan if v is None else v for v in np.atleast_1d(np.array(value, object))], float)
        f = np.broadcast_to(np.asarray(found[name], float), t.shape)
        seen = np.isfinite(t)
        t, f = t[seen], f[seen]
        if effect.name == "beam_gain":
            # The level of all gains is the global gain's.
            t, f = t - t.mean(), f - f.mean()
            parts.append((f / p.scale, t / p.scale))
        else:
            parts.append(((f - p.neutral) / p.scale, (t - p.neutral) / p.scale))
    found_, true_ = (np.concatenate([pair[k] for pair in parts]) for k in (0, 1))
    return float(found_ @ true_ / (true_ @ true_) - 1)


@by_small_steps
def oracle(comparison: Comparison, effect: Effect, part: Mapping[str, Any], true: Mapping[str, Any]) -> dict[str, Any]:
    """The hidden effect fitted to the find scenes in its true part."""
    null = NullModel.of(Division.of(comparison)).problem
    names = {f"drive_{s:03d}" for s in part["scenes"]}
    frames = np.isin(comparison.scenes, sorted(names))
    sector = tuple(part["azimuth"]) if part["azimuth"] else None
    law = within(effect, Region(azimuth_rad=sector, scenes=tuple(sorted(names))), frames)
    start = {name: value for name, value in true.items() if name in effect.parameters and None not in np.ravel(value)}
    return values_of(effect, to_values(law, fit(law, null, starts=({}, start), steps=80).z))


def cells(part: Mapping[str, Any], grid: Mapping[str, Any]) -> np.ndarray:
    """(frames, columns): where the hidden effect acts."""
    inside = np.array([int(one["scene"].removeprefix("drive_")) in part["scenes"] for one in grid["frames"].values()])
    return inside[:, None] & in_sector(part["azimuth"], grid)[None]


def cells_of(where: Mapping[str, Any], grid: Mapping[str, Any]) -> np.ndarray:
    """(frames, columns): where an answer says that it acts."""
    frames = list(grid["frames"].values())
    time_s = np.array([one["time"] for one in frames]) - min(one["time"] for one in frames)
    first, last = where.get("time_s", (None, None))
    inside = (time_s >= (-np.inf if first is None else first)) & (time_s < (np.inf if last is None else last))
    if "tag" in where:
        inside &= [where["tag"] in one["tags"] for one in frames]
    if "scenes" in where:
        inside &= [one["scene"] in where["scenes"] for one in frames]
    return inside[:, None] & in_sector(where.get("azimuth_rad"), grid)[None]


def in_sector(sector: Sequence[float] | None, grid: Mapping[str, Any]) -> np.ndarray:
    """(columns,)."""
    azimuth = np.array(grid["azimuth"])
    return np.mod(azimuth - sector[0], 2 * np.pi) <= sector[1] - sector[0] if sector else azimuth < np.inf


def f1(claimed: np.ndarray, true: np.ndarray) -> float:
    """Harmonic mean of precision and recall of cells."""
    return float(2 * (claimed & true).sum() / max(claimed.sum() + true.sum(), 1))


def summary(rows: Sequence[Row]) -> str:
    """Figures by part, and every case."""
    lines = ["| part | cases | regime found | F1 | F1 if everywhere | bias | everywhere | oracle |", "|" + "---|" * 8]
    parts = [part for part in PARTS if any(row["part"] == part for row in rows)]
    groups = [(part, [row for row in rows if row["part"] == part]) for part in parts]
    groups.append(("all but everywhere", [row for row in rows if row["part"] != "everywhere"]))
    for name, some in groups:
        found = rate(bool(row["regimes"]) for row in some)
        numbers = [
            _mean(row[what] for row in some)
            for what in ("f1", "f1_everywhere", "bias", "bias_everywhere", "bias_oracle")
        ]
        lines.append(f"| {name} | {len(some)} | {found} | {' | '.join(numbers)} |")
    lines += ["", "| hidden | part | seed | answer | regimes | F1 | bias |", "|" + "---|" * 7]
    for row in sorted(rows, key=lambda row: (PARTS.index(row["part"]), row["truth"])):
        told = "; ".join(f"{one['effect']}: {one['divides']}" for one in row["regimes"]) or "none"
        answer = ", ".join(row["answer"]) or row["verdict"]
        off = "–" if row["bias"] is None else f"{row['bias']:+.3f}"
        lines.append(
            f"| {row['truth'][0]} | {row['part']} | {row['seed']} | {answer} | {told} | {row['f1']:.2f} | {off} |"
        )
    return "\n".join(lines)


def _mean(values: Iterable[float | None]) -> str:
    """With its standard error."""
    known = np.array([value for value in values if value is not None])
    if not len(known):
        return "–"
    error = f" ± {known.std(ddof=1) / np.sqrt(len(known)):.3f}" if len(known) > 1 else ""
    return f"{known.mean():.3f}{error}"


def _arguments(argv: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--sealed", action="store_true", help="the sealed cases instead of the development ones")
    parser.add_argument("--severity", type=float, default=8.0)
    parser.add_argument("--repeats", type=int, default=1, help="of each effect in each part")
    parser.add_argument("--first", type=int, default=0, help="number of the first of each, for cases never asked")
    parser.add_argument("--simulator", choices=SIMULATORS, default="ideal", help="errors of the simulated side")
    parser.add_argument("--effects", nargs="*", choices=EFFECTS, default=[], help="candidates, all if none is given")
    parser.add_argument("--most", type=int, default=None, help="stop after so many new cases")
    return parser.parse_args(argv)


if __name__ == "__main__":
    main()
