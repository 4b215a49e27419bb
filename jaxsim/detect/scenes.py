"""A frame as the detector sees it: points, objects to find, labels to be scored by; made once and kept on disk."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Float32, Int

from jaxsim.files import check_name, kept_files, making, read_arrays, stamp_of, tidy, write_arrays
from jaxsim.frame import Boxes, Frame
from jaxsim.geometry.boxes import DIFFICULTIES, lidar_boxes
from jaxsim.geometry.points import check_points as points_of_lidar
from jaxsim.progress import Progress


@dataclass(frozen=True)
class Scene:
    """One frame on the host."""

    name: str
    points: Float32[np.ndarray, "n 4"]
    """x, y, z in `velo`, metres; intensity 0..1."""
    boxes: Float32[np.ndarray, "g 7"]
    """Labelled objects of all kinds in `velo`, without DontCare regions."""
    target: Bool[np.ndarray, " g"]
    """Which of them are of the class to find."""
    difficulty: Int[np.ndarray, " g"]
    """0 easy, 1 moderate, 2 hard, -1 beyond: OpenPCDet's level."""
    view: View
    labels: Boxes | None = None
    """Labels as they were written; None where there are none."""
    ground: Float[np.ndarray, " 4"] | None = None
    """Road plane in the labels' frame."""


@dataclass(frozen=True)
class View:
    """The view in which boxes are written down: a camera and its image."""

    intrinsics: Float[np.ndarray, "3 3"]
    cam_from_velo: Float[np.ndarray, "4 4"]
    rect_from_velo: Float[np.ndarray, "4 4"]
    """The transform to the frame of the labels."""
    size: tuple[int, int]
    """Rows and columns of the image."""


def view_of(frame: Frame) -> View:
    """The camera of a frame, and the frame that its labels are given in."""
    camera = frame.camera.camera
    cam = np.asarray(camera.cam_from_velo, np.float64)
    rect = cam if frame.rect_from_velo is None else np.asarray(frame.rect_from_velo, np.float64)
    return View(np.asarray(camera.intrinsics, np.float64), cam, rect, frame.camera.rgb.shape[:2])


def seen_by(points: Float[np.ndarray, "n c"], view: View) -> Bool[np.ndarray, " n"]:
    """Which points fall inside the image: 0 <= u < columns, 0 <= v < rows, not behind (OpenPCDet's get_fov_flag)."""
    cam = points[:, :3].astype(np.float64) @ view.cam_from_velo[:3, :3].T + view.cam_from_velo[:3, 3]
    rect = points[:, :3].astype(np.float64) @ view.rect_from_velo[2, :3] + view.rect_from_velo[2, 3]
    pixel = cam @ view.intrinsics.T
    with np.errstate(divide="ignore", invalid="ignore"):
        u, v = pixel[:, 0] / rect, pixel[:, 1] / rect  # published: by the labels' depth, 3 mm from the camera's own
    rows, columns = view.size
    return (u >= 0) & (u < columns) & (v >= 0) & (v < rows) & (rect >= 0)


def difficulties(labels: Boxes) -> Int[np.ndarray, " g"]:
    """Difficulty of each label as OpenPCDet has it: the height counts both of its rows."""
    height = np.asarray(labels.bbox_px)[:, 3] - np.asarray(labels.bbox_px)[:, 1] + 1
    difficulty = np.full(len(labels.kind), -1)
    # From hard to easy: the easiest difficulty that fits is written last.
    for k, limit in reversed([*enumerate(DIFFICULTIES.values())]):
        fits = (height >= limit.height_px) & (np.asarray(labels.occluded) <= limit.occluded)
        difficulty[fits & (np.asarray(labels.truncated) <= limit.truncated)] = k
    return difficulty


def scene_of_frame(frame: Frame, kind: str, *, in_image: bool) -> Scene:
    """A frame's scene; `in_image` keeps only what the camera sees.

    Raises ValueError for a frame without points, and without intensity (NaN).
    """
    if frame.cloud is None:
        raise ValueError(f"detect: {frame.name} has no point cloud; this data set has none, use another")
    xyz = np.asarray(frame.cloud.xyz_m)
    intensity = np.asarray(frame.cloud.intensity)
    valid = np.asarray(frame.cloud.valid)
    points = np.column_stack([xyz, intensity]).astype(np.float32)[valid]
    check_detectable(points, frame.name)
    view = view_of(frame)
    if in_image:
        points = points[seen_by(points, view)]
    labels = frame.boxes
    if labels is None:
        nothing = np.zeros((0, 7), np.float32), np.zeros(0, bool), np.zeros(0, int)
        return Scene(frame.name, points, *nothing, view, None, frame.ground)
    # Regions have no box in space, only one in the image.
    things = np.array([name.lower() != "dontcare" for name in labels.kind], bool)
    boxes = lidar_boxes(labels, view.rect_from_velo)[things].astype(np.float32)
    target = np.array([name == kind for name in labels.kind], bool)[things]
    return Scene(frame.name, points, boxes, target, difficulties(labels)[things], view, labels, frame.ground)


def check_detectable(points: Float[np.ndarray, "n c"], name: str) -> None:
    """Raises ValueError for a cloud without intensity, and as geometry's check of the same name."""
    if points.shape[1] < 4:
        raise ValueError(
            f"detect: the cloud of {name} has {points.shape[1]} columns, no intensity; the detector takes x, y, z and "
            "intensity 0..1: simulate intensity, or write 0 for all points and train on such clouds too"
        )
    points_of_lidar(points, f"detect: {name}")


class Scenes(Sequence[Scene]):
    """Scenes by position, read from disk when asked for."""

    def __init__(self, files: Sequence[Path]):
        self.files = list(files)

    def __len__(self) -> int:
        return len(self.files)

    def __getitem__(self, i: Any) -> Any:
        return read_scene(self.files[i])


def cached_scenes(
    dataset: Any, positions: Sequence[int], kind: str, *, in_image: bool, cache: Path, settings: str
) -> Scenes:
    """The scenes at these positions of a data set (jaxsim.data); makes those that are not kept in `cache` yet.

    `settings` says all that the frames depend on: scenes of other settings are kept apart.
    """
    about = f"{settings}|{kind}|{in_image}"
    folder = cache / f"scenes-{making(about, 'data', 'geometry', 'frame.py', 'detect/scenes.py')}"
    stamps = [stamp_of(dataset, i) for i in positions]
    files = kept_files(folder, dataset, positions, stamps=stamps, by="detect")
    missing = [(i, file) for i, file in zip(positions, files, strict=True) if not file.is_file()]
    if missing:
        tidy(folder)
    for i, file in Progress(missing, desc="scenes", unit="frame", disable=not missing):
        write_scene(file, scene_of_frame(dataset[i], kind, in_image=in_image))
    return Scenes(files)


_PLAIN = ("points", "boxes", "target", "difficulty")
_VIEW = ("intrinsics", "cam_from_velo", "rect_from_velo")
_LABELS = tuple(field.name for field in fields(Boxes) if field.name != "kind")


def write_scene(path: Path, scene: Scene) -> None:
    """Keeps a scene in one .npz."""
    arrays: dict[str, Any] = {name: getattr(scene, name) for name in _PLAIN}
    arrays |= {f"view.{name}": getattr(scene.view, name) for name in _VIEW}
    arrays |= {"name": np.array(scene.name), "view.size": np.array(scene.view.size)}
    if scene.labels is not None:
        arrays |= {f"labels.{name}": np.asarray(getattr(scene.labels, name)) for name in _LABELS}
        # Said, for an empty tuple would become an array of numbers.
        arrays["labels.kind"] = np.array(scene.labels.kind, dtype="U32")
    if scene.ground is not None:
        arrays["ground"] = scene.ground
    write_arrays(path, arrays)


def read_scene(path: Path) -> Scene:
    """A scene that `write_scene` kept. Raises ValueError where the file is damaged."""
    again = "delete it, and it is made anew"
    a = read_arrays(path, by="detect", again=again, summed=True)
    needed = [*_PLAIN, *(f"view.{name}" for name in _VIEW), "view.size", "name"]
    needed += [f"labels.{name}" for name in _LABELS] if "labels.kind" in a else []
    if missing := [name for name in needed if name not in a]:
        raise ValueError(f"detect: {path} is damaged: it lacks {', '.join(missing)}; {again}")
    labels = None
    if "labels.kind" in a:
        kinds = tuple(str(kind) for kind in a["labels.kind"])
        labels = Boxes(**{name: a[f"labels.{name}"] for name in _LABELS}, kind=kinds)
    rows, columns = a["view.size"].tolist()
    view = View(**{name: a[f"view.{name}"] for name in _VIEW}, size=(rows, columns))
    plain = {name: a[name] for name in _PLAIN}
    return Scene(
        name=check_name(str(a["name"]), by="detect"), view=view, labels=labels, ground=a.get("ground"), **plain
    )
