"""A set's files made by Apache Beam, on the workers of whichever runner its options name.

The unit of work is a file: each is written by the worker that makes its pairs, by the function that the plain command
uses, so the bytes are the same. Workers need jaxsim, the data set's root and the output folder under the same paths.
"""

from __future__ import annotations

import logging
import re
import threading
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import jax
from tqdm import tqdm

from jaxsim.data.tfds_builder import Shard
from jaxsim.pairs.shards import Job, make_shard, note_of

POLL_S = 1.0


def make_by_beam(job: Job, shards: Sequence[Shard], folder: Path, *, options: Sequence[str], bar: tqdm[Any]) -> None:
    """Makes these files; `options` are Beam's, such as `runner=FlinkRunner`. Shows the finished ones' pairs on `bar`.

    Raises ModuleNotFoundError where Beam is not installed, ValueError where a frame lacks what the job asks for.
    """
    try:
        import apache_beam as beam
        from apache_beam.options.pipeline_options import PipelineOptions
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            f"prepare: --beam needs Apache Beam ({error}); in an environment of its own, for it asks for older "
            "versions of some packages: pip install -e '.[beam]' -c constraints-beam.txt"
        ) from error
    # Beam tells a hundred lines of how it starts; its warnings are enough, unless the options say more.
    logging.getLogger("apache_beam").setLevel(logging.WARNING)
    flags = ["--default_sdk_harness_log_level=WARNING", *(f"--{option.lstrip('-')}" for option in options)]
    ended = threading.Event()
    watch = threading.Thread(target=_show, args=(shards, folder, bar, ended))
    watch.start()
    try:
        with beam.Pipeline(options=PipelineOptions(flags)) as pipeline:
            files = pipeline | "files" >> beam.Create(list(shards))
            spread = files | "spread" >> beam.Reshuffle()
            _ = spread | "make" >> beam.Map(partial(_make_on_worker, folder=str(folder), job=job))
    except RuntimeError as error:  # a worker's own error comes as text, in a traceback of many
        reasons = re.findall(r"^(?:\w+\.)*ValueError: (.*?)(?: \[while running .*)?$", str(error), re.MULTILINE)
        if not reasons:
            raise
        raise ValueError(f"{reasons[-1]} (the same command goes on with the files that are made)") from error
    finally:
        ended.set()
        watch.join()


def _make_on_worker(shard: Shard, folder: str, job: Job) -> None:
    jax.config.update("jax_platforms", "cpu")
    make_shard(shard, Path(folder), job)


def _show(shards: Sequence[Shard], folder: Path, bar: tqdm[Any], ended: threading.Event) -> None:
    waiting = list(shards)
    last = False
    while waiting and not last:
        last = ended.wait(POLL_S)
        for shard in [shard for shard in waiting if note_of(shard, folder).is_file()]:
            waiting.remove(shard)
            bar.update(len(shard.positions))
