"""Scenes to training batches. Batch k is a function of (seed, k) alone, so a resumed run takes up where it stopped.

A scene is changed in OpenPCDet's order: objects of other scenes pasted in, a mirror, a turn, a scale.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Float32

from jaxsim.config import AugmentConfig, VoxelConfig
from jaxsim.detect.scenes import Scene, View
from jaxsim.devices import check_batch
from jaxsim.geometry.boxes import wrapped_heading
from jaxsim.geometry.polar import pad_points

SceneBatch = dict[str, np.ndarray]
"""points (b, p, 4), valid (b, p), objects (b, g, 7), is_object (b, g), dropped_points (b)."""
TRIES = 100
ROOM_STEP = 16
"""Room for objects is a multiple of this, so that data sets that differ little share one compiled step."""


@dataclass(frozen=True)
class Cutout:
    """An object that can be pasted into other scenes."""

    box: Float32[np.ndarray, " 7"]
    points: Float32[np.ndarray, "n 4"]


class SceneBatches:
    """Shuffled epoch by epoch, augmented, with room for the same number of points and objects in every batch.

    Of several processes each takes one of `parts` equal parts of every batch. Raises ValueError where there are fewer
    scenes than a batch, where it cannot be divided, and where no scene holds an object.
    """

    def __init__(
        self,
        scenes: Sequence[Scene],
        voxels: VoxelConfig,
        augmentation: AugmentConfig,
        *,
        size: int,
        seed: int,
        part: int = 0,
        parts: int = 1,
    ):
        check_batch(len(scenes), size, parts, what="scenes")
        self.scenes = scenes
        self.voxels = voxels
        self.augmentation = augmentation
        self.size, self.seed = size, seed
        self.part, self.parts = part, parts
        targets = [int(scene.target.sum()) for scene in scenes]
        if not any(targets):
            raise ValueError("batches: no training scene holds an object of the class; other --data.train, or labels?")
        self.database = cutouts(scenes, augmentation) if augmentation.sampled else []
        # The fullest scene, and all that may be pasted into it.
        most = max(targets) + min(augmentation.sampled, len(self.database))
        self.room = -(-most // ROOM_STEP) * ROOM_STEP

    @property
    def steps_per_epoch(self) -> int:
        """Whole batches of an epoch."""
        return len(self.scenes) // self.size

    def __getitem__(self, k: int) -> SceneBatch:
        share = self.size // self.parts
        places = range(k * self.size + self.part * share, k * self.size + (self.part + 1) * share)
        items = [self._item(position) for position in places]
        return {name: np.stack([item[name] for item in items]) for name in items[0]}

    def _item(self, position: int) -> SceneBatch:
        """The scene at a place of the endless sequence; one that lost all its objects gives way to another, drawn."""
        n = len(self.scenes)
        # One permutation an epoch, and a generator a place: no state runs from batch to batch.
        order = np.random.default_rng([self.seed, 0, position // n]).permutation(n)
        rng = np.random.default_rng([self.seed, 1, position])
        i = int(order[position % n])
        for _ in range(TRIES):
            scene = augment_scene(self.scenes[i], self.database, self.augmentation, rng=rng)
            objects = scene.boxes[scene.target & inside(scene.boxes, self.voxels)]
            if len(objects):
                return pad_scene(scene.points, objects, self.voxels, room=self.room, rng=rng)
            i = int(rng.integers(n))
        raise ValueError(
            f"batches: {TRIES} scenes in a row had no object inside the range {self.voxels.range_m}; widen "
            "--voxels.range-m"
        )


def inside(boxes: Float[np.ndarray, "n 7"], voxels: VoxelConfig) -> Bool[np.ndarray, " n"]:
    """Which boxes have their middle inside the range."""
    low, high = np.array(voxels.range_m[:3]), np.array(voxels.range_m[3:])
    return np.asarray(((boxes[:, :3] >= low) & (boxes[:, :3] <= high)).all(axis=1))


def in_range(points: Float[np.ndarray, "n c"], voxels: VoxelConfig) -> Bool[np.ndarray, " n"]:
    """Which points lie inside the range along x and y."""
    low, high = np.array(voxels.range_m[:2]), np.array(voxels.range_m[3:5])
    return np.asarray(((points[:, :2] >= low) & (points[:, :2] <= high)).all(axis=1))


def pad_scene(
    points: Float[np.ndarray, "n 4"],
    objects: Float[np.ndarray, "g 7"],
    voxels: VoxelConfig,
    *,
    room: int,
    rng: np.random.Generator,
) -> SceneBatch:
    """Points inside the range in random order, and the objects, each with a mask."""
    points = points[in_range(points, voxels)]
    # In random order, the cap takes a fair sample, and voxels are opened all over the scene.
    sample = rng.permutation(points)[: voxels.max_points]
    padded, valid = pad_points(sample, voxels.max_points)
    boxes, is_object = pad_points(objects, room)
    return {
        "points": padded,
        "valid": valid,
        "objects": boxes,
        "is_object": is_object,
        "dropped_points": np.array(len(points) - len(sample), np.int32),
    }


def cutouts(scenes: Sequence[Scene], config: AugmentConfig) -> list[Cutout]:
    """All objects of the class with enough points and a difficulty (the ground-truth database)."""
    cutouts_found = []
    for scene in scenes:
        for box, target, difficulty in zip(scene.boxes, scene.target, scene.difficulty, strict=True):
            if target and difficulty >= 0:
                points = scene.points[in_box(scene.points, box)]
                if len(points) >= config.min_points:
                    cutouts_found.append(Cutout(box, points))
    return cutouts_found


def in_box(points: Float[np.ndarray, "n c"], box: Float[np.ndarray, " 7"]) -> Bool[np.ndarray, " n"]:
    """Which points lie in a box, faces included."""
    off = points[:, :3] - box[:3]
    cos, sin = np.cos(box[6]), np.sin(box[6])
    # Turned into the box's own axes, a face is a bound.
    along, aside = cos * off[:, 0] + sin * off[:, 1], cos * off[:, 1] - sin * off[:, 0]
    half = box[3:6] / 2
    return (np.abs(along) <= half[0]) & (np.abs(aside) <= half[1]) & (np.abs(off[:, 2]) <= half[2])


def collide(a: Float[np.ndarray, "n 7"], b: Float[np.ndarray, "m 7"]) -> Bool[np.ndarray, "n m"]:
    """Which boxes share area from above: no side of either parts them."""
    return ~(_parted(a, b) | _parted(b, a).T)


def _parted(a: Float[np.ndarray, "n 7"], b: Float[np.ndarray, "m 7"]) -> Bool[np.ndarray, "n m"]:
    """Whether a line along a side of `a` lies between the two."""
    off = b[None, :, :2] - a[:, None, :2]
    cos, sin = np.cos(a[:, None, 6]), np.sin(a[:, None, 6])
    along, aside = cos * off[..., 0] + sin * off[..., 1], cos * off[..., 1] - sin * off[..., 0]
    # Half the extent of `b` along the sides of `a`: |cos| l / 2 + |sin| w / 2, and the other way round.
    turn = b[None, :, 6] - a[:, None, 6]
    cos, sin = np.abs(np.cos(turn)), np.abs(np.sin(turn))
    length, width = b[None, :, 3], b[None, :, 4]
    ahead = np.abs(along) >= (cos * length + sin * width + a[:, None, 3]) / 2
    return ahead | (np.abs(aside) >= (sin * length + cos * width + a[:, None, 4]) / 2)


def augment_scene(
    scene: Scene, database: Sequence[Cutout], config: AugmentConfig, *, rng: np.random.Generator
) -> Scene:
    """A changed copy of a scene. Labels and view are not changed: a training scene is not scored."""
    if config.sampled and database:
        scene = paste(scene, database, config, rng=rng)
    points, boxes = scene.points.copy(), scene.boxes.copy()
    if rng.random() < config.flip:
        points[:, 1] *= -1
        boxes[:, 1] *= -1
        boxes[:, 6] *= -1
    # Points and boxes are rows, so that this is the transpose of the rotation that turns columns.
    turn = np.float32(rng.uniform(-config.rotation_rad, config.rotation_rad))
    rotation = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]], np.float32)
    points[:, :2] = points[:, :2] @ rotation
    boxes[:, :2] = boxes[:, :2] @ rotation
    boxes[:, 6] += turn
    scale = np.float32(rng.uniform(*config.scaling))
    points[:, :3] *= scale
    boxes[:, :6] *= scale
    boxes[:, 6] = wrapped_heading(boxes[:, 6])
    return replace(scene, points=points, boxes=boxes)


def paste(scene: Scene, database: Sequence[Cutout], config: AugmentConfig, *, rng: np.random.Generator) -> Scene:
    """The scene with objects of others: as many are drawn, whatever it holds already, and those that would collide
    with an object of the scene or with each other are left out. Points inside them give way.

    Raises ValueError where they are to stand on a road plane that is not known.
    """
    drawn = rng.choice(len(database), min(config.sampled, len(database)), replace=False)
    chosen = [database[i] for i in drawn]
    boxes = np.stack([cutout.box for cutout in chosen])
    with_each_other = collide(boxes, boxes)
    np.fill_diagonal(with_each_other, False)
    free = np.asarray(~(with_each_other.any(axis=1) | collide(boxes, scene.boxes).any(axis=1)))
    boxes, chosen = boxes[free], [cutout for cutout, fits in zip(chosen, free, strict=True) if fits]
    lift = np.zeros(len(boxes), np.float32)
    if config.on_ground:
        if scene.ground is None:
            raise ValueError(
                f"augment: {scene.name} has no road plane; put planes/NNNNNN.txt beside label_2/, or pass "
                "--augment.no-on-ground"
            )
        # Up to where the box's bottom face stands on the road.
        lift = heights_on(scene.ground, boxes, scene.view) - (boxes[:, 2] - boxes[:, 5] / 2)
        boxes = boxes + lift[:, None] * np.array([0, 0, 1, 0, 0, 0, 0], np.float32)
    points = scene.points
    for box in boxes:
        points = points[~in_box(points, box)]
    moved = [cutout.points + np.array([0, 0, up, 0], np.float32) for cutout, up in zip(chosen, lift, strict=True)]
    return replace(
        scene,
        points=np.concatenate([*moved, points]),
        boxes=np.concatenate([scene.boxes, boxes]),
        target=np.concatenate([scene.target, np.ones(len(boxes), bool)]),
        difficulty=np.concatenate([scene.difficulty, np.zeros(len(boxes), int)]),
    )


def heights_on(
    ground: Float[np.ndarray, " 4"], boxes: Float[np.ndarray, "n 7"], view: View
) -> Float32[np.ndarray, " n"]:
    """Height in `velo` of the road plane at the boxes."""
    middle = boxes[:, :3].astype(np.float64) @ view.rect_from_velo[:3, :3].T + view.rect_from_velo[:3, 3]
    a, b, c, d = ground  # a x + b y + c z + d = 0 in the labels' frame, whose y points down
    middle[:, 1] = (-d - a * middle[:, 0] - c * middle[:, 2]) / b
    velo_from_rect = np.linalg.inv(view.rect_from_velo)
    return (middle @ velo_from_rect[2, :3] + velo_from_rect[2, 3]).astype(np.float32)
