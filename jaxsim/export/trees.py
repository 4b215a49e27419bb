"""KITTI trees of a data set's frames, with measured, plain or simulated clouds: what detectors train on.

OUT/training, OUT/ImageSets   the tree, in the benchmark's own formats
OUT/export.json               what it is made with, and what became of each frame
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import jax
import numpy as np

from jaxsim.cloud.kitti_tree import (
    TreeRecord,
    choose_boxes,
    tree_files,
    within_reach,
    write_image_sets,
    write_kitti_frame,
)
from jaxsim.data import Dataset
from jaxsim.data.seen import warn_of_scenes
from jaxsim.data.vkitti2 import VirtualKitti2
from jaxsim.data.vkitti2_files import boxes_of
from jaxsim.export.clouds import check_recipe, make_cloud
from jaxsim.export.plan import UNSAID, LabelRules, TreePlan
from jaxsim.files import stamp_of, tell_anew
from jaxsim.frame import Boxes, Frame
from jaxsim.prefetch import prefetch
from jaxsim.progress import Progress, check_all_done, counted
from jaxsim.simulate.frames import begin_of

_log = logging.getLogger(__name__)

SAVE_EVERY = 20
"""Frames between two writings of export.json."""


class Todo(NamedTuple):
    """A frame to write."""

    position: int
    """In the data set."""
    trees: tuple[int, ...]
    """Those that lack it, by their places among the plans."""
    first_s: float
    """Time of the data set's first frame (s), from which effects that drift count."""


class MadeFrame(NamedTuple):
    """What became of a frame."""

    position: int
    entries: dict[int, dict[str, Any]]
    """What export.json says of it, by the tree."""


@dataclass(frozen=True)
class TreeMaker:
    """Writes frames of a data set into trees; each frame is read, or rendered, once for all of them."""

    plans: Sequence[TreePlan]
    dataset: Dataset

    def __call__(self, todo: Todo) -> MadeFrame:
        return self.write(todo, self.dataset[todo.position])

    def write(self, todo: Todo, frame: Frame) -> MadeFrame:
        """Writes a frame into the trees that lack it."""
        write = partial(_write_frame, self.dataset, todo, frame=frame)
        return MadeFrame(todo.position, {tree: write(self.plans[tree]) for tree in todo.trees})


SpreadFrames = Callable[[Sequence[Todo]], Iterator[MadeFrame]]


def export_trees(
    plans: Sequence[TreePlan], dataset: Dataset, *, workers: int = 2, spread: SpreadFrames | None = None
) -> None:
    """Writes trees that differ in how their clouds are made.

    All take their frames from `dataset`; `workers` frames are made at once, or `spread` has them made elsewhere, by a
    TreeMaker of the same plans, and gives what became of each as it is done. Frames that are there are not made again,
    unless they are cut off or their files have changed since.
    Prints what was written. Raises ValueError, before anything is written, for recipes and labels that cannot be and
    for folders of other trees, and, once the others are made, for frames that cannot be read.
    """
    records = [_begin(plan, dataset) for plan in plans]
    everything = sorted({position for plan in plans for position in plan.positions})
    sources = {position: stamp_of(dataset, position) for position in everything}
    missing: dict[int, list[int]] = {}
    for tree, (plan, record) in enumerate(zip(plans, records, strict=True)):
        for position in _missing(plan, record, sources):
            missing.setdefault(position, []).append(tree)
    # Read for its time alone, which only effects ask for.
    timed = any(plan.effects_model for plan in plans)
    first_s = begin_of(dataset) if timed else 0.0
    todo = [Todo(position, tuple(trees), first_s) for position, trees in sorted(missing.items())]

    def save() -> None:
        for plan, record in zip(plans, records, strict=True):
            record.save(plan.out)

    save()  # before the first frame, so that whatever a killed command leaves behind is known to be its own

    failures: list[str] = []
    make = spread or partial(_in_threads, TreeMaker(plans, dataset), workers=workers, failures=failures)
    total = len(everything)
    with Progress(total=total, initial=total - len(missing), unit="frame", desc="exporting") as bar:
        try:
            for made in make(todo):
                for tree, entry in made.entries.items():
                    source = {"source": sources[made.position]} if sources[made.position] else {}
                    records[tree].frames[_number(made.position)] = entry | source
                bar.update()
                if bar.n % SAVE_EVERY == 0:
                    save()
        finally:
            save()
    check_all_done(failures, len(todo), by="export")
    for plan, record in zip(plans, records, strict=True):
        _finish(plan, record)


def _missing(plan: TreePlan, record: TreeRecord, sources: Mapping[int, str]) -> list[int]:
    """Positions of the frames that a tree lacks, or holds cut off or of files that have changed since: what is there of
    these is removed, so that nothing is left of one that is left out now."""
    there = {position for position in plan.positions if record.has(plan.out, _number(position))}
    reasons = {_number(position): record.anew(plan.out, _number(position), sources[position]) for position in there}
    anew = {number: why for number, why in sorted(reasons.items()) if why}
    tell_anew(anew, by="export")
    for number in anew:
        for path in tree_files(plan.out, number):
            path.unlink(missing_ok=True)
    return [position for position in plan.positions if position not in there or _number(position) in anew]


def _in_threads(maker: TreeMaker, todo: Sequence[Todo], *, workers: int, failures: list[str]) -> Iterator[MadeFrame]:
    """What became of each frame, made in threads: files and kernels leave Python's lock. Frames that cannot be read are
    left out, and told to `failures`."""

    def make(one: Todo) -> MadeFrame | None:
        try:
            frame = maker.dataset[one.position]
        except (ValueError, OSError) as error:
            failures.append(str(error))
            return None
        return maker.write(one, frame)

    with ThreadPoolExecutor(workers) as pool:
        yield from (made for made in prefetch(pool, make, todo, ahead=workers) if made)


def _begin(plan: TreePlan, dataset: Dataset) -> TreeRecord:
    """Claims a tree's folder. Raises ValueError where the plan cannot be, or the folder is another's."""
    check_recipe(plan.recipe, plan.learned, plan.effects_model)
    if plan.source.lidar == "camera" and plan.source.kind not in ("vkitti2", "synthetic"):
        raise ValueError(
            f"export: --data.lidar camera is for vkitti2 and synthetic; the sensors of {plan.source.kind} stand apart"
        )
    _check_occlusion(plan, dataset)
    record = TreeRecord.open(plan.out, plan.settings(), unsaid=UNSAID)
    record.check_names(plan.out, {_number(position): dataset.name_of(position) for position in plan.positions})
    return record


def _check_occlusion(plan: TreePlan, dataset: Dataset) -> None:
    occlusion = plan.labels.occlusion
    if occlusion == "levels":
        return
    if not isinstance(dataset, VirtualKitti2):
        raise ValueError(f"export: --occlusion {occlusion} is for vkitti2; labels of {plan.source.kind} have levels")
    if occlusion == "paper":
        _log.warning(
            "fractions in the column `occluded`: the official evaluation reads an integer there and takes "
            "every later column for another. Score with `jaxsim eval detection --rules openpcdet`, or export with "
            "--occlusion never_visible, which every program reads. No object is easy either way."
        )


def _number(position: int) -> str:
    """The name of a frame's files."""
    return f"{position:06d}"


def _write_frame(dataset: Dataset, todo: Todo, plan: TreePlan, *, frame: Frame) -> dict[str, Any]:
    """Writes one frame, unless nothing is left of it, and gives its entry in export.json."""
    position = todo.position
    boxes = _labels(plan.labels, dataset, position, frame=frame)
    boxes = choose_boxes(boxes, within_reach(boxes, plan.labels.reach_m))
    objects = sum(kind != "DontCare" for kind in boxes.kind)
    entry = {"name": frame.name, "scene": frame.scene, "objects": objects, "points": 0, "left_out": None}
    if not objects and not plan.labels.keep_empty:
        return entry | {"left_out": f"no object within {plan.labels.reach_m:g} m"}
    # By the frame's number: whoever makes it, and when, draws the same.
    key = jax.random.fold_in(jax.random.key(0), position)
    cloud = make_cloud(
        frame, plan.recipe, plan.learned, effects_model=plan.effects_model, key=key, first_s=todo.first_s
    )
    points = int(np.asarray(cloud.valid).sum())
    # No reader of KITTI's format takes a cloud without a point (`check_cloud`).
    if not points:
        return entry | {"left_out": "no point"}
    rect = frame.rect_from_velo
    write_kitti_frame(plan.out, _number(position), frame.camera, cloud=cloud, boxes=boxes, rect_from_velo=rect)
    return entry | {"points": points}


def _labels(rules: LabelRules, dataset: Dataset, position: int, *, frame: Frame) -> Boxes:
    """Boxes of a frame, with what is to be written into `occluded`. Raises ValueError where it has no labels."""
    if isinstance(dataset, VirtualKitti2):
        seen = [thing for thing in dataset.objects(position) if thing.pixels > 0]
        boxes = boxes_of(seen, levels=rules.filled)  # 1, 2, 3
        if rules.occlusion == "paper":
            return replace(boxes, occluded=np.array([1 - thing.occupancy for thing in seen], np.float32))
        # KITTI's levels begin at 0; one level up no object is easy, as none is with the paper's fractions.
        shift = 1 if rules.occlusion == "levels" else 0
        return replace(boxes, occluded=np.asarray(boxes.occluded) - shift)
    if frame.boxes is None:
        raise ValueError(
            f"export: {frame.name} has no labels, and a detector needs them; copy the data set's labels beside its "
            "clouds, or export another set (kitti_raw has none)"
        )
    return frame.boxes


def _finish(plan: TreePlan, record: TreeRecord) -> None:
    """Writes ImageSets and prints what was left out. Raises ValueError where no frame is left."""
    out, validation = plan.out, plan.validation
    entries = {position: record.frames[_number(position)] for position in plan.positions}
    finished = {position for position, entry in entries.items() if not entry["left_out"]}
    judged_scenes = {entries[position]["scene"] for position in finished & validation}
    shared = judged_scenes & {entries[position]["scene"] for position in finished - validation}
    warn_of_scenes(shared, who="a detector")
    sets = {
        "trainval": finished,
        "train": finished - validation,
        "val": validation & finished if validation else finished,
    }
    write_image_sets(out, {name: [_number(position) for position in positions] for name, positions in sets.items()})
    reasons = Counter(entry["left_out"] for entry in entries.values() if entry["left_out"])
    left_out = "".join(f", {count} left out ({reason})" for reason, count in reasons.items())
    points = sum(entries[position]["points"] for position in finished) / max(len(finished), 1)
    _log.info(f"{counted(len(finished), 'frame')} of {points:.0f} points on average{left_out}: {out}")
    # Last, when export.json is there to say why.
    if not finished:
        raise ValueError(f"export: no frame of {len(entries)} is left; see {out / 'export.json'}")
