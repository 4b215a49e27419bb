"""The detector: Voxel R-CNN on voxels of a cloud."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from jaxsim.config.data import DataConfig, RunConfig


@dataclass(frozen=True)
class VoxelConfig:
    """From points to voxels; the defaults are KITTI's in OpenPCDet."""

    range_m: tuple[float, float, float, float, float, float] = (0.0, -40.0, -3.0, 70.4, 40.0, 1.0)
    """x, y, z from; x, y, z to."""
    size_m: tuple[float, float, float] = (0.05, 0.05, 0.1)
    points_per_voxel: int = 5
    """Points of a voxel that enter its mean: the first ones."""
    max_voxels_train: int = 16000
    max_voxels: int = 40000
    """Cap outside training. Voxels beyond a cap are left out, counted and reported."""
    max_points: int = 40960
    """Points of a training cloud; those beyond are left out, counted and reported."""
    growth: tuple[float, float, float, float] = (2.5, 2.0, 1.0, 1.0)
    """Places for sites after each of the four strided convolutions, as a multiple of the cap on voxels."""


@dataclass(frozen=True)
class BackboneConfig:
    """VoxelBackBone8x on sparse voxels, then BaseBEVBackbone on the map from above."""

    widths: tuple[int, int, int, int] = (16, 32, 64, 64)
    """Channels at strides 1, 2, 4, 8."""
    out: int = 128
    """Channels of the last sparse convolution, which halves the height once more."""
    bev_layers: tuple[int, ...] = (5, 5)
    """Convolutions of each block after its first."""
    bev_strides: tuple[int, ...] = (1, 2)
    bev_widths: tuple[int, ...] = (64, 128)
    up_strides: tuple[int, ...] = (1, 2)
    up_widths: tuple[int, ...] = (128, 128)


@dataclass(frozen=True)
class AnchorConfig:
    """Anchors of one class and who is assigned to them."""

    kind: str = "Car"
    """KITTI's name of the class; objects of any other are no targets."""
    size_m: tuple[float, float, float] = (3.9, 1.6, 1.56)
    """Length, width, height."""
    bottom_m: float = -1.78
    """Height of the bottom face in the LiDAR's frame."""
    yaws_rad: tuple[float, ...] = (0.0, 1.57)
    matched: float = 0.6
    """Overlap from above, headings snapped to the axes, from which an anchor is positive."""
    unmatched: float = 0.45
    """Overlap below which it is background."""


@dataclass(frozen=True)
class ProposalConfig:
    """Non-maximum suppression by rotated overlap from above."""

    before: int
    """Best boxes that are looked at."""
    overlap: float
    after: int
    """Boxes that are kept at most."""


@dataclass(frozen=True)
class RoiConfig:
    """The second stage: voxel RoI pooling, sampling of proposals, box refinement."""

    grid: int = 6
    """Grid points along each side of a proposal."""
    radii_m: tuple[float, float, float] = (0.4, 0.8, 1.6)
    """Of the voxel query at strides 2, 4, 8."""
    reach: int = 4
    """Voxels along each axis that a query looks at, both ways."""
    samples: int = 16
    """Voxels of a query that are used: the first ones."""
    width: int = 32
    """Channels of the pooled features of each stride."""
    layers: tuple[int, ...] = (256, 256)
    """Widths of the shared layers, and of those of either branch."""
    score_deviation: float = 0.01
    """Of the first weights behind the score. With few features a small one is soon overrun: the first steps know
    background alone, all weights turn negative, and every object ends with the same score."""
    dropout: float = 0.3
    rois: int = 128
    """Proposals of a training sample that are refined."""
    foreground: float = 0.5
    """Largest share of them that overlaps an object."""
    matched: float = 0.55
    """3D overlap from which a proposal is foreground, and beyond which its box is regressed."""
    score_range: tuple[float, float] = (0.25, 0.75)
    """3D overlaps at which the score to learn is 0 and 1."""
    easy: float = 0.1
    """3D overlap below which background is easy."""
    hard_share: float = 0.8
    """Share of hard background in the background."""


@dataclass(frozen=True)
class DetectorConfig:
    """Voxel R-CNN: the defaults are OpenPCDet's `voxel_rcnn_car.yaml`."""

    backbone: BackboneConfig = field(default_factory=BackboneConfig)
    anchors: AnchorConfig = field(default_factory=AnchorConfig)
    roi: RoiConfig = field(default_factory=RoiConfig)
    train_proposals: ProposalConfig = ProposalConfig(before=9000, overlap=0.8, after=512)
    proposals: ProposalConfig = ProposalConfig(before=2048, overlap=0.7, after=100)
    final: ProposalConfig = ProposalConfig(before=4096, overlap=0.1, after=500)
    score: float = 0.3
    """Detections below it are left out."""
    intensity_m: float = 1.0
    """What an intensity of 1 is to the first convolution, which also sums the points' x, y and z in metres. At the
    published 1 it is next to nothing, and a short training never sees it."""
    cls_weight: float = 1.0
    loc_weight: float = 2.0
    dir_weight: float = 0.2
    roi_cls_weight: float = 1.0
    roi_reg_weight: float = 1.0
    roi_corner_weight: float = 1.0


@dataclass(frozen=True)
class AugmentConfig:
    """Changes to a training scene, in this order."""

    sampled: int = 15
    """Objects of other scenes that are pasted in; those that would collide are not. 0: none."""
    min_points: int = 5
    """Of an object that is pasted."""
    on_ground: bool = False
    """Set pasted objects on the road plane of `planes/NNNNNN.txt` (published: yes, but the planes are no part of
    KITTI's download)."""
    flip: float = 0.5
    """Chance that left and right change sides."""
    rotation_rad: float = 0.78539816
    """Largest turn about the vertical, either way."""
    scaling: tuple[float, float] = (0.95, 1.05)


@dataclass(frozen=True)
class OneCycleConfig:
    """Adam with decoupled weight decay and one cycle of rate and momentum (OpenPCDet's `adam_onecycle`)."""

    lr: float = 0.01
    """Highest rate."""
    div_factor: float = 10.0
    """Of the first rate; the last is 1e-4 of the first."""
    pct_start: float = 0.4
    """Share of the steps in which the rate rises."""
    momenta: tuple[float, float] = (0.95, 0.85)
    """Adam's first beta at the ends and at the highest rate."""
    beta2: float = 0.99
    weight_decay: float = 0.01
    clip: float = 10.0
    """Largest norm of the gradient."""
    batch: int = 2
    """Scenes a step, over all devices."""
    epochs: int = 80


@dataclass(frozen=True)
class DetectorExperiment:
    """One experiment of the detector: data, voxels, network, augmentation, optimiser, run."""

    data: DataConfig = field(default_factory=DataConfig)
    in_image: bool = True
    """Only points that the camera sees, as published: KITTI labels nothing else."""
    scored: Literal["all", "inside"] = "all"
    """Labels that validation scores count: all, as in KITTI's evaluation, or only those inside the range of the voxels,
    for a range shorter than KITTI's; the others are then DontCare."""
    voxels: VoxelConfig = field(default_factory=VoxelConfig)
    detector: DetectorConfig = field(default_factory=DetectorConfig)
    augment: AugmentConfig = field(default_factory=AugmentConfig)
    optim: OneCycleConfig = field(default_factory=OneCycleConfig)
    run: RunConfig = field(default_factory=RunConfig)
