"""Work on a cluster of Dask: done whole, whatever becomes of an item."""

import logging
import sys
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import pytest

from jaxsim import cluster
from jaxsim.cluster import Unlike, check_scheduler, spread, with_absolute_paths
from jaxsim.config import DataConfig
from tests.dask_processes import processes


@dataclass(frozen=True)
class Squares:
    """Squares of numbers; even ones take a while, some cannot be."""

    refused: tuple[int, ...] = ()

    def open(self):
        return self.square

    def square(self, number):
        time.sleep(0.05 * (number % 2 == 0))
        if number in self.refused:
            raise ValueError(f"{number} is refused")
        return number**2


def test_every_item_is_done_once_by_more_than_one_worker(scheduler):
    done = list(spread(scheduler, Squares(), range(12), by="test"))
    assert sorted(one.result for one in done) == [k**2 for k in range(12)]
    assert all(one.result == one.item**2 for one in done)
    assert len({one.worker for one in done}) == 2


def test_what_cannot_be_done_is_told_when_all_else_is_done(scheduler):
    done = []
    with pytest.raises(ValueError, match=r"test: 5 of 12 pieces of work failed.*is refused.*\(and 2 more\)"):
        done.extend(one.item for one in spread(scheduler, Squares((1, 2, 3, 7, 8)), range(12), by="test"))
    assert sorted(done) == [0, 4, 5, 6, 9, 10, 11]


@dataclass(frozen=True)
class Listing:
    """Tells for each item what a folder held when the job was opened."""

    folder: Path

    def open(self):
        return partial(self.told, names=sorted(path.name for path in self.folder.iterdir()))

    def told(self, item, names):
        return names


def test_an_equal_command_that_follows_sees_what_has_come_meanwhile(scheduler, tmp_path):
    for names in (["b"], ["a", "b"]):
        (tmp_path / names[0]).touch()
        told = [one.result for one in spread(scheduler, Listing(tmp_path), range(4), by="test")]
        assert told == [names] * 4


def test_an_error_that_nobody_expects_keeps_its_kind(scheduler):
    with pytest.raises(TypeError):
        list(spread(scheduler, Squares(), ["a"], by="test"))


def test_a_worker_with_other_code_ends_the_command(scheduler, monkeypatch):
    monkeypatch.setattr(cluster, "build_name", lambda: "jaxsim of yesterday")
    with pytest.raises(Unlike, match=r"the worker tcp://.* this command has jaxsim of yesterday; install the same"):
        list(spread(scheduler, Squares(), range(4), by="test"))


def test_no_scheduler_and_no_dask_are_said(monkeypatch):
    monkeypatch.setattr(cluster, "ANSWER_S", 0.2)
    pytest.importorskip("distributed")
    with pytest.raises(ValueError, match=r"test: no scheduler answers at tcp://127.0.0.1:9; start one"):
        list(spread("tcp://127.0.0.1:9", Squares(), [1], by="test"))
    with pytest.raises(ValueError, match=r"test: no scheduler answers at tcp://127.0.0.1:9; start one"):
        check_scheduler("tcp://127.0.0.1:9", by="test")
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ModuleNotFoundError, match=r"test: --cluster needs Dask .*jaxsim-lidar\[dask\]"):
        list(spread("tcp://127.0.0.1:9", Squares(), [1], by="test"))


def test_dasks_tracebacks_of_a_lost_scheduler_are_shown_to_those_who_ask(scheduler, monkeypatch):
    loggers = [logging.getLogger(name) for name in ("distributed.client", "distributed.comm.tcp")]
    before = [logger.getEffectiveLevel() for logger in loggers]
    results = spread(scheduler, Squares(), range(2), by="test")
    next(results)
    assert [logger.getEffectiveLevel() for logger in loggers] == [logging.CRITICAL] * 2
    list(results)
    assert [logger.getEffectiveLevel() for logger in loggers] == before
    monkeypatch.setenv("JAXSIM_TRACEBACK", "1")
    for _ in spread(scheduler, Squares(), range(2), by="test"):
        assert [logger.getEffectiveLevel() for logger in loggers] == before


def test_whoever_stops_taking_results_leaves_nothing_at_work(scheduler):
    results = spread(scheduler, Squares(), range(0, 2000, 2), by="test")
    next(results)
    begun = time.monotonic()
    results.close()
    assert time.monotonic() - begun < 12  # two workers would have 25 s to do


def test_relative_paths_that_are_there_become_absolute(tmp_path, monkeypatch):
    (tmp_path / "drives").mkdir()
    monkeypatch.chdir(tmp_path)
    config = DataConfig(root=Path("drives"), cache=Path("nowhere"))
    assert with_absolute_paths(config) == DataConfig(root=tmp_path / "drives", cache=Path("nowhere"))
    assert with_absolute_paths((Path("drives"),), tmp_path.parent) == (Path("drives"),)


@dataclass(frozen=True)
class Sleeps:
    """Work that takes a time and no processor."""

    def open(self):
        return time.sleep


@pytest.mark.slow
def test_n_workers_take_an_nth_of_the_time(tmp_path):
    pytest.importorskip("distributed", reason="Dask is not installed: pip install -e '.[dask]'")
    took = {}
    with processes(tmp_path) as started:
        for count in (1, 2, 3):
            started.worker()
            warm: set[str] = set()
            while len(warm) < count:  # a worker's first item waits for its imports
                warm = {one.worker for one in spread(started.address, Sleeps(), [0.3] * 2 * count, by="test")}
            begun = time.monotonic()
            done = list(spread(started.address, Sleeps(), [0.5] * 24, by="test"))
            took[count] = time.monotonic() - begun
            assert len({one.worker for one in done}) == count
    print({count: took[1] / seconds for count, seconds in took.items()})
    assert all(took[1] / took[count] >= 0.9 * count for count in (2, 3)), took
