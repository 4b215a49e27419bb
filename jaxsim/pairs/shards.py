"""Files of records, each made whole by one function wherever it runs: here, in worker processes, on a cluster of Dask,
or by Beam.

A file counts as made once a note of it lies in `done/`, which is written last: so a killed command goes on with the
file that it was making, and several machines can work on one set.
"""

from __future__ import annotations

import json
import logging
import multiprocessing
import os
import re
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import lru_cache, partial
from multiprocessing import connection
from pathlib import Path
from typing import Any
from uuid import uuid4

import cv2
import jax

from jaxsim.cluster import spread, with_absolute_paths
from jaxsim.config import DataConfig, PrepareConfig
from jaxsim.data import Dataset, open_dataset
from jaxsim.data.records import example_of
from jaxsim.data.tfds_builder import Shard, serialized, write_records
from jaxsim.files import read_json, write_text
from jaxsim.geometry import LidarSpec
from jaxsim.interrupts import apart, unheard_by_children, uninterrupted
from jaxsim.pairs.prepared import make_record, pair_stamps
from jaxsim.prefetch import prefetch
from jaxsim.progress import Progress

AHEAD = 4
"""Pairs a worker may be ahead of the one that is written next."""
MOST_SIDE = 100_000
"""No window has as many rows or columns."""
DASK_RUNNER = "apache_beam.runners.dask.dask_runner.DaskRunner"
COLUMNS = {"names": str, "scenes": str, "windows": list, "labelled": bool, "pictured": bool, "sources": str}
"""What a file's note says of its pairs, a list each."""
POLL_S = 1.0
"""Seconds between looks at what Beam's workers have finished."""


@dataclass(frozen=True)
class PairJob:
    """All that a worker has to know to make any pair of a set."""

    data: DataConfig
    prepare: PrepareConfig
    spec: LidarSpec
    """Fitted once: a worker that fitted its own could fit another."""
    scan: bool
    """Whether the frames have one."""
    command: str = field(default_factory=lambda: uuid4().hex)
    """Tells this command from others: what one opened is not the next one's, though its worker may live on."""


@dataclass(frozen=True)
class MadePair:
    """A pair as it goes to a file, and what the set's index says of it."""

    record: bytes
    name: str
    scene: str
    window: tuple[int, int]
    labelled: bool
    pictured: bool
    source: str = ""
    """The stamp of what it was made of."""


@lru_cache(maxsize=1)
def _dataset(job: PairJob) -> Dataset:
    """The job's data set, opened once a command and process."""
    return open_dataset(job.data)


def make(job: PairJob, position: int) -> MadePair:
    """The pair at one position. Raises ValueError where the frame lacks what the job asks for."""
    dataset = _dataset(job)
    # Before it is read: a change meanwhile is seen the next time.
    [source] = pair_stamps(dataset, [position], job.spec)
    frame = dataset[position]
    record = make_record(frame, position, job.spec, prepare=job.prepare, scan=job.scan)
    rows, columns = record.pair.target.shape
    return MadePair(
        serialized(example_of(record)),
        name=record.name,
        scene=record.scene,
        window=(rows, columns),
        labelled=frame.camera.semantic is not None,
        pictured=record.has_image,
        source=source,
    )


def _note_of(shard: Shard, folder: Path) -> Path:
    """What says that a file is made."""
    return folder / "done" / f"{shard.file(folder).name}.json"


def read_note(shard: Shard, folder: Path) -> dict[str, Any] | None:
    """The note of a file that is there whole; None where it has yet to be made."""
    note = _note_of(shard, folder)
    file = shard.file(folder)
    if not (note.is_file() and file.is_file()):
        return None
    about = read_json(note, by="prepare")
    if not _is_note(about, len(shard.positions)):
        raise ValueError(
            f"prepare: {note} does not tell of the {len(shard.positions)} pairs of its file; delete it, and the file "
            "is made anew"
        )
    return about if about["bytes"] == file.stat().st_size else None


def _is_note(about: Any, count: int) -> bool:
    """Whether a JSON value is what `write_shard` notes of so many pairs."""
    if not isinstance(about, dict) or type(about.get("bytes")) is not int:
        return False
    for name, kind in COLUMNS.items():
        column = about.get(name)
        if not isinstance(column, list) or len(column) != count or not all(isinstance(one, kind) for one in column):
            return False
    sizes = [size for window in about["windows"] for size in window]
    return all(type(size) is int and 0 < size < MOST_SIDE for size in sizes)


def write_shard(shard: Shard, folder: Path, made: Iterable[MadePair], *, bar: Progress | None = None) -> None:
    """Writes the file of these pairs, then its note; tells `bar` of each pair."""
    about: dict[str, list[Any]] = {name: [] for name in COLUMNS}

    def records() -> Iterator[bytes]:
        for pair in made:
            values = (pair.name, pair.scene, pair.window, pair.labelled, pair.pictured, pair.source)
            for column, value in zip(about.values(), values, strict=True):
                column.append(value)
            yield pair.record
            if bar is not None:
                bar.update()

    write_records(shard.file(folder), records())
    write_text(_note_of(shard, folder), json.dumps({"bytes": shard.file(folder).stat().st_size, **about}))


def make_all(job: PairJob, positions: Sequence[int], workers: int) -> Iterator[MadePair]:
    """The pairs at these positions, in order, made by so many processes: with one, by this one.

    Raises ValueError where a frame lacks what the job asks for, or a worker was killed.
    """
    if workers == 1:
        yield from (make(job, position) for position in positions)
        return
    cache = jax.config.jax_compilation_cache_dir  # type: ignore[attr-defined]  # jax declares no types of its settings
    others = multiprocessing.active_children()
    spawn = multiprocessing.get_context("spawn")  # a fork would copy JAX's locks without its threads
    with ProcessPoolExecutor(workers, spawn, initializer=_begin, initargs=(cache,)) as pool:
        try:
            # Whole or not at all: a worker whose start is broken off complains of half of what it was sent.
            with uninterrupted(), unheard_by_children():
                made = prefetch(pool, partial(make, job), positions, ahead=AHEAD * workers)
            yield from made
        except BrokenProcessPool as error:
            raise ValueError(
                f"prepare: one of {workers} worker processes was killed, perhaps for want of memory; start fewer "
                "(--workers), the same command goes on"
            ) from error
        except BaseException:
            # A worker may be in the middle of a frame that takes a minute, and nobody will take what it makes.
            for worker in multiprocessing.active_children():
                if worker not in others:
                    worker.kill()
            raise
        finally:
            pool.shutdown(cancel_futures=True)


def _begin(cache: str | None) -> None:
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


@dataclass(frozen=True)
class Shards:
    """What a worker of a cluster does: a file at a time."""

    job: PairJob
    folder: Path

    def open(self) -> Callable[[Shard], int]:
        """Makes a file, and gives the number of its pairs."""
        return partial(_make_on_worker, folder=self.folder, job=self.job)


def make_on_cluster(job: PairJob, shards: Sequence[Shard], folder: Path, *, address: str, bar: Progress) -> None:
    """Makes these files on the cluster of Dask whose scheduler is at `address`, and shows them on `bar`.

    Workers need jaxsim, the data set's root and the output folder under the same paths. Where a frame cannot be
    prepared the other files are made nevertheless, and then ValueError names it.
    """
    work = with_absolute_paths(Shards(job, folder.absolute()))
    workers = set()
    for done in spread(address, work, shards, by="prepare"):
        workers.add(done.worker)
        bar.set_postfix(workers=len(workers), refresh=False)
        bar.update(done.result)


def make_by_beam(job: PairJob, shards: Sequence[Shard], folder: Path, *, options: Sequence[str], bar: Progress) -> None:
    """Makes these files by Apache Beam; `options` are Beam's, such as `runner=FlinkRunner`. Shows the finished ones'
    pairs on `bar`.

    The unit of work is a file: the worker that makes its pairs writes it, by the function that the plain command uses,
    so the bytes are the same. Workers need jaxsim, the data set's root and the output folder under the same paths.
    `runner=DaskRunner` stands for Beam's long name, and spreads the files over all workers.
    Raises ModuleNotFoundError where Beam is not installed, ValueError where a frame lacks what the job asks for.
    """
    try:
        import apache_beam  # noqa: F401 - whether it is there
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            f"prepare: --beam needs Apache Beam ({error}); in an environment of its own, for it asks for older "
            "versions of some packages: pip install 'jaxsim-lidar[beam]'"
        ) from error
    # Beam tells a hundred lines of how it starts, and a worker's error three times, in tracebacks, before it is raised.
    seen = logging.WARNING if os.environ.get("JAXSIM_TRACEBACK") else logging.CRITICAL
    logging.getLogger("apache_beam").setLevel(seen)
    spelled = _spelled_out(options, len(shards))
    flags = ["--default_sdk_harness_log_level=WARNING", *(f"--{option}" for option in spelled)]
    try:
        with _shown(shards, folder, bar=bar):
            apart(partial(_pipe, shards, folder, job=job, flags=flags), by="beam")
    except ValueError as error:  # of Dask's runner: the worker's own
        raise ValueError(f"{error} (the same command goes on with the files that are made)") from error
    except RuntimeError as error:  # of others a worker's error comes as text, in a traceback of many
        our_error = r"^(?:\w+\.)*(?:ValueError|OSError): (.*?)(?: \[while running .*)?$"
        reasons = re.findall(our_error, str(error), re.MULTILINE)
        if not reasons:
            raise
        raise ValueError(f"{reasons[-1]} (the same command goes on with the files that are made)") from error


def _pipe(shards: Sequence[Shard], folder: Path, *, job: PairJob, flags: Sequence[str]) -> None:
    """Runs Beam's pipeline to its end."""
    import apache_beam as beam
    from apache_beam.options.pipeline_options import PipelineOptions

    with beam.Pipeline(options=PipelineOptions(list(flags))) as pipeline:
        files = pipeline | "files" >> beam.Create(list(shards))
        spread = files | "spread" >> beam.Reshuffle()
        _ = spread | "make" >> beam.Map(partial(_make_on_worker, folder=folder, job=job))


def _spelled_out(options: Sequence[str], files: int) -> list[str]:
    """Beam's options, with its own name of the runner on Dask, and the number of files for it: unless it is told, that
    runner keeps up to 128 elements together, and one worker would make them all."""
    options = [option.lstrip("-") for option in options]
    if not {"runner=DaskRunner", f"runner={DASK_RUNNER}"} & {*options}:
        return options
    options = [f"runner={DASK_RUNNER}" if option == "runner=DaskRunner" else option for option in options]
    given = any(option.startswith("dask_npartitions") for option in options)
    return options if given else [*options, f"dask_npartitions={max(files, 1)}"]


def _make_on_worker(shard: Shard, folder: Path, job: PairJob) -> int:
    jax.config.update("jax_platforms", "cpu")
    write_shard(shard, folder, (make(job, position) for position in shard.positions))
    return len(shard.positions)


@contextmanager
def _shown(shards: Sequence[Shard], folder: Path, *, bar: Progress) -> Iterator[None]:
    """Shows on `bar` what appears in the folder while the block runs."""
    ended = threading.Event()

    def show() -> None:
        waiting = list(shards)
        last = False
        while waiting and not last:
            last = ended.wait(POLL_S)
            for shard in [shard for shard in waiting if _note_of(shard, folder).is_file()]:
                waiting.remove(shard)
                bar.update(len(shard.positions))

    watch = threading.Thread(target=show, daemon=True)
    try:
        watch.start()
        yield
    finally:
        ended.set()
        if watch.is_alive():
            watch.join()
