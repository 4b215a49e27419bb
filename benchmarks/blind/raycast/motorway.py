"""A motorway: two carriageways of three lanes, barriers, slopes, gantries, trees, and traffic about the sensor."""

from __future__ import annotations

import numpy as np

from benchmarks.blind.raycast.scenes import Scene

HEIGHT_M = (1.6, 2.1)
"""Of the sensor above the road."""
SPEED_M_S = (18.0, 36.0)
LANES_M = (3.4, 7.1, 10.9)
"""Middles of the lanes from the median."""
HALF_M, LONG_M = 15.0, 200.0


def build_motorway(rng: np.random.Generator) -> Scene:
    """A straight stretch, x along the road; the median is y = 0, and the sensor drives in a lane at negative y."""
    scene = Scene()
    scene.slab(
        "asphalt", [(x, y, 0) for x, y in ((-LONG_M, -HALF_M), (LONG_M, -HALF_M), (LONG_M, HALF_M), (-LONG_M, HALF_M))]
    )
    scene.box("concrete", (0, 0, 0.45), (2 * LONG_M, 0.35, 0.9))
    for side in (-1, 1):
        _verge(scene, rng, side)
        _traffic(scene, rng, side)
    for x in np.arange(-150 + rng.uniform(0, 60), 150, rng.uniform(60, 110)):
        _gantry(scene, rng, x)
    if rng.random() < 0.4:
        x = rng.uniform(25, 90) * rng.choice([-1, 1])
        scene.box("concrete", (x, 0, 6.2), (9, 4 * HALF_M, 1.2))
        for side in (-1, 1):
            scene.box("concrete", (x, side * (HALF_M + 1.5), 2.8), (9, 1, 5.6))
    return scene


def lane_of(rng: np.random.Generator) -> float:
    """The sensor's place across the road (m)."""
    return -float(rng.choice(LANES_M)) + float(rng.normal(0, 0.2))


def _verge(scene: Scene, rng: np.random.Generator, side: int) -> None:
    edge, rise = side * HALF_M, rng.uniform(-1.5, 4)
    far = side * (HALF_M + 30)
    ends = [(-LONG_M, edge, 0), (LONG_M, edge, 0), (LONG_M, far, rise), (-LONG_M, far, rise)]
    scene.slab("grass", ends)
    scene.box("rail", (0, edge - side * 0.6, 0.65), (2 * LONG_M, 0.06, 0.3))
    for x in np.arange(-80, 80, 4.0):
        scene.box("rail", (x, edge - side * 0.5, 0.4), (0.08, 0.1, 0.8))
    if rng.random() < 0.45:
        scene.box("concrete", (0, edge + side * 2.5, 2.0), (2 * LONG_M, 0.25, rng.uniform(3.5, 5)))
        return
    for _ in range(int(rng.integers(25, 60))):
        x, away, tall = rng.uniform(-110, 110), rng.uniform(4, 26), rng.uniform(2, 9)
        y, ground = edge + side * away, rise * away / 30
        scene.cylinder("leaves", (x, y, ground - 0.5), 0.12, 0.6 * tall)
        radii = tall * rng.uniform(0.22, 0.4, 3)
        scene.boulder("leaves", (x, y, ground + 0.6 * tall), radii, rough=0.1, rng=rng)


def _traffic(scene: Scene, rng: np.random.Generator, side: int) -> None:
    for lane in LANES_M:
        x = -120 + rng.uniform(0, 25)
        while x < 120:
            if abs(x) > 11:
                _vehicle(scene, rng, x, side * lane + rng.normal(0, 0.2), heavy=lane > 10 and rng.random() < 0.5)
            x += rng.uniform(16, 60)


def _vehicle(scene: Scene, rng: np.random.Generator, x: float, y: float, *, heavy: bool) -> None:
    thing = scene.new_thing()
    if heavy:
        long = rng.uniform(8, 13)
        scene.box("tarpaulin", (x, y, 2.4), (long, 2.5, 2.8), thing=thing)
        scene.box("tarpaulin", (x + (long / 2 + 1.3) * -np.sign(y), y, 1.9), (2.2, 2.4, 2.6), thing=thing)
        for dx in (-0.35, 0.0, 0.35):
            scene.box("tarpaulin", (x + dx * long, y, 0.5), (1.0, 2.4, 0.9), thing=thing)
        return
    long, wide, tall = rng.uniform(3.9, 5.0), rng.uniform(1.7, 1.95), rng.uniform(1.4, 1.8)
    scene.box("lacquer", (x, y, 0.58), (long, wide, 0.75), thing=thing)
    scene.box("lacquer", (x - 0.1 * long, y, (0.95 + tall) / 2), (0.55 * long, 0.85 * wide, tall - 0.95), thing=thing)


def _gantry(scene: Scene, rng: np.random.Generator, x: float) -> None:
    for side in (-1, 1):
        scene.cylinder("gantry", (x, side * (HALF_M - 0.2), 0), 0.18, 6.5)
    scene.box("gantry", (x, 0, 6.4), (0.5, 2 * HALF_M, 0.5))
    for lane in LANES_M:
        side = rng.choice([-1, 1])
        scene.box("sign", (x, side * lane, 5.4), (0.1, 2.6, 1.6), thing=scene.new_thing())
