"""Changes to a training scene in OpenPCDet's order: objects of other scenes pasted in, a mirror, a turn, a scale."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Float32

from jaxsim.config import AugmentConfig
from jaxsim.detect.scenes import Scene, View

Array = np.ndarray


@dataclass(frozen=True)
class Cutout:
    """An object that can be pasted into other scenes."""

    box: Float32[Array, " 7"]
    points: Float32[Array, "n 4"]


def cutouts(scenes: Sequence[Scene], config: AugmentConfig) -> list[Cutout]:
    """All objects of the class with enough points and a level of difficulty (the ground-truth database)."""
    found = []
    for scene in scenes:
        for box, target, level in zip(scene.boxes, scene.target, scene.difficulty, strict=True):
            if target and level >= 0:
                points = scene.points[in_box(scene.points, box)]
                if len(points) >= config.min_points:
                    found.append(Cutout(box, points))
    return found


def in_box(points: Float[Array, "n c"], box: Float[Array, " 7"]) -> Bool[Array, " n"]:
    """Which points lie in a box, faces included."""
    off = points[:, :3] - box[:3]
    cos, sin = np.cos(box[6]), np.sin(box[6])
    along, aside = cos * off[:, 0] + sin * off[:, 1], cos * off[:, 1] - sin * off[:, 0]
    half = box[3:6] / 2
    return (np.abs(along) <= half[0]) & (np.abs(aside) <= half[1]) & (np.abs(off[:, 2]) <= half[2])


def collide(a: Float[Array, "n 7"], b: Float[Array, "m 7"]) -> Bool[Array, "n m"]:
    """Which boxes share area from above: no side of either parts them."""
    apart = np.zeros((len(a), len(b)), bool)
    for one, other, swapped in ((a, b, False), (b, a, True)):
        off = other[None, :, :2] - one[:, None, :2]
        turn = other[None, :, 6] - one[:, None, 6]
        cos, sin = np.cos(one[:, None, 6]), np.sin(one[:, None, 6])
        local = cos * off[..., 0] + sin * off[..., 1], cos * off[..., 1] - sin * off[..., 0]
        length, width = other[None, :, 3], other[None, :, 4]
        reach = (
            np.abs(np.cos(turn)) * length + np.abs(np.sin(turn)) * width,
            np.abs(np.sin(turn)) * length + np.abs(np.cos(turn)) * width,
        )
        parted = np.zeros((len(one), len(other)), bool)
        for axis in (0, 1):
            parted |= np.abs(local[axis]) >= (reach[axis] + one[:, None, 3 + axis]) / 2
        apart |= parted.T if swapped else parted
    return ~apart


def augment(scene: Scene, database: Sequence[Cutout], config: AugmentConfig, rng: np.random.Generator) -> Scene:
    """A changed copy of a scene. Labels and view are not changed: a training scene is not scored."""
    if config.sampled and database:
        scene = paste(scene, database, config, rng=rng)
    points, boxes = scene.points.copy(), scene.boxes.copy()
    if rng.random() < config.flip:
        points[:, 1] *= -1
        boxes[:, 1] *= -1
        boxes[:, 6] *= -1
    turn = np.float32(rng.uniform(-config.rotation_rad, config.rotation_rad))
    rotation = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]], np.float32)
    points[:, :2] = points[:, :2] @ rotation
    boxes[:, :2] = boxes[:, :2] @ rotation
    boxes[:, 6] += turn
    scale = np.float32(rng.uniform(*config.scaling))
    points[:, :3] *= scale
    boxes[:, :6] *= scale
    boxes[:, 6] -= 2 * np.pi * np.floor(boxes[:, 6] / (2 * np.pi) + 0.5)
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


def heights_on(ground: Float[Array, " 4"], boxes: Float[Array, "n 7"], view: View) -> Float32[Array, " n"]:
    """Height in `velo` of the road plane at the boxes."""
    middle = boxes[:, :3].astype(np.float64) @ view.rect_from_velo[:3, :3].T + view.rect_from_velo[:3, 3]
    a, b, c, d = ground
    middle[:, 1] = (-d - a * middle[:, 0] - c * middle[:, 2]) / b
    velo_from_rect = np.linalg.inv(view.rect_from_velo)
    return (middle @ velo_from_rect[2, :3] + velo_from_rect[2, 3]).astype(np.float32)
