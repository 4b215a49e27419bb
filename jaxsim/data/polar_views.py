"""Polar frames as training data: what the LiDAR itself saw, looked at by a camera that was not there.

    jaxsim frames samples/LIDAR_TOP --out FOLDER      # or any other log: docs/bring-yours.md

A frame gives four views, ahead, to the left, back and to the right, each of 90 degrees, from the LiDAR's own place.
They have classes where the frames have them, and no image; depth is completed from the points.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import jax
import numpy as np

from jaxsim.data.point_labels import classes_in_image
from jaxsim.data.polar_frames import open_polar_frames, scene_of
from jaxsim.data.select import frame_number
from jaxsim.frame import Camera, CameraFrame, Cloud, Frame, PolarGrid
from jaxsim.geometry import LidarSpec, camera_at_lidar, polar_to_points, spans_turn, turned_points

DIRECTIONS_DEG = (0, 90, 180, 270)
WIDE_DEG = 90.0
LINE_PX = 5.0
"""Pixels between two lines of the sensor: completion of depth fills gaps of about that many."""
_FAR_M = 300.0


class PolarViews:
    """Views of a folder of polar frames. Position 4 k + i is direction i of frame k; a frame's scene is its own.

    Raises ValueError where the folder holds no polar frames, and where these do not look all round.
    """

    name = "polar"
    follows = False
    """The frame before one in the set is another view of the same moment."""

    def __init__(self, root: Path):
        try:
            self.frames = open_polar_frames(root)
        except ValueError as error:
            raise ValueError(
                f"polar: {error}. Make it of a log, nuScenes' for one (samples/LIDAR_TOP of a v1.0 archive): jaxsim "
                f"frames samples/LIDAR_TOP --out {root}"
            ) from error
        if not spans_turn(self.frames.grid):
            round_deg = np.rad2deg(np.ptp(self.frames.grid.azimuth_rad))
            raise ValueError(
                f"polar: frames of {root} look {round_deg:.0f} degrees round, and views of a quarter turn are cut out "
                "of whole ones; this sensor cannot be learned from without its camera"
            )
        self.spec = spec_of(self.frames.grid)
        self.camera, self.size = camera_of(self.spec)

    def __len__(self) -> int:
        return len(self.frames.names) * len(DIRECTIONS_DEG)

    def __getitem__(self, index: int) -> Frame:
        name, direction = self._place(frame_number(index, self.name, len(self)))
        image, rasters = self.frames.read(name)
        cloud = jax.tree.map(np.asarray, polar_to_points(image, self.frames.grid))
        valid = cloud.valid
        row = np.broadcast_to(np.arange(self.spec.rows, dtype=np.int32)[:, None], image.range_m.shape).ravel()
        xyz_m = turned_points(cloud.xyz_m[valid], -np.deg2rad(direction))
        view = CameraFrame(np.zeros((*self.size, 3), np.uint8), self.camera, has_image=False)
        if "semantic" in rasters:
            semantic = rasters["semantic"].ravel()[valid].astype(np.int32)
            instance = np.zeros(len(xyz_m), np.int32)
            if "instance" in rasters:
                instance = rasters["instance"].ravel()[valid].astype(np.int32)
            of_pixels = classes_in_image(xyz_m, semantic, instance, camera=self.camera, size=self.size)
            view = replace(view, semantic=of_pixels[0], instance=of_pixels[1])
        return Frame(
            name=self.name_of(index),
            scene=scene_of(name, self.frames),
            camera=view,
            cloud=Cloud(xyz_m, cloud.intensity[valid], np.ones(len(xyz_m), bool), row[valid]),
            time_s=self.frames.about.get(name, {}).get("time"),
        )

    def name_of(self, index: int) -> str:
        """The frame's name, and the direction in degrees to the left."""
        name, direction = self._place(index)
        return f"{name}-{direction:03d}"

    def files_of(self, index: int) -> list[Path]:
        """The polar frame's file. grid.json, which grows as frames are added, is in the beam table and `told_of`."""
        name, _ = self._place(index)
        return [self.frames.folder / f"{name}.npz"]

    def told_of(self, index: int) -> str:
        """The frame's scene, which grid.json says."""
        name, _ = self._place(index)
        return scene_of(name, self.frames)

    def _place(self, index: int) -> tuple[str, int]:
        frame, direction = divmod(index, len(DIRECTIONS_DEG))
        return self.frames.names[frame], DIRECTIONS_DEG[direction]


def spec_of(grid: PolarGrid) -> LidarSpec:
    """The sensor of polar frames that look all round."""
    return LidarSpec(
        name="polar frames",
        elevation_deg=tuple(float(e) for e in np.rad2deg(np.asarray(grid.elevation_rad, np.float64))),
        origin_m=tuple(float(h) for h in np.asarray(grid.origin_m)),
        columns=len(grid.azimuth_rad),
        min_range_m=0.0,
        max_range_m=_FAR_M,
    )


def camera_of(spec: LidarSpec) -> tuple[Camera, tuple[int, int]]:
    """A camera in the LiDAR's place that sees a quarter turn and all of its lines, and the size (h, w) of its images:
    neighbouring lines lie LINE_PX apart."""
    elevation = spec.elevation_rad
    focal = max(round(LINE_PX / np.tan(float(np.median(-np.diff(elevation)))) / 10) * 10, 10)
    half = np.deg2rad(WIDE_DEG / 2)
    # At the sides a line lies farther from the horizon than in the middle. 85 degrees up is as good as the zenith.
    reach = focal * np.tan(np.clip([elevation[0], -elevation[-1]], np.deg2rad(1), np.deg2rad(85))) / np.cos(half)
    above, below = (np.ceil(reach) + LINE_PX).astype(int)
    width = 2 * round(focal * np.tan(half))
    intrinsics = np.array([[focal, 0, (width - 1) / 2], [0, focal, above], [0, 0, 1]], np.float32)
    return camera_at_lidar(intrinsics), (int(above + below + 1), int(width))
