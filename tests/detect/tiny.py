"""A detector small enough for tests, and made-up scenes: cars as shells of points on a flat road."""

import numpy as np

from jaxsim.config import (
    AugmentConfig,
    BackboneConfig,
    DataConfig,
    DetectorConfig,
    DetectorExperiment,
    OneCycleConfig,
    ProposalConfig,
    RoiConfig,
    RunConfig,
    VoxelConfig,
)
from jaxsim.detect.batches import pad_scene
from jaxsim.detect.scenes import Scene, View
from jaxsim.frame import Boxes
from jaxsim.geometry.boxes import camera_boxes

VOXELS = VoxelConfig(
    range_m=(0, -12.8, -3, 25.6, 12.8, 1),
    size_m=(0.1, 0.1, 0.1),
    max_voxels_train=3000,
    max_voxels=3000,
    max_points=4096,
    growth=(2.5, 2.0, 1.0, 0.8),
)
NETWORK = DetectorConfig(
    backbone=BackboneConfig(widths=(8, 16, 16, 16), out=16, bev_layers=(1, 1), bev_widths=(32, 32), up_widths=(32, 32)),
    roi=RoiConfig(grid=4, width=8, samples=8, layers=(32, 32), dropout=0.0, rois=32),
    train_proposals=ProposalConfig(before=256, overlap=0.8, after=64),
    proposals=ProposalConfig(before=128, overlap=0.7, after=24),
    final=ProposalConfig(before=64, overlap=0.1, after=24),
)
EXPERIMENT = DetectorExperiment(
    data=DataConfig(),
    voxels=VOXELS,
    detector=NETWORK,
    augment=AugmentConfig(sampled=0, flip=0.0, rotation_rad=0.0, scaling=(1.0, 1.0)),
    optim=OneCycleConfig(lr=0.01, batch=2),
    run=RunConfig(),
)
ROAD_M = -1.73
RECT_FROM_VELO = np.array([[0, -1, 0, 0.0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1]])
VIEW = View(np.array([[800.0, 0, 1000], [0, 800, 300], [0, 0, 1]]), RECT_FROM_VELO, RECT_FROM_VELO, (600, 2000))


def car(rng, at, heading):
    """A car's box and points on its sides and roof."""
    size = np.array([3.9, 1.6, 1.5]) * rng.uniform(0.9, 1.1, 3)
    box = np.array([*at, ROAD_M + size[2] / 2, *size, heading])
    unit = rng.uniform(-0.5, 0.5, (160, 3))
    side = rng.integers(0, 5, 160)
    for k, (axis, value) in enumerate(((0, 0.49), (0, -0.49), (1, 0.49), (1, -0.49), (2, 0.49))):
        unit[side == k, axis] = value
    # The bonnet is low: a detector that ignores it cannot tell front from rear.
    unit[:, 2] = np.where((unit[:, 0] > 0.2) & (unit[:, 2] > 0), unit[:, 2] * 0.3, unit[:, 2])
    local = unit * size
    cos, sin = np.cos(heading), np.sin(heading)
    xyz = local @ np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]]) + box[:3]
    return box, np.column_stack([xyz, np.full(160, rng.uniform(0.2, 0.6))])


def scene(seed, cars=6):
    """Cars at random on a road, none nearer than 5 m to another."""
    rng = np.random.default_rng(seed)
    places: list = []
    while len(places) < cars:
        at = rng.uniform([6, -10.5], [23, 10.5])
        if all(np.hypot(*(at - other)) > 5 for other in places):
            places.append(at)
    made = [car(rng, at, rng.choice([0.0, np.pi / 2]) + rng.normal(0, 0.2)) for at in places]
    boxes = np.array([box for box, _ in made], np.float32)
    road = np.column_stack([rng.uniform([0, -12.8], [25.6, 12.8], (1500, 2)), rng.normal(ROAD_M, 0.01, 1500)])
    road = np.column_stack([road, rng.uniform(0.05, 0.15, len(road))])
    points = np.concatenate([road, *(p for _, p in made)]).astype(np.float32)
    centre, size, yaw = camera_boxes(boxes, RECT_FROM_VELO)
    pixels = np.tile(np.float32([100, 100, 200, 160]), (cars, 1))
    labels = Boxes(
        centre.astype(np.float32),
        size.astype(np.float32),
        yaw.astype(np.float32),
        pixels,
        np.zeros(cars, np.float32),
        np.zeros(cars, np.int32),
        ("Car",) * cars,
    )
    return Scene(f"{seed:06d}", points, boxes, np.ones(cars, bool), np.zeros(cars, int), VIEW, labels)


def scene_batch(seeds, voxels=VOXELS, room=8):
    """Scenes as one batch."""
    rng = np.random.default_rng(0)
    made = [scene(seed) for seed in seeds]
    items = [pad_scene(s.points, s.boxes, voxels, room=room, rng=rng) for s in made]
    return {name: np.stack([item[name] for item in items]) for name in items[0]}
