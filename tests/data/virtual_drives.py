"""Renders the embedded world in Virtual KITTI 2's exact on-disk format: there are no samples to be had.

`test_vkitti2.py` checks the files against each fact of the format, without the reader.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

from jaxsim.data.cityscapes import IDS
from jaxsim.data.synthetic import SyntheticWorld, kitti_camera
from jaxsim.data.synthetic.render import photograph
from jaxsim.data.vkitti2_files import COLOURS, HEADERS, OBJECT_KINDS
from jaxsim.frame import Camera

K = np.array([[725.0087, 0, 620.5], [0, 725.0087, 187], [0, 0, 1]], np.float32)
BASELINE_M = 0.532725
CLASS_OF = {
    **{IDS[name]: "Terrain" for name in ("ground", "sidewalk", "terrain")},
    IDS["road"]: "Road",
    IDS["building"]: "Building",
    IDS["pole"]: "Pole",
    IDS["sky"]: "Sky",
    IDS["vegetation"]: "Vegetation",
    IDS["traffic sign"]: "TrafficSign",
    IDS["traffic light"]: "TrafficLight",
    IDS["wall"]: "Building",
    IDS["fence"]: "GuardRail",
    IDS["car"]: "Car",
    IDS["truck"]: "Truck",
}
"""Cityscapes id -> class; what the set does not have is Misc."""
_WORLD = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])  # its world has y down, as its cameras have


@dataclass
class Rendered:
    """What one camera saw, before it was written."""

    rgb: np.ndarray
    depth_m: np.ndarray
    valid: np.ndarray
    classes: np.ndarray
    """Names of the set's classes, as indices of `list(COLOURS)`."""
    tracks: np.ndarray
    """Track + 1, 0 none."""
    camera: Camera
    cam_from_world: np.ndarray


def camera_of(number: int) -> Camera:
    """Left (0) or right (1), on KITTI's car."""
    shift = np.eye(4, dtype=np.float32)
    shift[0, 3] = -BASELINE_M * number
    return Camera(K, shift @ kitti_camera().cam_from_velo)


def render(world: SyntheticWorld, index: int, number: int) -> Rendered:
    """Frame `index` seen by camera `number`."""
    world.camera = camera_of(number)
    moment = world._moment(index)
    view = world._view(moment)
    vehicles = [i for i, thing in enumerate(moment.drive.things) if thing.kind in OBJECT_KINDS]
    track = np.zeros(len(moment.drive.things) + 1, np.int64)
    track[np.array(vehicles, int) + 1] = np.arange(1, len(vehicles) + 1)
    tracks = track[view.instance]
    names = list(COLOURS)
    classes = np.vectorize(lambda i: names.index(CLASS_OF.get(int(i), "Misc")))(view.semantic)
    for k, i in enumerate(vehicles):
        classes[tracks == k + 1] = names.index(moment.drive.things[i].kind)
    world_from_velo = np.eye(4)
    world_from_velo[:3, :3] = _WORLD @ moment.velo_pose[:3, :3]
    world_from_velo[:3, 3] = _WORLD @ moment.velo_pose[:3, 3]
    return Rendered(
        rgb=np.asarray(photograph(view.light, world._key(index, number))),
        depth_m=view.depth_m,
        valid=view.valid,
        classes=classes,
        tracks=tracks,
        camera=world.camera,
        cam_from_world=world.camera.cam_from_velo.astype(float) @ np.linalg.inv(world_from_velo),
    )


def write_vkitti2(root: Path, scene: str, variation: str, world: SyntheticWorld, shots: list[tuple[int, int, int]]):
    """One variation of a scene; `shots` are (frame number in the set, frame of the world, camera). Gives them drawn."""
    folder = root / scene / variation
    lines: dict[str, list[str]] = {name: [header] for name, header in HEADERS.items()}
    lines["colors"] += [f"{name} {r} {g} {b}" for name, (r, g, b) in COLOURS.items()]
    drawn = {}
    for number, index, camera in shots:
        shot = drawn[number, camera] = render(world, index, camera)
        _write_rasters(folder / "frames", number, camera, shot)
        lines["intrinsic"].append(f"{number} {camera} 725.0087 725.0087 620.5 187")
        lines["extrinsic"].append(" ".join([f"{number} {camera}", *(f"{v:.9g}" for v in shot.cam_from_world.ravel())]))
        for box, pose in _objects(world, index, shot):
            lines["bbox"].append(f"{number} {camera} {box}")
            lines["pose"].append(f"{number} {camera} {pose}")
    things = world._moment(shots[0][1]).drive.things
    vehicles = [thing.kind for thing in things if thing.kind in OBJECT_KINDS]
    lines["info"] += [f"{track} {kind} Model{track} Grey" for track, kind in enumerate(vehicles)]
    for name, text in lines.items():
        (folder / f"{name}.txt").write_text("\n".join(text) + "\n")
    return drawn


def _write_rasters(frames: Path, number: int, camera: int, shot: Rendered) -> None:
    def path(kind: str, name: str) -> Path:
        out = frames / kind / f"Camera_{camera}" / name
        out.parent.mkdir(parents=True, exist_ok=True)
        return out

    assert cv2.imwrite(str(path("rgb", f"rgb_{number:05d}.jpg")), shot.rgb[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 98])
    centimetres = np.where(shot.valid, np.clip(np.round(shot.depth_m * 100), 1, 65535), 65535).astype(np.uint16)
    assert cv2.imwrite(str(path("depth", f"depth_{number:05d}.png")), centimetres)
    colours = np.array(list(COLOURS.values()), np.uint8)[shot.classes]
    assert cv2.imwrite(str(path("classSegmentation", f"classgt_{number:05d}.png")), colours[..., ::-1])
    indexed = Image.fromarray(shot.tracks.astype(np.uint8))
    indexed.putpalette(np.random.default_rng(0).integers(0, 256, 768).astype(np.uint8).tobytes())
    indexed.save(path("instanceSegmentation", f"instancegt_{number:05d}.png"))


def _objects(world: SyntheticWorld, index: int, shot: Rendered) -> list[tuple[str, str]]:
    """The rows of bbox.txt and pose.txt, without frame and camera, of every vehicle in the frustum."""
    moment, later = world._moment(index), world._moment(index + 1)
    rows = []
    vehicles = [i for i, thing in enumerate(moment.drive.things) if thing.kind in OBJECT_KINDS]
    for track, i in enumerate(vehicles):
        (length, width, height), at = moment.drive.things[i].size_m, _WORLD @ moment.position_m[i]
        heading = float(moment.heading_rad[i])
        turn = np.arctan2(-np.cos(heading), -np.sin(heading))  # KITTI's rotation_y in the set's world
        x, y, z = shot.cam_from_world[:3, :3] @ at + shot.cam_from_world[:3, 3]
        ahead = shot.cam_from_world[:3, :3] @ _WORLD @ [np.cos(heading), np.sin(heading), 0.0]
        yaw = np.arctan2(-ahead[2], ahead[0])
        across, down, along = np.meshgrid([-width / 2, width / 2], [-height, 0], [-length / 2, length / 2])
        corners = np.stack([np.cos(yaw) * along + np.sin(yaw) * across + x, down + y,
                            -np.sin(yaw) * along + np.cos(yaw) * across + z], axis=-1).reshape(-1, 3)  # fmt: skip
        if corners[:, 2].min() < 0.5:
            continue
        uv = corners[:, :2] / corners[:, 2:] * K[0, 0] + K[:2, 2]
        whole = np.array([uv[:, 0].min(), uv[:, 0].max(), uv[:, 1].min(), uv[:, 1].max()])
        inside = np.clip(whole, 0, [1241, 1241, 374, 374])
        if inside[0] >= inside[1] or inside[2] >= inside[3]:
            continue
        spans = [(b[1] - b[0]) * (b[3] - b[2]) for b in (inside, whole)]
        v, u = np.nonzero(shot.tracks == track + 1)
        left, right, top, bottom = (u.min(), u.max(), v.min(), v.max()) if len(u) else np.round(inside).astype(int)
        occupancy = len(u) / max((right - left) * (bottom - top), 1)
        moving = bool(np.abs(later.position_m[i] - moment.position_m[i]).max() > 1e-6)
        alpha = (yaw - np.arctan2(x, z) + np.pi) % (2 * np.pi) - np.pi
        box = f"{track} {left} {right} {top} {bottom} {len(u)} {1 - spans[0] / spans[1]:.7g} {occupancy:.7g} {moving}"
        pose = [alpha, width, height, length, *at, turn, 0, 0, x, y, z, yaw, 0, 0]
        rows.append((box, " ".join([str(track), *(f"{value:.7g}" for value in pose)])))
    return rows
