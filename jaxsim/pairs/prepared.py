"""The pairs of a data set: made from its frames once and kept, one file a frame, or read from a prepared set."""

from __future__ import annotations

import json
from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import jax
import numpy as np

from jaxsim.config import DataConfig, PrepareConfig
from jaxsim.data.records import (
    ARRAYS,
    Entry,
    PairRecord,
    PreparedPairs,
    check_example,
    check_pictured,
    kept_of,
    pair_settings,
    record_of,
)
from jaxsim.devices import wait
from jaxsim.files import check_name, kept_files, making, placed, read_arrays, stamp_of, tidy, write_arrays
from jaxsim.frame import Frame, Pair
from jaxsim.geometry import LidarSpec
from jaxsim.prepare import check_networks, edge_map, prepare_frame, prepare_view
from jaxsim.progress import Progress

ARRAY_NAMES = (*ARRAYS, "name", "scene", "position", "has_image")
"""Names of the arrays of a kept pair."""
CODE = ("data", "geometry", "prepare", "native", "frame.py", "products.py", "weights.py", "pairs/prepared.py")
"""Rooms and files of the package that make pairs: those of other code are kept elsewhere."""


def pairs_fingerprint(data: DataConfig, prepare: PrepareConfig) -> str:
    """Kind of data set, and a hash of all that pairs of these settings depend on: settings and code."""
    settings = json.dumps(pair_settings(data, prepare), sort_keys=True)
    return f"{data.kind}-{making(settings, *CODE)}"


def pairs_folder(data: DataConfig, prepare: PrepareConfig) -> Path:
    """The folder where pairs of these settings are kept."""
    return data.cache / pairs_fingerprint(data, prepare)


def pair_stamps(dataset: Any, positions: Sequence[int], spec: LidarSpec | None = None) -> list[str]:
    """Of each frame the stamp of all that its pair is made of: its files, and the sensor's beam table (`spec`; None: as
    the data set fits it now, so that pairs of two tables never mix). Empty where the data set has no files."""
    if not hasattr(dataset, "files_of"):
        return [""] * len(positions)
    table = repr(dataset.spec if spec is None and positions else spec)
    return [stamp_of(dataset, position, table) for position in positions]


def make_record(
    frame: Frame, position: int, spec: LidarSpec, *, prepare: PrepareConfig, scan: bool = True
) -> PairRecord:
    """The pair of a data set's frame, ready to be kept; without `scan`, of its camera alone (`prepare_view`).

    Raises ValueError where the frame lacks what `prepare` asks for.
    """
    pair, grid = (prepare_frame if scan else prepare_view)(frame, spec, prepare)
    return PairRecord(
        name=frame.name,
        scene=frame.scene,
        position=position,
        pair=pair,
        edges=np.asarray(edge_map(pair.painted.semantic, pair.painted.instance)),
        grid=grid,
        camera=frame.camera.camera,
        image_size=frame.camera.rgb.shape[-3:-1],
        has_image=frame.camera.has_image,
    )


def prepared(dataset: Any, positions: Sequence[int], data: DataConfig, *, prepare: PrepareConfig) -> PreparedPairs:
    """The pairs at these positions of a data set. Of frames, those that are not kept yet are made; a prepared set has
    them, or says what it lacks. Raises ValueError where a pair has no image, and `prepare.inputs` needs one.

    A killed run keeps what it has made. Several processes divide the work; where they share no disk, each then
    makes the rest for itself.
    """
    if data.kind == "prepared":
        return dataset.pairs(positions, prepare)
    stamps, folder = pair_stamps(dataset, positions), pairs_folder(data, prepare)
    files = kept_files(folder, dataset, positions, stamps=stamps, by="prepared")
    # Pairs for which labels were asked are those without, too.
    labelled = pairs_folder(data, replace(prepare, inputs=("semantic",)))
    if all((labelled / file.name).is_file() for file in files):
        files = [labelled / file.name for file in files]
    missing = [(i, file) for i, file in zip(positions, files, strict=True) if not file.is_file()]
    if jax.process_count() > 1:
        _make(dataset, missing[jax.process_index() :: jax.process_count()], kind=data.kind, prepare=prepare)
        wait("prepared pairs")
        missing = [(i, file) for i, file in missing if not file.is_file()]
    _make(dataset, missing, kind=data.kind, prepare=prepare)
    return PreparedPairs([_entry(file, prepare) for file in files], lambda i: _read(files[i]))


def pairs_before(
    dataset: Any, positions: Sequence[int], data: DataConfig, *, prepare: PrepareConfig
) -> list[Pair | None]:
    """The pair before each position; None at the beginning of a scene, where a prepared set leaves it out, and in data
    sets in whose order nothing `follows` (views of one moment)."""
    if not getattr(dataset, "follows", True):
        return [None] * len(positions)
    holds = dataset.holds if data.kind == "prepared" else lambda position: True
    followers = [p for p in positions if p > 0 and holds(p - 1)]
    scenes = prepared(dataset, followers, data, prepare=prepare).scenes
    earlier = prepared(dataset, [p - 1 for p in followers], data, prepare=prepare)
    both = zip(followers, scenes, earlier.scenes, earlier, strict=True)
    pair_before = {p: pair for p, scene, scene_before, pair in both if scene == scene_before}
    return [pair_before.get(p) for p in positions]


def _make(dataset: Any, missing: Sequence[tuple[int, Path]], *, kind: str, prepare: PrepareConfig) -> None:
    """The pairs of frames by their positions, and the files that they go to."""
    if missing:
        check_networks(prepare)
        tidy(missing[0][1].parent)
    for i, file in Progress(missing, desc=f"preparing {kind}", unit="frame", disable=not missing):
        write_arrays(file, kept_of(make_record(dataset[i], i, dataset.spec, prepare=prepare)))


AGAIN = "delete it, and it is made anew"


def _read(file: Path) -> PairRecord:
    return record_of(_whole(file, read_arrays(file, by="prepared", again=AGAIN, summed=True), ARRAY_NAMES))


def _entry(file: Path, prepare: PrepareConfig) -> Entry:
    wanted = ("name", "scene", "has_image", "grid/elevation_rad", "grid/azimuth_rad")
    arrays = _whole(file, read_arrays(file, wanted, by="prepared", again=AGAIN), wanted)
    name = check_name(str(arrays["name"]), by="prepared")
    # A frame without one was refused where its pair was to be made; that others see it may have been asked for since.
    check_pictured(name, prepare.inputs, has_image=bool(arrays["has_image"]))
    window = len(arrays["grid/elevation_rad"]), len(arrays["grid/azimuth_rad"])
    return Entry(name, str(arrays["scene"]), window, f"{file.parent.name}/{file.stem}")


def _whole(file: Path, arrays: dict[str, Any], wanted: Collection[str]) -> dict[str, Any]:
    if missing := [name for name in wanted if name not in arrays]:
        raise ValueError(f"prepared: {file} is damaged: it lacks {', '.join(missing)}; {AGAIN}")
    with placed(f"prepared: {file} is damaged", then=AGAIN):
        check_example(arrays)
    return arrays
