"""A prepared set: planned, its files made, described, and put in place in one step."""

from __future__ import annotations

import json
import logging
import os
import shutil
from collections.abc import Sequence
from importlib.metadata import version
from itertools import islice
from pathlib import Path
from typing import Any

from jaxsim.cluster import check_scheduler
from jaxsim.config import DataConfig, PrepareConfig
from jaxsim.data import Dataset, open_dataset, select
from jaxsim.data.records import pair_settings
from jaxsim.data.tfds_builder import MAKING, NAME, VERSION, About, JaxsimPairs, Shard, SplitPairs, shards_of
from jaxsim.files import claim, parse_json, parse_settings, tidy, working_in
from jaxsim.pairs.prepared import pair_stamps, pairs_fingerprint
from jaxsim.pairs.shards import PairJob, make_all, make_by_beam, make_on_cluster, read_note, write_shard
from jaxsim.prepare import check_frame, check_networks
from jaxsim.progress import Progress

_log = logging.getLogger(__name__)


def make_set(
    out: Path,
    data: DataConfig,
    prepare: PrepareConfig,
    *,
    train: str = "",
    evaluation: str = "",
    size: int = 64,
    workers: int = 0,
    beam: Sequence[str] | None = None,
    cluster: str | None = None,
) -> Path:
    """Makes the pairs of a data set's frames, and gives the folder that they lie in, below `out`.

    `train` and `evaluation` choose frames as `select` does; none named: the data set's own parts of these names, or
    all of it for training. `size` pairs go to a file; `workers` processes make them (0: one a core), or Beam with the
    options `beam`, or the cluster of Dask whose scheduler has the address `cluster`. What is there is not made again: a
    killed command goes on.

    Raises ValueError for frames that lack something, of the first ones before anything is written, where `out` holds a
    set of other settings, and where its name has bytes that are no UTF-8.
    """
    if size < 1 or workers < 0:
        raise ValueError(
            f"prepare: {size} pairs a file and {workers} workers; a file holds one or more, 0 is one a core"
        )
    if beam is not None and cluster is not None:
        raise ValueError("prepare: --beam and --cluster are two ways to the same files; give one")
    str(out).encode()  # ArrayRecord opens no others; told before anything is made
    dataset = open_dataset(data)
    splits = _splits(dataset, data.kind, train=train, evaluation=evaluation)
    folder = Path(out) / NAME / data.kind / VERSION
    finished = folder / "dataset_info.json"
    firsts = [] if finished.is_file() else [dataset[positions[0]] for positions in splits.values()]
    for frame in firsts:
        check_frame(frame, prepare)
    if firsts and cluster is not None:
        check_scheduler(cluster, by="prepare")
    with working_in(out):
        if finished.is_file():
            _check_finished(folder, data, prepare, splits=splits)
            _check_sources(folder, dataset)
            _tidy(folder)
        else:
            job = PairJob(data, prepare, dataset.spec, scan=firsts[0].cloud is not None)
            _make(folder, dataset, job, splits=splits, size=size, workers=workers, beam=beam, cluster=cluster)
    return folder


def _make(
    folder: Path,
    dataset: Dataset,
    job: PairJob,
    *,
    splits: dict[str, list[int]],
    size: int,
    workers: int,
    beam: Sequence[str] | None,
    cluster: str | None,
) -> None:
    """Makes what is missing of a set, and puts it in place."""
    if job.scan:
        check_networks(job.prepare)
    making = folder.with_name(folder.name + MAKING)
    _claim_plan(making, job, splits, size=size)

    # Files: those that an earlier command made stay as they are, unless what they were made of has changed since.
    shards = shards_of(splits, size)
    notes = {shard: read_note(shard, making) for shard in shards}
    stale = [s for s, note in notes.items() if note and note["sources"] != pair_stamps(dataset, s.positions, job.spec)]
    if stale:
        _log.info(f"prepare: files of {job.data.kind} have changed since, so {len(stale)} files of pairs are made anew")
    missing = [shard for shard, note in notes.items() if note is None or shard in stale]
    positions = [position for shard in missing for position in shard.positions]
    total = sum(map(len, splits.values()))
    with Progress(total=total, initial=total - len(positions), desc=f"preparing {job.data.kind}", unit="pair") as bar:
        if beam is not None:
            make_by_beam(job, missing, making, options=beam, bar=bar)
        elif cluster is not None and missing:
            make_on_cluster(job, missing, making, address=cluster, bar=bar)
        elif missing:
            made = make_all(job, positions, min(workers or os.cpu_count() or 1, len(positions)))
            for shard in missing:
                write_shard(shard, making, islice(made, len(shard.positions)), bar=bar)

    # The set: described, then renamed, so that a folder of that name is whole.
    about = _about(dataset, job, shards, making=making)
    JaxsimPairs(data_dir=folder.parents[2], kind=job.data.kind, shards=shards, about=about).write_metadata(making)
    os.replace(making, folder)
    _tidy(folder)


def _splits(dataset: Dataset, kind: str, *, train: str, evaluation: str) -> dict[str, list[int]]:
    """Positions of `train` and `eval`. Raises ValueError where there are none for training, or both hold one."""
    parts = getattr(dataset, "splits", {})
    if not len(dataset):
        raise ValueError(f"prepare: {kind} has no frames here; look into its root")
    if not (train or parts) and kind == "synthetic":
        raise ValueError(f"prepare: {kind} has {len(dataset)} frames; say which: --train 0-159 --eval 160-199")
    everything = list(range(len(dataset)))
    trained = select(train, dataset) if train else parts.get("training", everything)
    judged = select(evaluation, dataset) if evaluation else [] if train else parts.get("evaluation", [])
    # Parts may be empty: those of frames with labels, where there are none.
    trained = trained or ([] if judged else everything)
    both = sorted(set(trained) & set(judged))
    if both:
        raise ValueError(
            f"prepare: {len(both)} frames are both for training and for evaluation (the first: {both[0]}, "
            f"{dataset.name_of(both[0])}); name each once"
        )
    return {name: chosen for name, chosen in (("train", trained), ("eval", judged)) if chosen}


def _claim_plan(making: Path, job: PairJob, splits: dict[str, list[int]], *, size: int) -> None:
    """Keeps what the files of `making` are made of. Raises ValueError where they are made of something else."""
    plan = {
        **pair_settings(job.data, job.prepare),
        "code": pairs_fingerprint(job.data, job.prepare),
        "splits": splits,
        "pairs-a-file": size,
    }
    claim(
        making / "plan.json",
        _by_flag(plan),
        by="prepare",
        text=json.dumps(plan),
        read=lambda record: _by_flag(parse_json(record)),
        note="code is the fingerprint of jaxsim's own; to go on, give the settings that it was begun with",
    )


def _check_finished(folder: Path, data: DataConfig, prepare: PrepareConfig, *, splits: dict[str, list[int]]) -> None:
    """Raises ValueError where a finished set is not of these settings and frames."""

    def read(record: bytes) -> dict[str, Any]:
        about = parse_settings(About, parse_json(record))
        return about.settings | {name: list(split.positions) for name, split in about.splits.items()}

    claim(folder / "metadata.json", {**pair_settings(data, prepare), **splits}, by="prepare", read=read)


def _check_sources(folder: Path, dataset: Dataset) -> None:
    """Raises ValueError where a finished set is of files that have changed since. One that says nothing of them is
    taken as it is."""
    about = parse_settings(About, parse_json((folder / "metadata.json").read_bytes()))
    for split in about.splits.values():
        if not split.sources:
            continue
        stamps = pair_stamps(dataset, split.positions)
        both = zip(split.names, split.sources, stamps, strict=True)
        if changed := [name for name, was, now in both if was != now]:
            raise ValueError(
                f"prepare: {folder} holds pairs of {len(changed)} frames whose files have changed since (the first: "
                f"{changed[0]}; a scan, an image, labels, the calibration, or the scan that tells the beam table); "
                "delete the folder, and the same command makes them anew, or give another --out"
            )


def _by_flag(plan: dict[str, Any]) -> dict[str, Any]:
    """A plan with its splits by the names of their flags."""
    return {name: value for name, value in plan.items() if name != "splits"} | plan["splits"]


def _about(dataset: Dataset, job: PairJob, shards: Sequence[Shard], *, making: Path) -> About:
    notes = {shard: read_note(shard, making) for shard in shards}
    lost = [shard.file(making).name for shard, note in notes.items() if note is None]
    if lost:
        raise ValueError(
            f"prepare: {', '.join(lost)} are not in {making} though they were made; is it one disk for all?"
        )
    splits: dict[str, SplitPairs] = {}
    for name in dict.fromkeys(shard.split for shard in shards):
        of_split = {shard: note for shard, note in notes.items() if shard.split == name and note}
        splits[name] = SplitPairs(
            positions=tuple(position for shard in of_split for position in shard.positions),
            names=tuple(value for note in of_split.values() for value in note["names"]),
            scenes=tuple(value for note in of_split.values() for value in note["scenes"]),
            windows=tuple((rows, columns) for note in of_split.values() for rows, columns in note["windows"]),
            sources=tuple(value for note in of_split.values() for value in note["sources"]),
            pictured=tuple(value for note in of_split.values() for value in note["pictured"]),
        )
    return About(
        jaxsim=version("jaxsim-lidar"),
        settings=pair_settings(job.data, job.prepare),
        fingerprint=pairs_fingerprint(job.data, job.prepare),
        spec=job.spec,
        length=len(dataset),
        parts={name: tuple(positions) for name, positions in getattr(dataset, "splits", {}).items()},
        splits=splits,
        files={shard.file(making).name: note["bytes"] for shard, note in notes.items() if note},
        measured=job.scan,
        labelled=all(all(note["labelled"]) for note in notes.values() if note),
    )


def _tidy(folder: Path) -> None:
    """Removes what only the making needed, and what a killed command or a killed worker left half written."""
    tidy(folder)
    shutil.rmtree(folder / "done", ignore_errors=True)
    (folder / "plan.json").unlink(missing_ok=True)
