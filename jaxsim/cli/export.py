"""`jaxsim export`: a data set's frames as a tree of the KITTI object benchmark, which detectors train on."""

from __future__ import annotations

import hashlib
import json
import sys
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import jax
import numpy as np
from tqdm import tqdm

from jaxsim.cli.source import SYNTHETIC, Source
from jaxsim.cloud.kitti_tree import REACH_M, choose_boxes, within_reach, write_image_sets, write_kitti_frame
from jaxsim.cloud.tree_record import TreeRecord
from jaxsim.config import CloudRecipe, DataConfig
from jaxsim.data import Dataset, open_dataset, select
from jaxsim.data.vkitti2 import VirtualKitti2
from jaxsim.data.vkitti2_files import boxes_of
from jaxsim.effects.chain import SensorModel
from jaxsim.frame import Boxes, Frame
from jaxsim.simulate.clouds import check_recipe, grid_file, make_cloud
from jaxsim.simulate.sensor import LearnedSensor, load

_SAVE_EVERY = 20


@dataclass(frozen=True)
class Export:
    """Writes frames as a KITTI tree: OUT/training/{velodyne, calib, label_2, image_2} and OUT/ImageSets.

    Objects farther than 80 m, and frames in which no object is left, are left out. A frame's number is its place in
    the data set. What is already there is not made again, so that a killed command resumes (docs/kitti-tree.md).
    """

    out: Path
    """Folder to write to."""
    data: Source = SYNTHETIC
    """Data set to export."""
    frames: str = ""
    """Frames to export: `0-99`. Empty: all (of the embedded world you must say which)."""
    validation: str = ""
    """Which of them go to ImageSets/val.txt; the others go to train.txt. Empty: all go to both."""
    recipe: CloudRecipe = field(default_factory=CloudRecipe)
    """How the clouds are made."""
    run: Path | None = None
    """Folder of the learned sensor's run, for `--recipe.source simulated`."""
    effects: Path | None = None
    """Effects (sensor.json) that the learned sensor lacks, for `--recipe.projection grid`; `jaxsim discover` writes
    one."""
    occlusion: Literal["levels", "never_visible", "paper"] = "levels"
    """Column `occluded` of vkitti2: KITTI's 0, 1, 2 by how much of its box an object fills; the same one level up, so
    that nothing is easy; or the hidden share as a fraction, as the paper has it, which the official evaluation cannot
    read. Other sets have levels of their own."""
    filled: tuple[float, float] = (0.5, 0.25)
    """Share of the box that an object fills at least at level 0, and at level 1: an unhidden car fills 0.65 to 0.85."""
    reach_m: float = REACH_M
    """Objects farther away are left out."""
    keep_empty: bool = False
    """Write frames without objects too, with an empty label file. OpenPCDet cannot read such a frame for training."""
    workers: int = 2
    """Frames at work at once."""

    def __call__(self) -> None:
        export_trees([self], self.dataset())

    def dataset(self) -> Dataset:
        """The data set to export. Raises ValueError where the flags do not fit it."""
        source = self.source
        if source.lidar == "camera" and source.kind not in ("vkitti2", "synthetic"):
            raise ValueError(
                f"export: --data.lidar camera is for vkitti2 and synthetic; the sensors of {source.kind} stand apart"
            )
        if source.kind == "synthetic" and not self.frames:
            raise ValueError("export: the embedded world has no end; say which frames: --frames 0-199")
        return open_dataset(source)

    def write(self, dataset: Dataset, place: int, frame: Frame, maker: Maker) -> tuple[str, dict[str, Any]]:
        """Writes one frame, unless nothing is left of it; its number and its entry in export.json."""
        number = f"{place:06d}"
        boxes = self._labels(dataset, place, frame)
        boxes = choose_boxes(boxes, within_reach(boxes, self.reach_m))
        objects = sum(kind != "DontCare" for kind in boxes.kind)
        about = {"name": frame.name, "scene": frame.scene, "objects": objects, "points": 0, "left_out": None}
        if not objects and not self.keep_empty:
            return number, about | {"left_out": f"no object within {self.reach_m:g} m"}
        key = jax.random.fold_in(jax.random.key(0), place)
        if frame.time_s is not None:
            frame = replace(frame, time_s=frame.time_s - maker.first_s)
        cloud = make_cloud(frame, self.recipe, maker.sensor, effects=maker.effects, key=key)
        points = int(np.asarray(cloud.valid).sum())
        if not points:
            return number, about | {"left_out": "no point"}
        rect = frame.rect_from_velo
        write_kitti_frame(self.out, number, frame.camera, cloud, boxes, rect_from_velo=rect)
        return number, about | {"points": points}

    def places(self, dataset: Dataset) -> tuple[list[int], set[int]]:
        """Frames to export, and which of them validate. Raises ValueError where these are none of those."""
        wanted = select(self.frames, dataset) if self.frames else list(range(len(dataset)))
        validation = set(select(self.validation, dataset)) if self.validation else set()
        if not validation <= set(wanted):
            raise ValueError(f"export: --validation {self.validation} names frames that --frames does not")
        return wanted, validation

    def _labels(self, dataset: Dataset, place: int, frame: Frame) -> Boxes:
        """Boxes of a frame, with what is to be written into `occluded`."""
        if isinstance(dataset, VirtualKitti2):
            seen = [thing for thing in dataset.objects(place) if thing.pixels > 0]
            boxes = boxes_of(seen, levels=self.filled)  # 1, 2, 3
            if self.occlusion == "paper":
                return replace(boxes, occluded=np.array([1 - thing.occupancy for thing in seen], np.float32))
            shift = 1 if self.occlusion == "levels" else 0
            return replace(boxes, occluded=np.asarray(boxes.occluded) - shift)
        if frame.boxes is None:
            raise ValueError(
                f"export: {frame.name} has no labels, and a detector needs them; copy the data set's labels beside its "
                "clouds, or export another set (kitti_raw has none)"
            )
        return frame.boxes

    def check_occlusion(self, dataset: Dataset) -> None:
        if self.occlusion == "levels":
            return
        if not isinstance(dataset, VirtualKitti2):
            raise ValueError(
                f"export: --occlusion {self.occlusion} is for vkitti2; labels of {self.source.kind} have levels"
            )
        if self.occlusion == "paper":
            print(
                "warning: fractions in the column `occluded`: the official evaluation reads an integer there and takes "
                "every later column for another. Score with `jaxsim eval detection --rules openpcdet`, or export with "
                "--occlusion never_visible, which every program reads. No object is easy either way.",
                file=sys.stderr,
            )

    @property
    def source(self) -> DataConfig:
        """Where the frames come from."""
        if not self.data.foreign:
            raise ValueError("export: no data set was named; give its kind: --data.kind vkitti2")
        return self.data.config()

    def settings(self, maker: Maker) -> dict[str, Any]:
        """All that decides what a frame's files hold."""
        data = self.source
        of_source = ("scenes", "variations", "camera", "lidar", "seed", "streets")
        source = {"data": data.kind} | {key: getattr(data, key) for key in of_source}
        labels = {key: getattr(self, key) for key in ("occlusion", "filled", "reach_m", "keep_empty")}
        recipe = {f"recipe.{key}": value for key, value in asdict(self.recipe).items()}
        if (grid := grid_file(self.recipe)) is not None:
            recipe["recipe.lines"] = f"grid of SHA-256 {hashlib.sha256(grid.read_bytes()).hexdigest()}"
        effects = maker.effects.effects if maker.effects else None
        # A path is no proof that files are the same, but another path is a question; the embedded world has no files.
        root = str(data.root.resolve()) if data.root else None
        files = {} if data.kind == "synthetic" else {"root": root, "rows": data.rows}
        made = {"sensor": maker.sensor and maker.sensor.fingerprint, "effects": effects}
        return json.loads(json.dumps(source | files | labels | recipe | made))

    def finish(self, record: TreeRecord, wanted: list[int], validation: set[int]) -> None:
        """Writes ImageSets, says what was left out."""
        about = {place: record.frames[f"{place:06d}"] for place in wanted}
        kept = {place for place, frame in about.items() if not frame["left_out"]}
        shared = {about[p]["scene"] for p in kept & validation} & {about[p]["scene"] for p in kept - validation}
        if shared:
            print(
                f"warning: scenes on both sides of the split, {', '.join(sorted(shared)[:3])}: a detector is then "
                "scored on streets that it has seen",
                file=sys.stderr,
            )
        sets = {"trainval": kept, "train": kept - validation, "val": validation & kept if validation else kept}
        write_image_sets(self.out, {name: [f"{place:06d}" for place in places] for name, places in sets.items()})
        reasons = Counter(frame["left_out"] for frame in about.values() if frame["left_out"])
        left_out = "".join(f", {count} left out ({reason})" for reason, count in reasons.items())
        points = sum(about[place]["points"] for place in kept) / max(len(kept), 1)
        print(f"{len(kept)} frames of {points:.0f} points on average{left_out}: {self.out}")
        if not kept:
            raise ValueError(f"export: no frame of {len(about)} is left; see {self.out / 'export.json'}")


@dataclass(frozen=True)
class Maker:
    """What makes a tree's clouds, beside its recipe."""

    sensor: LearnedSensor | None
    effects: SensorModel | None
    first_s: float = 0.0
    """Time of the data set's first frame, which effects that drift count from; data sets count from 1970."""

    @classmethod
    def of(cls, export: Export) -> Maker:
        """Loads what an export names. Raises ValueError where its recipe needs more, or less."""
        sensor = load(export.run) if export.run else None
        rows = len(sensor.window[0].elevation_rad) if sensor else None
        effects = SensorModel.load(export.effects, rows=rows) if export.effects else None
        check_recipe(export.recipe, sensor, effects)
        return cls(sensor, effects)


def export_trees(exports: Sequence[Export], dataset: Dataset) -> None:
    """Writes trees that differ in how their clouds are made; each frame is read, or rendered, once for all of them.

    All take their frames from `dataset`. Raises ValueError as their flags do, before anything is written.
    """
    makers, records, places = [], [], []
    for export in exports:
        maker = Maker.of(export)
        makers.append(replace(maker, first_s=dataset[0].time_s or 0.0) if maker.effects else maker)
        places.append(export.places(dataset))
        export.check_occlusion(dataset)
        records.append(TreeRecord.open(export.out, export.settings(makers[-1])))
        records[-1].check_names(export.out, {f"{place:06d}": dataset.name_of(place) for place in places[-1][0]})
    trees = list(zip(exports, makers, records, places, strict=True))
    wanted = sorted({place for own, _ in places for place in own})
    missing: dict[int, list[tuple[Export, Maker, TreeRecord]]] = {}
    for export, maker, record, (own, _) in trees:
        for place in own:
            if not record.has(export.out, f"{place:06d}"):
                missing.setdefault(place, []).append((export, maker, record))
    todo = sorted(missing)

    def write(place: int) -> list[tuple[TreeRecord, tuple[str, dict[str, Any]]]]:
        frame = dataset[place]
        return [(record, export.write(dataset, place, frame, maker)) for export, maker, record in missing[place]]

    # Before the first frame, so that whatever a killed command leaves behind is known to be its own.
    for export, _, record, _ in trees:
        record.save(export.out)

    # Frames in threads: files and kernels leave Python's lock.
    with (
        tqdm(total=len(wanted), initial=len(wanted) - len(todo), unit="frame", desc="exporting") as bar,
        ThreadPoolExecutor(max(export.workers for export in exports)) as pool,
    ):
        jobs = [pool.submit(write, place) for place in todo]
        try:
            for job in as_completed(jobs):
                for record, entry in job.result():
                    record.frames.update([entry])
                bar.update()
                if bar.n % _SAVE_EVERY == 0:
                    for export, _, record, _ in trees:
                        record.save(export.out)
        finally:
            pool.shutdown(cancel_futures=True)
            for export, _, record, _ in trees:
                record.save(export.out)
    for export, _, record, (own, validation) in trees:
        export.finish(record, own, validation)
