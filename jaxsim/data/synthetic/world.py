"""The embedded world as a data set: endless drives through procedural streets, with KITTI's labels of the things in
view.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache, partial

import jax
import numpy as np
from jaxtyping import Float, Int

from jaxsim.data.select import frame_number
from jaxsim.data.synthetic.layout import STATISTICS, Drive, lay_out
from jaxsim.data.synthetic.light import map_borders
from jaxsim.data.synthetic.raycast import TileSolids
from jaxsim.data.synthetic.render import (
    CAMERA_TILE,
    COVER_CELLS,
    COVER_TILE,
    LIDAR_TILE,
    SHADOW_CELLS,
    SHADOW_TILE,
    CameraView,
    LitScene,
    cast_shadows,
    look,
    photograph,
    scan,
)
from jaxsim.data.synthetic.solids import Thing, along_street, in_world, poses_at
from jaxsim.data.synthetic.tiles import in_raster, pinhole_mask, polar_mask, slanted_mask, solids_by_tile
from jaxsim.data.synthetic.true_sensor import TrueSensor, Truth, beam_gain, measure, report
from jaxsim.devices import side_by_side
from jaxsim.frame import Array, Boxes, Camera, CameraFrame, Cloud, Frame, PolarImage
from jaxsim.geometry import LidarSpec, camera_from_projection, directions, full_grid, preset

FRAMES_PER_DRIVE = 4
FRAME_S = 0.1
PITCH_RAD = 0.004
KITTI_SIZE = (375, 1242)
# Camera 2 of KITTI's car on 2011_09_26, rectified, and its place on the LiDAR.
_PROJECTION = np.array(
    [
        [721.5377, 0.0, 609.5593, 44.85728],
        [0.0, 721.5377, 172.854, 0.2163791],
        [0.0, 0.0, 1.0, 0.002745884],
    ]
)
_RECTIFY = np.array(
    [
        [0.9999239, 0.00983776, -0.007445048],
        [-0.009869795, 0.9999421, -0.004278459],
        [0.007402527, 0.004351614, 0.9999631],
    ]
)
_CAM_FROM_VELO = np.array(
    [
        [0.007533745, -0.9999714, -0.000616602, -0.004069766],
        [0.01480249, 0.0007280733, -0.9998902, -0.07631618],
        [0.9998621, 0.00752379, 0.01480755, -0.2717806],
        [0.0, 0.0, 0.0, 1.0],
    ]
)
MIN_PIXELS = 30
SIGHT_M = 90.0
# Share of the box's outline in the image that the thing itself fills when nothing hides it.
_FILL = {"Car": 0.80, "Van": 0.86, "Truck": 0.88, "Pedestrian": 0.50, "Cyclist": 0.42}


@dataclass(frozen=True)
class _Moment:
    """A scene at one time, and where the car is in it."""

    drive: Drive
    scene: LitScene
    corners: Float[np.ndarray, "solids 8 3"]
    position_m: Float[np.ndarray, "things 3"]
    heading_rad: Float[np.ndarray, " things"]
    velo_pose: Float[np.ndarray, "4 4"]


class SyntheticWorld:
    """Frames of an HDL-64E-like sensor and KITTI's camera 2 in made-up streets.

    Four frames, 0.1 s apart, make a drive through one street, which is a scene. Frame i depends on (seed, i) alone.
    `streets` names their traffic (STATISTICS). Semantic ids are Cityscapes'; `image_size` scales the camera's focal
    length, so that the view stays. Another `camera` of that size may stand elsewhere: in the LiDAR's place
    (`camera_at_lidar`) nothing that it sees is hidden.
    """

    def __init__(
        self,
        seed: int = 0,
        spec: LidarSpec | None = None,
        columns: int = 1024,
        *,
        image_size: tuple[int, int] = KITTI_SIZE,
        camera: Camera | None = None,
        streets: str = "town",
    ):
        if streets not in STATISTICS:
            raise ValueError(f"synthetic world: no streets {streets!r}; there are {', '.join(STATISTICS)}")
        self.name = "synthetic"
        self.seed, self.columns = seed, columns
        self.image_size, self.streets = image_size, streets
        self.spec = spec or preset("hdl64e")
        self.sensor = TrueSensor()
        self.grid = full_grid(self.spec, columns)
        self.camera = camera or kitti_camera(image_size)

    def __len__(self) -> int:
        return 1_000_000

    def __getitem__(self, index: int) -> Frame:
        """Renders frame `index`. Raises IndexError and TypeError as `frame_number`."""
        index = frame_number(index, self.name, len(self))
        moment = self._moment(index)
        view, image = side_by_side(
            lambda: self._view(moment),
            lambda: self.measure(index, self._truth(moment)),
        )
        return Frame(
            name=self.name_of(index),
            scene=f"synthetic-{self.seed}-drive-{index // FRAMES_PER_DRIVE:05d}",
            camera=CameraFrame(
                rgb=np.asarray(photograph(view.light, self._key(index, 0))),
                camera=self.camera,
                depth_m=np.where(view.valid, view.depth_m, np.float32(0.0)),
                depth_valid=view.valid,
                semantic=view.semantic,
                instance=view.instance,
            ),
            cloud=cloud_of(image, self.spec, self.columns),
            time_s=FRAME_S * (index % FRAMES_PER_DRIVE),
            speed_mps=float(moment.drive.ego_speed_mps),
            heading_rad=float(np.arctan2(moment.velo_pose[1, 0], moment.velo_pose[0, 0])),
            boxes=self._boxes(moment, view.instance),
        )

    def name_of(self, index: int) -> str:
        """The world's seed and the frame's number."""
        return f"synthetic-{self.seed}-{frame_number(index, self.name, len(self)):06d}"

    def truth(self, index: int) -> Truth:
        """What the LiDAR's rays of frame `index` meet, and what the sensor would report without noise or loss."""
        return self._truth(self._moment(frame_number(index, self.name, len(self))))

    def measure(self, index: int, truth: Truth, *, repeat: int = 0) -> PolarImage:
        """The sensor's noisy report; `repeat` 0 is the frame's own, others are further measurements of the moment."""
        return jax.device_get(measure(truth, self._key(index, 1 + repeat), sensor=self.sensor, spec=self.spec))

    def _key(self, index: int, use: int) -> Array:
        return jax.random.fold_in(jax.random.fold_in(jax.random.key(self.seed), index), use)

    def _moment(self, index: int) -> _Moment:
        drive = _drive(self.seed, index // FRAMES_PER_DRIVE, self.streets)
        time_s = FRAME_S * (index % FRAMES_PER_DRIVE)
        curvature = float(drive.street.curvature)
        position, heading = poses_at(drive.things, curvature, time_s)
        # A labelled thing's number + 1; houses and trees have none.
        instance = np.array([i + 1 if thing.kind else 0 for i, thing in enumerate(drive.things)], np.int64)
        solids, corners = in_world(drive.parts, position, heading, instance=instance)
        spot, turn = along_street(curvature, np.array([drive.ego_speed_mps * time_s]), np.array([drive.ego_aside_m]))
        # By the frame's number alone: frames may be rendered in any order, by any process.
        pitch, roll, yaw = np.random.default_rng([self.seed, index, 1]).normal(0.0, PITCH_RAD, 3)
        pose = np.eye(4)
        pose[:3, :3] = _rotation(2, turn[0] + yaw) @ _rotation(1, pitch) @ _rotation(0, 0.5 * roll)
        pose[:3, 3] = (*spot[0], self.spec.mount_m)
        scene = LitScene(solids, drive.street, drive.light)
        return _Moment(drive, scene, corners, position, heading, pose)

    def _truth(self, moment: _Moment) -> Truth:
        # Which solids a tile of rays can meet is told by their boxes' corners, before any ray is cast.
        corners = _into(moment.velo_pose, moment.corners)
        listed = solids_by_tile(polar_mask(corners, self.grid, LIDAR_TILE), moment.drive.parts.counts)
        pose = moment.velo_pose.astype(np.float32)
        met = scan(moment.scene, self.grid, velo_pose=pose, candidates=listed)
        gain = beam_gain(self.sensor, self.spec.rows)
        return jax.device_get(report(met, gain, sensor=self.sensor, spec=self.spec))

    def _view(self, moment: _Moment) -> CameraView:
        counts, corners = moment.drive.parts.counts, moment.corners
        eye = moment.velo_pose[:2, 3]
        sun = np.asarray(moment.drive.light.sun, np.float64)
        shadows = cast_shadows(
            moment.scene.solids,
            sun.astype(np.float32),
            eye.astype(np.float32),
            sunward=_ground_candidates(corners, counts, sun, eye=eye, cells=SHADOW_CELLS, tile=SHADOW_TILE),
            upward=_ground_candidates(
                corners, counts, np.array([0.0, 0.0, 1.0]), eye=eye, cells=COVER_CELLS, tile=COVER_TILE
            ),
        )
        # The camera is bolted to the LiDAR: one calibration for all frames.
        cam_pose = moment.velo_pose @ np.linalg.inv(self.camera.cam_from_velo.astype(np.float64))
        height, width = self.image_size
        u = np.arange(0, width + CAMERA_TILE[1], CAMERA_TILE[1]) - 0.5
        v = np.arange(0, height + CAMERA_TILE[0], CAMERA_TILE[0]) - 0.5
        mask = pinhole_mask(_into(cam_pose, corners), self.camera.intrinsics, u_px=u, v_px=v)
        halves = _halves(solids_by_tile(mask, counts))

        def see(listed: TileSolids) -> CameraView:
            return jax.device_get(
                look(
                    moment.scene,
                    shadows,
                    self.camera.intrinsics,
                    cam_pose=cam_pose.astype(np.float32),
                    candidates=listed,
                    width=width,
                )
            )

        # A chain of small programs keeps no more than one core busy.
        seen = side_by_side(partial(see, halves[0]), partial(see, halves[1]))
        tiles = np.concatenate([half.tile for half in halves])
        return jax.tree.map(lambda *rows: in_raster(rows, tiles, tile=CAMERA_TILE, size=self.image_size), *seen)

    def _boxes(self, moment: _Moment, instance: Int[np.ndarray, "h w"]) -> Boxes:
        cam_from_world = self.camera.cam_from_velo.astype(np.float64) @ np.linalg.inv(moment.velo_pose)
        return label_boxes(
            moment.drive.things,
            moment.position_m,
            moment.heading_rad,
            cam_from_world=cam_from_world,
            intrinsics=self.camera.intrinsics.astype(np.float64),
            instance=instance,
        )


@lru_cache(maxsize=4)
def _drive(seed: int, drive: int, streets: str) -> Drive:
    return lay_out(seed, drive, streets)


def kitti_camera(image_size: tuple[int, int] = KITTI_SIZE) -> Camera:
    """KITTI's rectified camera 2, its focal lengths and centre scaled to an image of that size (rows, columns)."""
    projection = _PROJECTION.copy()
    for axis, (now, then) in enumerate(zip(image_size[::-1], KITTI_SIZE[::-1], strict=True)):
        # Pixel centres lie at whole numbers, the image's corner at -1/2.
        projection[axis] *= now / then
        projection[axis, 2] += 0.5 * (now / then) - 0.5
    rectify = np.eye(4)
    rectify[:3, :3] = _RECTIFY
    return camera_from_projection(projection, rectify @ _CAM_FROM_VELO)


def cloud_of(image: PolarImage, spec: LidarSpec, columns: int) -> Cloud:
    """Valid returns in the order of KITTI's files: line by line, each from straight ahead counter-clockwise; host."""
    grid = full_grid(spec, columns)
    # Columns fall in azimuth; counter-clockwise from ahead is leftwards from the middle, then on from the right end.
    order = np.roll(np.arange(columns)[::-1], -(columns // 2))
    valid = np.asarray(image.valid)[:, order]
    row, _ = np.nonzero(valid)
    # In the grid's own directions: a point lies exactly on its ray, as it does in a driver's cloud.
    rays = np.asarray(directions(grid))[:, order][valid]
    xyz = np.asarray(image.range_m)[:, order][valid][:, None] * rays
    xyz[:, 2] += np.asarray(grid.origin_m)[row]
    intensity = np.asarray(image.intensity)[:, order][valid]
    return Cloud(xyz, intensity, np.ones(len(row), bool), row.astype(np.int32))


def _halves(listed: TileSolids) -> list[TileSolids]:
    """Every other tile, so that both have about as much to meet; where their number is odd one is in both."""
    count = len(listed.tile)
    rows = np.arange(count + count % 2) % count
    return [jax.tree.map(lambda leaf, half=half: leaf[half], listed) for half in (rows[::2], rows[1::2])]


def _rotation(axis: int, angle_rad: float) -> Float[np.ndarray, "3 3"]:
    i, j = (axis + 1) % 3, (axis + 2) % 3
    out = np.eye(3)
    out[i, i] = out[j, j] = np.cos(angle_rad)
    out[j, i], out[i, j] = np.sin(angle_rad), -np.sin(angle_rad)
    return out


def _into(world_from_frame: Float[np.ndarray, "4 4"], corners: Float[np.ndarray, "n 8 3"]):
    """Corners in the frame whose pose is given."""
    return (corners - world_from_frame[:3, 3]) @ world_from_frame[:3, :3]


def _ground_candidates(corners, counts, towards, *, eye, cells: tuple[int, int], tile: tuple[int, int]) -> TileSolids:
    x, y = map_borders(cells)
    mask = slanted_mask(corners, towards, x_m=x[:: tile[1]] + eye[0], y_m=y[:: tile[0]] + eye[1])
    return solids_by_tile(mask, counts)


def label_boxes(
    things: Sequence[Thing],
    position_m: Float[np.ndarray, "things 3"],
    heading_rad: Float[np.ndarray, " things"],
    *,
    cam_from_world: Float[np.ndarray, "4 4"],
    intrinsics: Float[np.ndarray, "3 3"],
    instance: Int[np.ndarray, "h w"],
) -> Boxes:
    """Boxes of the labelled things of which MIN_PIXELS or more are seen; a thing's instance is its number + 1.

    `occluded` compares the pixels seen with those that the thing would fill on its own: 0 above 70 %, 1 above 35 %.
    """
    h, w = instance.shape
    pixels = np.bincount(instance.ravel(), minlength=len(things) + 1)
    rows: list[tuple] = []
    for i, thing in enumerate(things):
        if not thing.kind or pixels[i + 1] < MIN_PIXELS:
            continue
        corners = _corners(thing.size_m, position_m[i], heading_rad[i]) @ cam_from_world[:3, :3].T
        corners = corners + cam_from_world[:3, 3]
        bottom = cam_from_world[:3, :3] @ position_m[i] + cam_from_world[:3, 3]
        if bottom[2] < 0.5 or bottom[2] > SIGHT_M:
            continue
        whole = _outline(corners, intrinsics)
        box = np.clip(whole, 0, [w - 1, h - 1, w - 1, h - 1])
        area, seen_area = _area(whole), _area(box)
        ahead = cam_from_world[:3, :3] @ [np.cos(heading_rad[i]), np.sin(heading_rad[i]), 0.0]
        share = pixels[i + 1] / max(_FILL[thing.kind] * seen_area, 1.0)
        hidden = 0 if share > 0.7 else 1 if share > 0.35 else 2
        # rotation_y is about y, which points down: 0 along x, -pi/2 straight ahead.
        yaw = float(np.arctan2(-ahead[2], ahead[0]))
        rows.append((bottom, thing.size_m, yaw, box, 1.0 - seen_area / max(area, 1e-6), hidden, thing.kind))
    columns = list(zip(*rows, strict=True)) or [()] * 7
    return Boxes(
        np.array(columns[0], np.float32).reshape(-1, 3),
        np.array(columns[1], np.float32).reshape(-1, 3),
        np.array(columns[2], np.float32),
        np.array(columns[3], np.float32).reshape(-1, 4),
        np.array(columns[4], np.float32),
        np.array(columns[5], np.int32),
        tuple(columns[6]),
    )


def _corners(size: tuple[float, float, float], at: np.ndarray, heading: float) -> Float[np.ndarray, "8 3"]:
    signs = np.array([[i >> 2 & 1, i >> 1 & 1, i & 1] for i in range(8)]) - [0.5, 0.5, 0.0]
    local = signs * size
    cos, sin = np.cos(heading), np.sin(heading)
    return local @ np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]]) + at


def _outline(corners_cam: Float[np.ndarray, "8 3"], intrinsics: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "4"]:
    """Left, top, right, bottom of the box's image; edges that pass behind the camera are cut just ahead of it."""
    near = 0.1
    points = [c for c in corners_cam if c[2] >= near]
    for i in range(8):
        for j in range(i):
            # Corners whose numbers differ in one bit share an edge.
            if (i ^ j).bit_count() == 1 and (corners_cam[i, 2] < near) != (corners_cam[j, 2] < near):
                a, b = corners_cam[i], corners_cam[j]
                points.append(a + (near - a[2]) / (b[2] - a[2]) * (b - a))
    image = np.array(points) @ intrinsics.T
    uv = image[:, :2] / image[:, 2:]
    return np.concatenate([uv.min(axis=0), uv.max(axis=0)])


def _area(box: Float[np.ndarray, "4"]) -> float:
    return float(max(box[2] - box[0], 0.0) * max(box[3] - box[1], 0.0))
