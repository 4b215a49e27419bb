"""Trackers of a training's metrics: asked for, found, and harmless where they fail."""

from __future__ import annotations

import logging
import sys
from importlib.metadata import EntryPoint
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest

from jaxsim.runs import metrics_log
from jaxsim.runs.metrics_log import MetricsLog


@pytest.fixture
def module(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """A package with two trackers, as if installed."""
    own = ModuleType("own_tracker")
    own.seen = []
    own.good = lambda folder, start: lambda step, values: own.seen.append((folder.name, start, step, dict(values)))

    def broken(folder: Path, start: int):
        def track(step, values):
            own.seen.append(step)
            raise OSError("no network")

        return track

    own.broken = broken
    monkeypatch.setitem(sys.modules, "own_tracker", own)
    points = [EntryPoint(name, f"own_tracker:{name}", metrics_log.GROUP) for name in ("good", "broken", "absent")]
    monkeypatch.setattr(metrics_log, "entry_points", lambda group: points)
    return own


def test_nothing_is_sent_unless_asked(module, monkeypatch, tmp_path):
    monkeypatch.delenv(metrics_log.ASKED, raising=False)
    MetricsLog(tmp_path, 0).write(1, {"loss": 1.0})
    assert module.seen == []


def test_a_tracker_gets_every_line(module, monkeypatch, tmp_path):
    monkeypatch.setenv(metrics_log.ASKED, " good ,")
    log = MetricsLog(tmp_path, 4)
    log.write(5, {"loss": 1.0})
    log.write(6, {"loss": 0.5})
    assert module.seen == [(tmp_path.name, 4, 5, {"loss": 1.0}), (tmp_path.name, 4, 6, {"loss": 0.5})]
    # Of several processes only the first writes.
    MetricsLog(tmp_path, 4, writes=False).write(7, {"loss": 0.1})
    assert len(module.seen) == 2


def test_one_that_fails_is_told_once_and_does_not_end_a_training(module, monkeypatch, tmp_path, caplog):
    monkeypatch.setenv(metrics_log.ASKED, "broken")
    log = MetricsLog(tmp_path, 0)
    monkeypatch.setattr(logging.getLogger("jaxsim"), "propagate", True)
    with caplog.at_level(logging.WARNING):
        for step in (1, 2, 3):
            log.write(step, {"loss": 1.0})
    assert module.seen == [1]
    # Once, whatever number of handlers hears it.
    assert {record.getMessage() for record in caplog.records} == {
        "run: the tracker broken failed at step 1 (OSError: no network) and gets no more; metrics.jsonl goes on"
    }
    assert len((tmp_path / "metrics.jsonl").read_text().splitlines()) == 3


@pytest.mark.parametrize(("name", "message"), [("wnadb", "no tracker; known ones are absent"), ("absent", "not start")])
def test_one_that_is_not_there_stops_the_run_before_it_begins(module, monkeypatch, tmp_path, name, message):
    monkeypatch.setenv(metrics_log.ASKED, name)
    with pytest.raises(ValueError, match=message):
        MetricsLog(tmp_path, 0)


def test_weights_and_biases_and_mlflow_are_called_as_they_ask(monkeypatch, tmp_path):
    told = []
    run = SimpleNamespace(log=lambda values, step: told.append((values, step)))
    monkeypatch.setitem(sys.modules, "wandb", SimpleNamespace(init=lambda **how: told.append(how) or run))
    metrics_log.wandb(tmp_path, 0)(3, {"loss": 1.0})
    assert told == [
        {"dir": str(tmp_path), "id": tmp_path.name, "name": tmp_path.name, "resume": "allow"},
        ({"loss": 1.0}, 3),
    ]
    points = []
    client = SimpleNamespace(
        start_run=lambda run_name: None, log_metrics=lambda values, step: points.append((values, step))
    )
    monkeypatch.setitem(sys.modules, "mlflow", client)
    metrics_log.mlflow(tmp_path, 0)(3, {"ap@0.7": 1.0})
    assert points == [({"ap_at_0.7": 1.0}, 3)]


def test_a_client_that_is_missing_is_named(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "wandb", None)
    with pytest.raises(ModuleNotFoundError, match="pip install wandb"):
        metrics_log.wandb(tmp_path, 0)
