"""Trackers of a training's metrics: asked for, found, and harmless where they fail."""

from __future__ import annotations

import logging
import sys
from contextlib import nullcontext
from importlib.machinery import ModuleSpec
from importlib.metadata import EntryPoint
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest

from jaxsim.runs import metrics_log
from jaxsim.runs.metrics_log import MetricsLog, Tracker


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


@pytest.mark.parametrize("error", [None, KeyboardInterrupt, ValueError])
def test_runs_are_ended_with_the_training_and_one_that_does_not_end_hides_no_error(
    module, monkeypatch, tmp_path, caplog, error
):
    ends = []

    def ended(failed):
        ends.append(failed)
        raise OSError("no network")

    monkeypatch.setattr(module, "good", lambda folder, start: Tracker(module.seen.append, ended))
    monkeypatch.setenv(metrics_log.ASKED, "good,broken")
    monkeypatch.setattr(logging.getLogger("jaxsim"), "propagate", True)
    with pytest.raises(error) if error else nullcontext(), MetricsLog(tmp_path, 0):
        if error:
            raise error
    assert ends == [error is not None]
    assert "run: the tracker good did not end its run (OSError: no network)" in caplog.text


def test_tensorboards_file_is_closed(monkeypatch, tmp_path):
    closed = []
    board = ModuleType("tensorboardX")
    board.__spec__ = ModuleSpec("tensorboardX", None)
    board.SummaryWriter = lambda *about, **more: SimpleNamespace(close=lambda: closed.append(1))
    monkeypatch.setitem(sys.modules, "tensorboardX", board)
    with MetricsLog(tmp_path, 0):
        assert not closed
    assert closed


@pytest.mark.parametrize(("name", "message"), [("wnadb", "no tracker; known ones are absent"), ("absent", "not start")])
def test_one_that_is_not_there_stops_the_run_before_it_begins(module, monkeypatch, tmp_path, name, message):
    monkeypatch.setenv(metrics_log.ASKED, name)
    with pytest.raises(ValueError, match=message):
        MetricsLog(tmp_path, 0)


def test_weights_and_biases_has_a_run_of_its_own_for_each_folder_also_of_one_name(monkeypatch, tmp_path):
    told = []
    ends = []
    run = SimpleNamespace(
        log=lambda values, step: told.append((values, step)), finish=lambda exit_code: ends.append(exit_code)
    )
    monkeypatch.setitem(sys.modules, "wandb", SimpleNamespace(init=lambda **how: told.append(how) or run))
    first, other = tmp_path / "one" / "demo", tmp_path / "two" / "demo"
    metrics_log.wandb(first, 0)(3, {"loss": 1.0})
    assert told[1:] == [({"loss": 1.0}, 3)]
    assert told[0] == {"dir": str(first), "id": told[0]["id"], "name": "demo", "resume": "allow"}
    metrics_log.wandb(first, 3)
    metrics_log.wandb(other, 0).close(failed=True)
    assert ends == [1]
    assert told[2]["id"] == told[0]["id"] != told[3]["id"]


def test_mlflow_goes_on_with_the_run_of_a_folder(monkeypatch, tmp_path):
    asked, points, ends = [], [], []
    begun = SimpleNamespace(info=SimpleNamespace(run_id="0a1b"))
    client = SimpleNamespace(
        start_run=lambda **how: asked.append(how) or begun,
        log_metrics=lambda values, step: points.append((values, step)),
        end_run=ends.append,
    )
    monkeypatch.setitem(sys.modules, "mlflow", client)
    metrics_log.mlflow(tmp_path, 0)(3, {"ap@0.7": 1.0})
    assert points == [({"ap_at_0.7": 1.0}, 3)]
    for failed in (True, False):
        metrics_log.mlflow(tmp_path, 3).close(failed=failed)
    assert ends == ["FAILED", "FINISHED"]
    assert asked == [{"run_name": tmp_path.name}, *[{"run_id": "0a1b"}] * 2]


def test_a_client_that_is_missing_is_named(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "wandb", None)
    with pytest.raises(ModuleNotFoundError, match="pip install wandb"):
        metrics_log.wandb(tmp_path, 0)
