"""Files of records, each made whole by one function wherever it runs: here, in worker processes, or by Beam.

A file counts as made once a note of it lies in `done/`, which is written last: so a killed command goes on with the
file that it was making, and several machines can work on one set.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import threading
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from functools import lru_cache
from itertools import islice
from multiprocessing import connection
from pathlib import Path
from typing import Any

import cv2
import jax

from jaxsim.config import DataConfig, PrepareConfig
from jaxsim.data import Dataset, open_dataset
from jaxsim.data.records import example_of
from jaxsim.data.tfds_builder import Shard, serialized, write_records
from jaxsim.files import replacing
from jaxsim.geometry import LidarSpec
from jaxsim.pairs.prepared import make_record

AHEAD = 4
"""Pairs a worker may be ahead of the one that is written next."""


@dataclass(frozen=True)
class Job:
    """All that a worker has to know to make any pair of a set."""

    data: DataConfig
    prepare: PrepareConfig
    spec: LidarSpec
    """Fitted once: a worker that fitted its own could fit another."""
    scan: bool
    """Whether the frames have one."""


@dataclass(frozen=True)
class Made:
    """A pair as it goes to a file, and what the set's index says of it."""

    record: bytes
    name: str
    scene: str
    window: tuple[int, int]
    labelled: bool


@lru_cache(maxsize=1)
def _dataset(data: DataConfig) -> Dataset:
    return open_dataset(data)


def make(job: Job, position: int) -> Made:
    """The pair at one position. Raises ValueError where the frame lacks what the job asks for."""
    frame = _dataset(job.data)[position]
    record = make_record(frame, position, job.spec, prepare=job.prepare, scan=job.scan)
    rows, columns = record.pair.target.shape
    labelled = frame.camera.semantic is not None
    return Made(serialized(example_of(record)), record.name, record.scene, (rows, columns), labelled)


def note_of(shard: Shard, folder: Path) -> Path:
    """What says that a file is made."""
    return folder / "done" / f"{shard.file(folder).name}.json"


def read_note(shard: Shard, folder: Path) -> dict[str, Any] | None:
    """The note of a file that is there whole; None where it has yet to be made."""
    note, file = note_of(shard, folder), shard.file(folder)
    if not (note.is_file() and file.is_file()):
        return None
    about = json.loads(note.read_text())
    return about if about["bytes"] == file.stat().st_size else None


def write_shard(shard: Shard, folder: Path, made: Iterable[Made]) -> None:
    """Writes the file of these pairs, then its note."""
    about: dict[str, list[Any]] = {"names": [], "scenes": [], "windows": [], "labelled": []}

    def records() -> Iterator[bytes]:
        for pair in made:
            values = (pair.name, pair.scene, pair.window, pair.labelled)
            for column, value in zip(about.values(), values, strict=True):
                column.append(value)
            yield pair.record

    write_records(shard.file(folder), records())
    with replacing(note_of(shard, folder)) as part:
        part.write_text(json.dumps({"bytes": shard.file(folder).stat().st_size, **about}))


def make_shard(shard: Shard, folder: Path, job: Job) -> None:
    """Makes one file alone, as a worker of another machine does."""
    write_shard(shard, folder, (make(job, position) for position in shard.positions))


def make_all(job: Job, positions: Sequence[int], workers: int) -> Iterator[Made]:
    """The pairs at these positions, in order, made by so many processes: with one, by this one.

    Raises ValueError where a frame lacks what the job asks for, or a worker was killed.
    """
    if workers == 1:
        yield from (make(job, position) for position in positions)
        return
    cache = jax.config.jax_compilation_cache_dir  # type: ignore
    spawn = multiprocessing.get_context("spawn")  # a fork would copy JAX's locks without its threads
    with ProcessPoolExecutor(workers, spawn, initializer=_begin, initargs=(job, cache)) as pool:
        todo = iter(positions)
        waiting = deque(pool.submit(_make, position) for position in islice(todo, AHEAD * workers))
        try:
            while waiting:
                yield waiting.popleft().result()
                waiting.extend(pool.submit(_make, position) for position in islice(todo, 1))
        except BrokenProcessPool as error:
            raise ValueError(
                f"prepare: one of {workers} worker processes was killed, perhaps for want of memory; start fewer "
                "(--workers), the same command goes on"
            ) from error
        finally:
            pool.shutdown(cancel_futures=True)


_job: Job | None = None


def _begin(job: Job, cache: str | None) -> None:
    global _job
    _job = job
    jax.config.update("jax_platforms", "cpu")  # a GPU would be taken whole by the first of them
    jax.config.update("jax_compilation_cache_dir", cache)
    cv2.setNumThreads(1)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """A killed command cannot tell its workers, and they would wait for ever."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        connection.wait([parent.sentinel])
        os._exit(1)


def _make(position: int) -> Made:
    assert _job is not None
    return make(_job, position)
