"""What learned laws gain on judge scenes, held against the hidden law itself:

    python -m benchmarks.blind.learned OUT --cases 1 --severity 4

Every kind outside the catalogue (hidden/outside.py), so many cases each. The null model is fitted, and what no effect
describes is learned and added as `discover` does it, with no effect of the catalogue to take its place; that what
repeats is learned on top. Beside it stands the hidden law: what it did to each ray, noted as the case was made. Both
are asked what the log-likelihood of judge scenes gains in the law's channel, noise and levels fitted beside them. One
JSON line a case goes to OUT/cases.jsonl; the same command again goes on where it stopped. `--table` runs nothing.
Development seeds alone.
"""

from __future__ import annotations

import argparse
import hashlib
import shutil
import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from benchmarks.blind.hidden import key_path, list_outside, make_case
from benchmarks.blind.hidden.frames import State
from benchmarks.blind.hidden.outside import OUTSIDE
from benchmarks.blind.hidden.plan import Plan
from benchmarks.blind.plan import Job
from benchmarks.blind.rows import code_version, run_cases
from jaxsim.devices import by_small_steps
from jaxsim.discover.add import add_effects
from jaxsim.discover.find.dependences import find_dependences
from jaxsim.discover.find.division import NOTHING_YET, AllScenes, Division
from jaxsim.discover.law.learn import curve_form
from jaxsim.discover.model.fit import in_place
from jaxsim.discover.model.null_model import refitted
from jaxsim.discover.name.answer import decide
from jaxsim.discover.name.doubts import NO_DOUBTS
from jaxsim.discover.name.select import Choice
from jaxsim.discover.name.stepped import stepped
from jaxsim.discover.read import read_comparison
from jaxsim.discover.repeats.examine import examine, with_repeats
from jaxsim.discover.show import judge_gains
from jaxsim.effects import Law
from jaxsim.effects.effect import CHANNELS
from jaxsim.effects.learned import CHANGE
from jaxsim.effects.rays import Rays, Scan

Row = dict[str, Any]
Rasters = Float[np.ndarray, "f r c"]
ENOUGH = 0.8
"""Share of the hidden law's gain that a learned one is to reach."""


def main(argv: list[str] | None = None) -> None:
    args = _arguments(argv)
    jobs = [Job(f"outside:{name}", args.severity, "default", k) for k in range(args.cases) for name in args.only]
    cases = {job.key: partial(run, job, args.out / "case") for job in jobs}
    run_cases(args.out, {} if args.table else cases, summary=summary)


@by_small_steps
def run(job: Job, folder: Path) -> Row:
    """One case from its making to the two gains."""
    shutil.rmtree(folder, ignore_errors=True)
    key_path(folder).unlink(missing_ok=True)
    name = job.effect.removeprefix("outside:")
    kind = OUTSIDE[name]
    seed = job.seed(sealed=False)
    truth = make_noted(folder, job, seed)
    began = time.process_time()
    comparison = read_comparison(folder / "simulated", folder / "measured")
    shutil.rmtree(folder)
    found = find_dependences(Division.of(comparison))
    null = found.null_model.problem
    answer = decide(null, Choice((), (), null), found.single)
    quiet = {"doubts": NO_DOUBTS, "beside": lambda curve, effects, bar: (), "log": lambda line: None}
    answer = stepped(null, answer, **quiet)
    form = curve_form(null, *answer.curve, crossed=found.crossed) if answer.curve else None
    added = add_effects(null, (), known=NOTHING_YET, form=form)
    noise = refitted(in_place(null, added.chain)).noise
    repeats = examine(found.null_model, added.chain, noise)
    added = with_repeats(added, [one.learned for one in repeats])
    k = CHANNELS.index(kind.channel)
    every = AllScenes.of(found.null_model)
    gained = judge_gains(every, added.chain)[k] if added.chain else 0.0
    return {
        "key": job.key,
        "kind": name,
        "seed": seed,
        "code": code_version(),
        "channel": kind.channel,
        "covariates": list(kind.covariates),
        "learned": [law.name for law in added.effects_model.learned],
        "repeats": [one.repeat.formula for one in repeats],
        "gained": float(gained),
        "truth": float(judge_gains(every, [(truth_law(truth, kind.channel, null.scan), {})])[k]),
        "cpu_seconds": round(time.process_time() - began, 1),
    }


def make_noted(folder: Path, job: Job, seed: int, **size: Any) -> Rasters:
    """Makes the case (`size` as make_case takes it), and gives what its law did to each ray: nats, m or share lost."""
    name = job.effect.removeprefix("outside:")
    kind = OUTSIDE[name]
    noted: list[np.ndarray] = []

    def make(*given: Any) -> Plan:
        plan = kind.make(*given)
        [(stage, hook)] = plan.hooks

        def noting(state: State) -> None:
            intensity, bias_m, drop = state.intensity, state.bias_m, state.drop
            hook(state)
            with np.errstate(divide="ignore", invalid="ignore"):
                change = {
                    "intensity": np.log(state.intensity / intensity),
                    "range": state.bias_m - bias_m,
                    "drop": 1 - (1 - state.drop) / (1 - drop),
                }[kind.channel]
            noted.append(np.where(np.isfinite(change), change, 0.0))

        return replace(plan, hooks=[(stage, noting)])

    OUTSIDE[name] = kind._replace(make=make)
    try:
        make_case(folder, effect=job.effect, severity=job.severity, seed=seed, nuisance=job.nuisance, **size)
    finally:
        OUTSIDE[name] = kind
    return np.stack(noted).astype(np.float32)


def truth_law(change: Rasters, channel: str, scan: Scan) -> Law:
    """What the hidden law did, ray by ray: frames are told by their time."""
    times = np.asarray(scan.time_s)
    assert (np.diff(times) > 0).all(), "frames of this world rise in time"

    def apply(p: dict[str, Any], rays: Rays) -> Rays:
        frame = jnp.searchsorted(jnp.asarray((times[1:] + times[:-1]) / 2), rays.time_s)
        return CHANGE[channel](rays, jnp.where(rays.hit, jnp.asarray(change)[frame, rays.row, rays.column], 0.0))

    return Law(
        name=f"the hidden law of case {hashlib.sha256(change.tobytes()).hexdigest()[:12]}",
        parameters={},
        channels=(channel,),
        apply=apply,
    )


def summary(rows: Sequence[Row]) -> str:
    """A line a case, and how many reach ENOUGH."""
    if not rows:
        return "no case yet"
    enough = [row["gained"] >= ENOUGH * row["truth"] for row in rows]
    text = [
        f"{len(rows)} cases; code {', '.join(sorted({row['code'] for row in rows}))}. {sum(enough)} of {len(rows)} "
        f"reach {100 * ENOUGH:.0f} % of the hidden law's gain.",
        "",
        "| kind | learned | nats a judge scene | of the hidden law | share |",
        "|---|---|---|---|---|",
    ]
    for row in sorted(rows, key=lambda row: row["key"]):
        laws = ", ".join(name.removeprefix("learned ") for name in row["learned"]) or "nothing"
        share = row["gained"] / max(row["truth"], 1e-9)
        text.append(f"| {row['kind']} | {laws} | {row['gained']:.1f} | {row['truth']:.1f} | {100 * share:.0f} % |")
    return "\n".join(text)


def _arguments(argv: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--cases", type=int, default=1, help="of each kind")
    parser.add_argument("--severity", type=float, default=4.0)
    parser.add_argument("--only", nargs="+", choices=list_outside(), default=list_outside(), metavar="KIND")
    parser.add_argument("--table", action="store_true", help="run nothing; show what OUT holds")
    return parser.parse_args(argv)


if __name__ == "__main__":
    main()
