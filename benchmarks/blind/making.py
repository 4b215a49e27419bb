"""A case of any hidden world, as a run's settings ask for it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from benchmarks.blind import hidden
from benchmarks.blind.plan import Job, Settings


def make(job: Job, settings: Settings, case: Path) -> None:
    """Writes the case's two folders and, beside it, its key.

    Raises:
        ValueError: an unknown world, or what its generator refuses.
        ImportError: what a later world is made with is not installed.
    """
    about = {
        "effect": job.effect,
        "severity": job.severity,
        "seed": job.seed(sealed=settings.sealed),
        "nuisance": job.nuisance,
        "scenes": settings.scenes,
        "rows": settings.rows,
        "columns": settings.columns,
        "simulator": settings.simulator,
    }
    if settings.world == "home":
        hidden.make_case(case, **about)
        if settings.given == "bare":
            strip(case)
    elif settings.world == "raycast":
        # Its caster is an extra that the first world does without.
        from benchmarks.blind import raycast

        raycast.make_case(case, **about, sensor=settings.sensor, given=settings.given)
    elif settings.world == "mitsuba":
        # So is its renderer.
        from benchmarks.blind import mitsuba

        # Its streets have no level of nuisances.
        about = {name: value for name, value in about.items() if name != "nuisance"}
        mitsuba.make_case(about.pop("seed"), out=case, **about, sensor=settings.sensor, given=settings.given)
    else:
        raise ValueError(f"world {settings.world!r} is not known; choose home, raycast or mitsuba")


def strip(case: Path) -> None:
    """Leaves the simulated side its range and intensity alone, and both sides no time, speed or heading."""
    for path in (case / "simulated").glob("*.npz"):
        with np.load(path) as arrays:
            kept = {name: arrays[name] for name in ("range", "intensity")}
        np.savez(path, **kept)
    for part in ("measured", "simulated"):
        path = case / part / "grid.json"
        grid = json.loads(path.read_text())
        grid["frames"] = {name: {"scene": about["scene"]} for name, about in grid["frames"].items()}
        path.write_text(json.dumps(grid))
