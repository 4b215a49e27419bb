"""One case from its making to its score."""

from __future__ import annotations

import json
import resource
import shutil
import time
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.blind.hidden import case_name, key_path, oracle_power, score_case
from benchmarks.blind.making import make
from benchmarks.blind.plan import Job, Settings
from benchmarks.blind.rivals import rival_answers
from benchmarks.blind.rows import code_version
from jaxsim.discover import Comparison, discover, judge_known, read_comparison
from jaxsim.discover.model.cast import blocks
from jaxsim.effects import EFFECTS, get_effect


def run_case(job: Job, settings: Settings, folder: Path, *, effects: Iterable[str] = tuple(EFFECTS)) -> dict[str, Any]:
    """Makes a case in `folder`, lets `discover` answer with `effects` as candidates, writes the verdict, and only then
    opens the key. Frames are removed in the end; verdict and key stay.

    Returns the row of cases.jsonl: the score (benchmarks/blind/hidden/score.py) and
        key, settings, seed, code; seconds and cpu_seconds of the answer alone; memory_gib, the process's largest;
        rivals: what simpler methods answer; oracle: the chance that an oracle detects what is hidden
            (first world); place: where the case was taken (that of cast rays);
        where, ranking: the verdict's first places and gains; drawn: its nulls, if any were drawn; closure;
        gap: {channel: [before, after, floor, placebo]}, mean errors; gained: {channel: [answer, floor, placebo]}, nats
            per scene of the judge scenes' log-likelihood;
        known: the same of the true effects, fitted from their true parameters (rightly named cases; else None).
    """
    case = folder / case_name(job.place(sealed=settings.sealed))
    _remove(case)
    make(job, settings, case)
    began, spent = time.monotonic(), time.process_time()
    comparison = read_comparison(case / "simulated", case / "measured")
    result = discover(comparison, effects=effects, nulls=settings.drawn)
    result.verdict.save(case / "out")
    seconds, cpu_seconds = time.monotonic() - began, time.process_time() - spent

    scored = score_case(case)
    verdict, key = result.verdict.to_json(), json.loads(key_path(case).read_text())
    for part in ("simulated", "measured"):
        shutil.rmtree(case / part)
    right = scored["kind"] in ("single", "combination") and scored["exact"]
    return {
        "key": job.key,
        "settings": settings.__dict__,
        "seed": job.seed(sealed=settings.sealed),
        "code": code_version(),
        "seconds": round(seconds, 2),
        "cpu_seconds": round(cpu_seconds, 2),
        "memory_gib": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20, 2),
        **scored,
        "rivals": rival_answers(result, _rays(comparison, len(result.verdict.find))),
        "oracle": oracle_power(key) if settings.world == "home" else None,
        "place": key["world"]["place"] if settings.world == "raycast" else None,
        "where": verdict["where"][:5],
        "drawn": verdict["nulls"],
        "ranking": [[rank["name"], rank["gain"]] for rank in verdict["ranking"][:5]],
        "gains": {one["name"]: one["gain"]["value"] for one in verdict["effects"]},
        "p_values": {one["name"]: one["p_value"] for one in verdict["effects"]},
        **_gap(result.verdict.gap, result.verdict.closure),
        "known": _gap(*judge_known(comparison, true_effects(key, comparison))) if right else None,
    }


def _remove(case: Path) -> None:
    """What a killed run left of this case."""
    if case.exists():
        shutil.rmtree(case)
    key_path(case).unlink(missing_ok=True)


def _rays(comparison: Comparison, scenes: int) -> int:
    """Rays of so many scenes that the fits look at."""
    rows = comparison.scan.range_m.shape[1]
    chosen = blocks(comparison.scenes, *comparison.scan.range_m.shape[1:])
    return int(chosen.column.size * rows * scenes / len(set(chosen.scene)))


def _gap(gap: Mapping[str, Any], closure: Any) -> dict[str, Any]:
    numbers = {name: [float(x) for x in (g.before, g.after, g.floor, g.placebo)] for name, g in gap.items()}
    gained = {name: [float(x) for x in (g.gained.value, g.gained.floor, g.gained.placebo)] for name, g in gap.items()}
    return {"closure": closure.value if closure else None, "gap": numbers, "gained": gained}


def made_again(row: Mapping[str, Any], case: Path) -> tuple[Comparison, dict[str, dict[str, Any]]]:
    """The comparison of a row's case, which follows from the row and is made in the folder `case`, and what was hidden
    in it (`true_effects`)."""
    # The key ends with effect, severity, nuisances and number; before them there may be the cell.
    effect, severity, nuisance, repeat = row["key"].split()[-4:]
    make(Job(effect, float(severity), nuisance, int(repeat)), Settings(**row["settings"]), case)
    comparison = read_comparison(case / "simulated", case / "measured")
    return comparison, true_effects(json.loads(key_path(case).read_text()), comparison)


def true_effects(key: Mapping[str, Any], comparison: Comparison) -> dict[str, dict[str, Any]]:
    """The hidden effects' parameters within the catalogue's bounds; neutral where no ray could show one."""
    rows, found = comparison.scan.range_m.shape[1], {}
    for entry in key["effects"]:
        effect, values = get_effect(entry["name"]), {}
        for name, value in entry["parameters"].items():
            p = effect.parameters[name]
            known = [p.neutral if v is None else v for v in (value if isinstance(value, list) else [value])]
            clipped = np.clip(np.asarray(known, np.float32), p.low, p.high)
            values[name] = clipped if isinstance(value, list) else clipped[0]
            if isinstance(value, list) and clipped.shape != p.dims(rows):
                raise ValueError(f"{effect.name}: the key has {clipped.size} values of {name}; want {p.dims(rows)}")
        found[effect.name] = values
    return found
