"""Frames as a tree of the KITTI object benchmark, field by field in docs/kitti-tree.md:

    ROOT/training/{velodyne, calib, label_2, image_2}/000000.{bin, txt, txt, png}
    ROOT/ImageSets/{train, val, trainval}.txt

Numbers are written so that they read back to the last bit, which two decimals (KITTI's own) would not.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Shaped

from jaxsim.cloud.formats import points_of, save_cloud
from jaxsim.files import claim, files_in, parse_json, why_anew, write_image, write_text
from jaxsim.frame import Array, Boxes, Camera, CameraFrame, Cloud
from jaxsim.geometry.points import check_points

SUFFIX_OF = {"velodyne": ".bin", "calib": ".txt", "image_2": ".png", "label_2": ".txt"}
"""Folders of a frame's files; the label is written last, so that a frame that has one is whole."""
REACH_M = 80.0
"""Objects farther than this are left out, as in the paper."""
_DONT_CARE = "-1 -1 -10 {} -1 -1 -1 -1000 -1000 -1000 -10"


def tree_files(root: Path, number: str) -> list[Path]:
    """Files of a frame, the label last."""
    return [root / "training" / folder / f"{number}{suffix}" for folder, suffix in SUFFIX_OF.items()]


def write_kitti_frame(
    root: Path,
    number: str,
    view: CameraFrame,
    *,
    cloud: Cloud,
    boxes: Boxes,
    rect_from_velo: Float[Array, "4 4"] | None = None,
) -> None:
    """Writes the four files of one frame; `number` is KITTI's name of it, 000000.

    `boxes` are in `view`'s camera, or in the frame that `rect_from_velo` leads to. Raises ValueError for a cloud that
    no KITTI reader would take (no point, intensity that is missing or beyond 0..1, values that are not finite) and for
    boxes that are not finite or have a size of 0 or less.
    """
    check_cloud(cloud, number)
    lines = label_lines(boxes)
    velodyne, calibration, image, label = tree_files(root, number)
    save_cloud(velodyne, cloud)
    write_text(calibration, calibration_text(view.camera, rect_from_velo))
    write_image(image, np.asarray(view.rgb), by="kitti")
    write_text(label, "".join(f"{line}\n" for line in lines))


def check_cloud(cloud: Cloud, name: str) -> None:
    """Raises ValueError for a cloud that KITTI's format cannot hold."""
    if cloud.intensity is None:
        raise ValueError(f"kitti: the cloud of {name} has no intensity; write 0 for all, as depth_to_cloud does")
    check_points(points_of(cloud), f"kitti: {name}")


def calibration_text(camera: Camera, rect_from_velo: Float[Array, "4 4"] | None = None) -> str:
    """A calib file's seven lines, in KITTI's order: readers count them.

    R0_rect is the identity and Tr_velo_to_cam leads straight to the labels' frame. P2 = K [I | t], where t leads from
    there to the camera: 0 where the labels are in its frame. The other cameras do not exist and get P2 as well; the
    motion unit has the LiDAR's place.
    """
    if np.ndim(camera.intrinsics) != 2:
        raise ValueError(f"kitti: a calib file is of one camera, got a batch {np.shape(camera.intrinsics)[:-2]}")
    cam_from_velo = np.asarray(camera.cam_from_velo, np.float64)
    intrinsics = np.asarray(camera.intrinsics, np.float64)
    rect = cam_from_velo if rect_from_velo is None else np.asarray(rect_from_velo, np.float64)
    # From the labels' frame to the camera: identity where they are one.
    shift = cam_from_velo @ np.linalg.inv(rect) if rect_from_velo is not None else np.eye(4)
    if np.abs(shift[:3, :3] - np.eye(3)).max() > 1e-4:
        raise ValueError("kitti: the labels' frame is turned against the camera's; KITTI knows only a shift (P2)")
    # P2 = K [I | t], t from the labels' frame to the camera.
    projection = np.column_stack([intrinsics, intrinsics @ shift[:3, 3]])
    eye = np.eye(4)[:3]
    rows = {f"P{k}": projection for k in range(4)}
    rows |= {"R0_rect": np.eye(3), "Tr_velo_to_cam": rect[:3], "Tr_imu_to_velo": eye}
    return "".join(f"{name}: {' '.join(repr(float(v)) for v in values.ravel())}\n" for name, values in rows.items())


def label_lines(boxes: Boxes) -> list[str]:
    """The 15 columns of each object, DontCare regions last: OpenPCDet's reader takes the objects from the front.

    Raises ValueError for values that are not finite, sizes of 0 or less, and kinds with a blank in their name.
    """
    centre = np.asarray(boxes.centre_m, np.float32)
    size = np.asarray(boxes.size_m, np.float32)
    bbox = np.asarray(boxes.bbox_px, np.float32)
    yaw = np.asarray(boxes.yaw_rad, np.float32)
    truncated = np.asarray(boxes.truncated, np.float32)
    level = np.asarray(boxes.occluded)
    objects, regions = [], []
    for i, kind in enumerate(boxes.kind):
        corners = " ".join(map(_exact, bbox[i]))
        if kind == "DontCare":
            regions.append(f"{kind} {_DONT_CARE.format(corners)}")
            continue
        numbers = np.array([truncated[i], level[i], *bbox[i], *size[i], *centre[i], yaw[i]])
        if not np.isfinite(numbers).all() or (size[i] <= 0).any():
            raise ValueError(
                f"kitti: object {i} ({kind}) is at {centre[i].tolist()}, {size[i].tolist()} m large, turned by "
                f"{yaw[i]}, seen at {bbox[i].tolist()}: all must be finite, and sizes above 0"
            )
        if not kind or kind.split() != [kind]:
            raise ValueError(f"kitti: object {i} is called {kind!r}; columns are divided by blanks, write one word")
        # KITTI's observation angle: rotation_y less the angle of the ray to the object.
        alpha = _turn(float(yaw[i]) - float(np.arctan2(centre[i, 0], centre[i, 2])))
        hidden = str(int(level[i])) if level[i] == int(level[i]) else _exact(level[i])
        # The file has height, width, length.
        sizes = " ".join(map(_exact, size[i][[2, 1, 0]]))
        location = " ".join(map(_exact, centre[i]))
        objects.append(
            f"{kind} {_exact(truncated[i])} {hidden} {alpha:.6f} {corners} {sizes} {location} {_exact(yaw[i])}"
        )
    return objects + regions


def _exact(value: Shaped[np.ndarray, ""] | np.floating) -> str:
    """The shortest decimals that read back to this float32, without an exponent."""
    return np.format_float_positional(np.float32(value), trim="0")


def _turn(angle_rad: float) -> float:
    return float((angle_rad + np.pi) % (2 * np.pi) - np.pi)


def choose_boxes(boxes: Boxes, keep: Bool[np.ndarray, " n"]) -> Boxes:
    """The boxes of `keep`, on the host."""
    arrays = {
        name: np.asarray(getattr(boxes, name))[keep]
        for name in ("centre_m", "size_m", "yaw_rad", "bbox_px", "truncated", "occluded")
    }
    return Boxes(**arrays, kind=tuple(kind for kind, chosen in zip(boxes.kind, keep, strict=True) if chosen))


def within_reach(boxes: Boxes, reach_m: float = REACH_M) -> Bool[np.ndarray, " n"]:
    """Which objects lie within `reach_m` of the labels' origin; DontCare regions have no place and all do.

    The paper says 80 m and not how it measures; this is the straight distance to the middle of the bottom face.
    """
    # Asked as `far`, so that a place that is no number stays in, and is refused when it is written.
    far = np.linalg.norm(np.asarray(boxes.centre_m, np.float64), axis=1) > reach_m
    return ~far | np.array([kind == "DontCare" for kind in boxes.kind], bool)


def write_image_sets(root: Path, sets: dict[str, Iterable[str]]) -> None:
    """Writes ImageSets/NAME.txt, one number a line, sorted."""
    for name, numbers in sets.items():
        write_text(root / "ImageSets" / f"{name}.txt", "".join(f"{number}\n" for number in sorted(numbers)))


@dataclass
class TreeRecord:
    """OUT/export.json: what a tree is made with and what became of each frame, by which a killed export goes on."""

    settings: dict[str, Any]
    frames: dict[str, dict[str, Any]]

    @classmethod
    def open(cls, out: Path, settings: dict[str, Any], *, unsaid: Collection[str] = ()) -> TreeRecord:
        """The record of `out`, a new one where there is none. Settings in `unsaid` that an old one lacks count as the
        same.

        Raises ValueError where the tree was made with other settings, or by something else.
        """
        path = out / "export.json"
        frames: dict[str, dict[str, Any]] = {}

        def read(record: bytes) -> dict[str, Any]:
            content = parse_json(record)
            frames.update(content["frames"])
            for one in frames.values():
                if not isinstance(one["name"], str) or not isinstance(one["left_out"], str | None):
                    raise ValueError("a frame's name, or why it was left out, is no text")
            # A tree that holds no frame yet may become another.
            was = content["settings"] if frames or written else settings
            return {name: settings[name] for name in unsaid if name in settings} | was

        written = any(files_in(out / "training" / folder, suffix) for folder, suffix in SUFFIX_OF.items())
        filled = path.is_file() or written
        claim(path, settings, by="export", filled=filled, read=read)
        return cls(settings, frames)

    def check_names(self, out: Path, names: dict[str, str]) -> None:
        """Raises ValueError where the tree holds another frame under a number than `names` has there."""
        other = [number for number, name in names.items() if self.frames.get(number, {"name": name})["name"] != name]
        if other:
            was, now = self.frames[other[0]]["name"], names[other[0]]
            raise ValueError(
                f"export: {out} holds {was} as {other[0]}, which is {now} now ({len(other)} such): the data set "
                "has gained or lost frames; give another --out, or delete the folder"
            )

    def has(self, out: Path, number: str) -> bool:
        """Whether a frame is done: all its files are there, or it was left out."""
        about = self.frames.get(number)
        return about is not None and (
            bool(about["left_out"]) or all(path.is_file() for path in tree_files(out, number))
        )

    def anew(self, out: Path, number: str, source: str) -> str:
        """Why a frame that is done is to be made anew, in words; empty where it may stay. Its cloud is no whole number
        of points, or `source`, the stamp of what it is made of, is another than its entry has."""
        about = self.frames[number]
        cloud, *_ = tree_files(out, number)
        if not about["left_out"] and (cloud.stat().st_size % 16 or not cloud.stat().st_size):
            return "its cloud is cut off"
        return why_anew(str(about.get("source", "")), source)

    def save(self, out: Path) -> None:
        """Writes OUT/export.json."""
        content = {"settings": self.settings, "frames": dict(sorted(self.frames.items()))}
        write_text(out / "export.json", json.dumps(content, indent=1))
