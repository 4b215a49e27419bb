"""Work on a cluster of Dask: one function on many items, each on whichever worker is free.

A job tells a worker how to come by the function: `open()` runs once a command in each worker process. What travels is
small, a job's settings and an item; what is made lies on a disk that all share, under the same paths. Nothing is lost
with a worker: Dask gives its items to another, and since files appear whole or not at all, two that make the same one
do no harm.
"""

from __future__ import annotations

import logging
import os
import pickle
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError, as_completed
from contextlib import contextmanager
from dataclasses import fields, is_dataclass, replace
from functools import lru_cache
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path
from typing import Any, Generic, NamedTuple, Protocol, TypeVar, runtime_checkable
from uuid import uuid4

from jaxsim.progress import check_all_done

_log = logging.getLogger(__name__)

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")
Item_in = TypeVar("Item_in", contravariant=True)
Result_out = TypeVar("Result_out", covariant=True)

ANSWER_S = 20
"""Seconds in which a scheduler has to answer."""
_opening = threading.Lock()


@runtime_checkable
class Job(Protocol[Item_in, Result_out]):
    """What is to be done with items, as values that can be pickled."""

    def open(self) -> Callable[[Item_in], Result_out]:
        """The function of an item, on the worker that calls this."""
        ...


class Done(NamedTuple, Generic[_Item, _Result]):
    """An item, what came of it, and which worker did it."""

    item: _Item
    result: _Result
    worker: str


class Unlike(ValueError):
    """A worker would not make what this command makes."""


def spread(
    address: str, job: Job[_Item, _Result], items: Sequence[_Item], *, by: str
) -> Iterator[Done[_Item, _Result]]:
    """Does the job for all items on the cluster of the scheduler at `address` (`tcp://HOST:8786`), and gives each as
    it is done.

    Where an item cannot be done the others still are. Then raises ValueError that tells of the first failures; and at
    once where no scheduler answers, it is lost, or a worker has other code. Raises ModuleNotFoundError where Dask is
    not installed. `by` begins the messages.
    """
    failures: list[str] = []
    with _connected(address, by) as client:
        if not client.nthreads():
            _log.info(f"{by}: no worker has joined {address} yet; start some: dask worker {address} --nthreads 1")
        with client.get_executor(pure=False) as pool:
            # The number makes the job this command's own: files may have changed since an equal one was opened.
            task = pickle.dumps((job, _cache_folder(), uuid4().hex)), build_name()
            todo = {pool.submit(_do, *task, pickle.dumps(item)): item for item in items}
            try:
                for future in as_completed(todo):
                    try:
                        result, worker = future.result()
                    except Unlike:
                        raise
                    except CancelledError as error:
                        raise ValueError(
                            f"{by}: the scheduler at {address} is gone; start it and its workers again, and the same "
                            "command goes on"
                        ) from error
                    except (ValueError, OSError) as error:
                        failures.append(str(error))
                    except Exception as error:
                        if type(error).__name__ != "KilledWorker":
                            raise
                        failures.append(f"{todo[future]}: four workers died of it, perhaps for want of memory")
                    else:
                        yield Done(todo[future], result, worker)
            finally:
                pool.shutdown(wait=False)
    check_all_done(failures, len(items), by=by)


def check_scheduler(address: str, *, by: str) -> None:
    """Raises ValueError where no scheduler answers at `address`, before a folder is begun; else as `spread`."""
    with _connected(address, by):
        pass


@contextmanager
def _connected(address: str, by: str) -> Iterator[Any]:
    """A client of the scheduler."""
    try:
        from distributed import Client
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            f"{by}: --cluster needs Dask ({error}): pip install 'jaxsim-lidar[dask]'; here, and where scheduler and "
            "workers run"
        ) from error
    with _quiet("distributed.client", "distributed.comm"):
        try:
            client = Client(address, timeout=ANSWER_S, set_as_default=False)
        except (OSError, ValueError, TypeError) as error:
            raise ValueError(
                f"{by}: no scheduler answers at {address}; start one (dask scheduler) and workers (dask worker "
                "tcp://HOST:8786 --nthreads 1), and give its address: --cluster tcp://HOST:8786"
            ) from error
        try:
            yield client
        finally:
            client.close()


@contextmanager
def _quiet(*names: str) -> Iterator[None]:
    """In the block these loggers say nothing: of a lost scheduler Dask's tell in tracebacks what a line says."""
    loggers = [] if os.environ.get("JAXSIM_TRACEBACK") else [logging.getLogger(name) for name in names]
    levels = [logger.level for logger in loggers]
    try:
        for logger in loggers:
            logger.setLevel(logging.CRITICAL)
        yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)


def build_name() -> str:
    """Names the code that runs here: a hash of jaxsim's, with the versions of what its numbers depend on."""
    root = Path(__file__).parent
    code = sha256(b"".join(path.read_bytes() for path in sorted(root.rglob("*.py")))).hexdigest()
    return f"jaxsim {code[:16]}, " + ", ".join(f"{name} {version(name)}" for name in ("jax", "jaxlib", "numpy"))


_own_build = lru_cache(build_name)


def _cache_folder() -> str | None:
    import jax  # the scheduler imports this module too, and needs no JAX

    return jax.config.jax_compilation_cache_dir  # type: ignore[attr-defined]  # jax declares no types of its settings


@lru_cache(maxsize=1)
def _opened(job: bytes) -> Callable[[Any], Any]:
    import jax

    wanted, cache, _ = pickle.loads(job)
    if cache:
        jax.config.update("jax_compilation_cache_dir", cache)
    return wanted.open()


def _do(job: bytes, build: str, item: bytes) -> tuple[Any, str]:
    """On a worker: the job for one item, and the worker's address."""
    from distributed import get_worker

    here = get_worker().address
    if build != _own_build():
        raise Unlike(
            f"cluster: the worker {here} has {_own_build()}, this command has {build}; install the same for both, "
            "and start the worker again"
        )
    with _opening:  # threads of one worker share what was opened
        function = _opened(job)
    return function(pickle.loads(item)), here


def with_absolute_paths(settings: Any, base: Path | None = None) -> Any:
    """Settings (a dataclass) with every relative path, at any depth, as one below `base` (by default the current
    folder) if something is there: a worker's current folder is another."""
    base = base or Path.cwd()
    if isinstance(settings, Path):
        return base / settings if (base / settings).exists() else settings
    if type(settings) is tuple:
        return tuple(with_absolute_paths(value, base) for value in settings)
    if is_dataclass(settings) and not isinstance(settings, type):
        values = {field.name: getattr(settings, field.name) for field in fields(settings) if field.init}
        return replace(settings, **{name: with_absolute_paths(value, base) for name, value in values.items()})
    return settings
