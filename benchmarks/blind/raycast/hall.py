"""A hall: racks with cartons, pillars, forklifts and people; the sensor is on a cart among them."""

from __future__ import annotations

import numpy as np

from benchmarks.blind.raycast.scenes import Scene

HEIGHT_M = (0.7, 1.4)
"""Of the sensor above the floor."""
SPEED_M_S = (0.3, 2.0)


def build_hall(rng: np.random.Generator) -> Scene:
    """A hall about the sensor, which stands over the origin, x along the aisle."""
    scene = Scene()
    length, width, height = rng.uniform(35, 80), rng.uniform(16, 34), rng.uniform(5.5, 10)
    x0, y0 = rng.uniform(-0.25, 0.25, 2) * [length, 0.3 * width]
    _shell(scene, (x0, y0), (length, width, height))
    aisle = rng.uniform(2.2, 3.5)
    for side in (-1, 1):
        y = side * (aisle + 0.6)
        x = x0 - length / 2 + rng.uniform(2, 6)
        while x < x0 + length / 2 - 6:
            if abs(y - y0) < width / 2 - 1:
                _rack(scene, rng, x, y, side, min(height - 1, rng.uniform(3, 6)))
            x += rng.choice([2.8, 2.8, 2.8, 7.0])
    for x in np.arange(x0 - length / 2 + 4, x0 + length / 2, rng.uniform(6, 10)):
        for y in (y0 - width / 2 + 1.2, y0 + width / 2 - 1.2):
            scene.cylinder("pillar", (x, y, 0), rng.uniform(0.15, 0.3), height)
    for _ in range(int(rng.integers(2, 6))):
        _person(scene, rng, rng.uniform(3, 18) * rng.choice([-1, 1]), rng.uniform(-aisle + 0.7, aisle - 0.7))
    for _ in range(int(rng.integers(1, 4))):
        _forklift(scene, rng, rng.uniform(5, 22) * rng.choice([-1, 1]), rng.uniform(-aisle + 1.2, aisle - 1.2))
    for _ in range(int(rng.integers(2, 7))):
        edge = rng.uniform(0.5, 1.1, 3)
        x, y = rng.uniform(2.5, 15) * rng.choice([-1, 1]), rng.uniform(-aisle + 0.6, aisle - 0.6)
        scene.box("carton", (x, y, edge[2] / 2), edge, yaw=rng.uniform(0, np.pi), thing=scene.new_thing())
    return scene


def _shell(scene: Scene, middle, size) -> None:
    (x, y), (length, width, height) = middle, size
    scene.box("floor", (x, y, -0.1), (length, width, 0.2))
    scene.box("sheeting", (x, y, height + 0.1), (length, width, 0.2))
    for side in (-1, 1):
        scene.box("plaster", (x, y + side * (width / 2 + 0.1), height / 2), (length, 0.2, height))
        scene.box("sheeting", (x + side * (length / 2 + 0.1), y, height / 2), (0.2, width, height))


def _rack(scene: Scene, rng: np.random.Generator, x: float, y: float, side: int, height: float) -> None:
    """A bay 2.7 m long: posts, shelves, and cartons on most places."""
    for dx in (-1.32, 1.32):
        for dy in (-0.5, 0.5):
            scene.box("rack", (x + dx, y + dy, height / 2), (0.08, 0.08, height))
    for level in np.arange(0.15, height, rng.uniform(1.3, 1.8)):
        scene.box("rack", (x, y, level), (2.7, 1.0, 0.08))
        for place in (-0.85, 0.0, 0.85):
            if rng.random() < 0.7:
                edge = rng.uniform(0.5, 0.85, 3)
                at = (x + place, y - side * rng.uniform(0, 0.2), level + 0.04 + edge[2] / 2)
                scene.box("carton", at, edge, yaw=rng.normal(0, 0.08), thing=scene.new_thing())


def _person(scene: Scene, rng: np.random.Generator, x: float, y: float) -> None:
    thing, tall = scene.new_thing(), rng.uniform(1.55, 1.9)
    for dy in (-0.1, 0.1):
        scene.cylinder("cloth", (x + rng.normal(0, 0.1), y + dy, 0), 0.08, 0.48 * tall, thing=thing)
    scene.boulder("cloth", (x, y, 0.67 * tall), (0.15, 0.24, 0.22 * tall), rough=0.02, rng=rng, thing=thing)
    scene.boulder("cloth", (x, y, 0.93 * tall), (0.1, 0.09, 0.12), rough=0.02, rng=rng, thing=thing)


def _forklift(scene: Scene, rng: np.random.Generator, x: float, y: float) -> None:
    thing, yaw = scene.new_thing(), rng.choice([0.0, np.pi]) + rng.normal(0, 0.15)
    ahead = np.array([np.cos(yaw), np.sin(yaw)])
    scene.box("forklift", (x, y, 0.6), (1.9, 1.1, 0.9), yaw=yaw, thing=thing)
    back = np.array([x, y]) - 0.4 * ahead
    for corner in (-0.45, 0.45):
        post = back + corner * np.array([-ahead[1], ahead[0]])
        scene.cylinder("forklift", (*post, 1.05), 0.04, 1.0, thing=thing)
    scene.box("forklift", (*back, 2.08), (1.1, 1.05, 0.06), yaw=yaw, thing=thing)
    mast = np.array([x, y]) + 1.0 * ahead
    scene.box("forklift", (*mast, 1.1), (0.12, 0.8, 2.1), yaw=yaw, thing=thing)
