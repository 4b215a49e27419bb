"""Where a training's metrics go besides metrics.jsonl: trackers, by entry points of the group `jaxsim.metrics_log`.

JAXSIM_METRICS_LOG names the trackers of a run (`wandb`, `mlflow`, or those of installed packages), separated by commas.
Nothing is sent anywhere unless it is set. An entry point is a function of a run's folder and of the step that the run
begins after; it returns a function of a step and its values, which is called with every line of metrics.jsonl.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Mapping
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

GROUP = "jaxsim.metrics_log"
ASKED = "JAXSIM_METRICS_LOG"
Track = Callable[[int, Mapping[str, float]], None]
"""Takes a step and its values."""

_log = logging.getLogger(__name__)


def trackers(folder: Path, start: int) -> list[Track]:
    """The trackers that JAXSIM_METRICS_LOG names. Raises ValueError for one that is not installed or does not start."""
    names = [name.strip() for name in os.environ.get(ASKED, "").split(",") if name.strip()]
    known = {point.name: point for point in entry_points(group=GROUP)}
    made = []
    for name in names:
        if name not in known:
            raise ValueError(
                f"run: {ASKED} names {name!r}, which is no tracker; known ones are "
                f"{', '.join(sorted(known)) or 'none'} (entry points of the group {GROUP})"
            )
        try:
            made.append(_patient(name, known[name].load()(folder, start)))
        except Exception as error:
            raise ValueError(
                f"run: the tracker {name} does not start ({type(error).__name__}: {error}); mend it, or leave it out "
                f"of {ASKED}"
            ) from error
    return made


def _patient(name: str, track: Track) -> Track:
    """The same; where it fails once it is told once and left out, for a tracker must not end a training."""
    works = True

    def guarded(step: int, values: Mapping[str, float]) -> None:
        nonlocal works
        if not works:
            return
        try:
            track(step, values)
        except Exception as error:
            works = False
            _log.warning(
                "run: the tracker %s failed at step %d (%s: %s) and gets no more; metrics.jsonl goes on",
                *(name, step, type(error).__name__, error),
            )

    return guarded


def wandb(folder: Path, start: int) -> Track:
    """Weights & Biases: one run a folder, resumed with it; WANDB_PROJECT and the like set the rest."""
    client = _client("wandb")
    run = client.init(dir=str(folder), id=folder.name, name=folder.name, resume="allow")
    return lambda step, values: run.log(dict(values), step=step)


def mlflow(folder: Path, start: int) -> Track:
    """MLflow: one run a folder, by its name; MLFLOW_TRACKING_URI and the like set the rest."""
    client = _client("mlflow")
    client.start_run(run_name=folder.name)
    # MLflow's names hold letters, digits, _ - . / and spaces alone.
    return lambda step, values: client.log_metrics({name.replace("@", "_at_"): v for name, v in values.items()}, step)


def _client(name: str) -> Any:
    try:
        return import_module(name)
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(f"{name} is not installed: pip install {name}") from error
