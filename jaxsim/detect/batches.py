"""Scenes to training batches. Batch k is a function of (seed, k) alone, so a resumed run takes up where it stopped."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from jaxsim.config import AugmentConfig, VoxelConfig
from jaxsim.detect.augment import Cutout, augment, cutouts
from jaxsim.detect.scenes import Scene

Batch = dict[str, np.ndarray]
"""points (b, p, 4), valid (b, p), objects (b, g, 7), is_object (b, g), dropped_points (b)."""
TRIES = 100
ROOM_STEP = 16
"""Room for objects is a multiple of this, so that data sets that differ little share one compiled step."""


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
        if len(scenes) < size:
            raise ValueError(
                f"batches: {len(scenes)} training scenes cannot fill a batch of {size}; lower --optim.batch"
            )
        if size % parts:
            raise ValueError(f"batches: {size} scenes cannot be divided among {parts} processes; make it a multiple")
        self.scenes, self.voxels, self.augmentation = scenes, voxels, augmentation
        self.size, self.seed, self.part, self.parts = size, seed, part, parts
        targets = [int(scene.target.sum()) for scene in scenes]
        if not any(targets):
            raise ValueError("batches: no training scene holds an object of the class; other --data.train, or labels?")
        self.database: list[Cutout] = cutouts(scenes, augmentation) if augmentation.sampled else []
        most = max(targets) + min(augmentation.sampled, len(self.database))
        self.room = -(-most // ROOM_STEP) * ROOM_STEP

    @property
    def steps_per_epoch(self) -> int:
        return len(self.scenes) // self.size

    def __getitem__(self, k: int) -> Batch:
        share = self.size // self.parts
        places = range(k * self.size + self.part * share, k * self.size + (self.part + 1) * share)
        items = [self._item(place) for place in places]
        return {name: np.stack([item[name] for item in items]) for name in items[0]}

    def _item(self, place: int) -> Batch:
        """The scene at a place of the endless sequence; one that lost all its objects gives way to another, drawn."""
        n = len(self.scenes)
        order = np.random.default_rng([self.seed, 0, place // n]).permutation(n)
        rng = np.random.default_rng([self.seed, 1, place])
        i = int(order[place % n])
        for _ in range(TRIES):
            scene = augment(self.scenes[i], self.database, self.augmentation, rng)
            objects = scene.boxes[scene.target & inside(scene.boxes, self.voxels)]
            if len(objects):
                return pad_scene(scene.points, objects, self.voxels, room=self.room, rng=rng)
            i = int(rng.integers(n))
        raise ValueError(
            f"batches: {TRIES} scenes in a row had no object inside the range {self.voxels.range_m}; widen "
            "--voxels.range-m"
        )


def inside(boxes: np.ndarray, voxels: VoxelConfig) -> np.ndarray:
    """Which boxes have their middle inside the range."""
    low, high = np.array(voxels.range_m[:3]), np.array(voxels.range_m[3:])
    return np.asarray(((boxes[:, :3] >= low) & (boxes[:, :3] <= high)).all(axis=1))


def in_range(points: np.ndarray, voxels: VoxelConfig) -> np.ndarray:
    """Which points lie inside the range along x and y."""
    low, high = np.array(voxels.range_m[:2]), np.array(voxels.range_m[3:5])
    return np.asarray(((points[:, :2] >= low) & (points[:, :2] <= high)).all(axis=1))


def pad_scene(
    points: np.ndarray, objects: np.ndarray, voxels: VoxelConfig, *, room: int, rng: np.random.Generator
) -> Batch:
    """Points inside the range in random order, and the objects, each with a mask."""
    points = points[in_range(points, voxels)]
    kept = rng.permutation(points)[: voxels.max_points]
    padded, boxes = np.zeros((voxels.max_points, 4), np.float32), np.zeros((room, 7), np.float32)
    padded[: len(kept)], boxes[: len(objects)] = kept, objects
    return {
        "points": padded,
        "valid": np.arange(voxels.max_points) < len(kept),
        "objects": boxes,
        "is_object": np.arange(room) < len(objects),
        "dropped_points": np.array(len(points) - len(kept), np.int32),
    }
