"""The detector: Voxel R-CNN on voxels of a cloud."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from jaxsim.config.data import DataConfig, RunConfig
from jaxsim.config.ranges import Checked, Count, NotNegative, Positive, Share, Whole


@dataclass(frozen=True)
class VoxelConfig(Checked):
    """From points to voxels; the defaults are KITTI's in OpenPCDet."""

    range_m: tuple[float, float, float, float, float, float] = (0.0, -40.0, -3.0, 70.4, 40.0, 1.0)
    """x, y, z from; x, y, z to."""
    size_m: tuple[Positive, Positive, Positive] = (0.05, 0.05, 0.1)
    points_per_voxel: Count = 5
    """Points of a voxel that enter its mean: the first ones."""
    max_voxels_train: Count = 16000
    max_voxels: Count = 40000
    """Cap outside training. Voxels beyond a cap are left out, counted and reported."""
    max_points: Count = 40960
    """Points of a training cloud; those beyond are left out, counted and reported."""
    growth: tuple[Positive, Positive, Positive, Positive] = (2.5, 2.0, 1.0, 1.0)
    """Places for sites after each of the four strided convolutions, as a multiple of the cap on voxels."""


@dataclass(frozen=True)
class BackboneConfig(Checked):
    """VoxelBackBone8x on sparse voxels, then BaseBEVBackbone on the map from above."""

    widths: tuple[Count, Count, Count, Count] = (16, 32, 64, 64)
    """Channels at strides 1, 2, 4, 8."""
    out: Count = 128
    """Channels of the last sparse convolution, which halves the height once more."""
    bev_layers: tuple[Whole, ...] = (5, 5)
    """Convolutions of each block after its first."""
    bev_strides: tuple[Count, ...] = (1, 2)
    bev_widths: tuple[Count, ...] = (64, 128)
    up_strides: tuple[Count, ...] = (1, 2)
    up_widths: tuple[Count, ...] = (128, 128)


@dataclass(frozen=True)
class AnchorConfig(Checked):
    """Anchors of one class and who is assigned to them."""

    kind: str = "Car"
    """KITTI's name of the class; objects of any other are no targets."""
    size_m: tuple[Positive, Positive, Positive] = (3.9, 1.6, 1.56)
    """Length, width, height."""
    bottom_m: float = -1.78
    """Height of the bottom face in the LiDAR's frame."""
    yaws_rad: tuple[float, ...] = (0.0, 1.57)
    matched: Share = 0.6
    """Overlap from above, headings snapped to the axes, from which an anchor is positive."""
    unmatched: Share = 0.45
    """Overlap below which it is background."""


@dataclass(frozen=True)
class ProposalConfig(Checked):
    """Non-maximum suppression by rotated overlap from above."""

    before: Count
    """Best boxes that are looked at."""
    overlap: Share
    after: Count
    """Boxes that are kept at most."""


@dataclass(frozen=True)
class RoiConfig(Checked):
    """The second stage: voxel RoI pooling, sampling of proposals, box refinement."""

    grid: Count = 6
    """Grid points along each side of a proposal."""
    radii_m: tuple[Positive, Positive, Positive] = (0.4, 0.8, 1.6)
    """Of the voxel query at strides 2, 4, 8."""
    reach: Count = 4
    """Voxels along each axis that a query looks at, both ways."""
    samples: Count = 16
    """Voxels of a query that are used: the first ones."""
    width: Count = 32
    """Channels of the pooled features of each stride."""
    layers: tuple[Count, ...] = (256, 256)
    """Widths of the shared layers, and of those of either branch."""
    score_deviation: NotNegative = 0.01
    """Of the first weights behind the score. With few features a small one is soon overrun: the first steps know
    background alone, all weights turn negative, and every object ends with the same score."""
    dropout: Share = 0.3
    rois: Count = 128
    """Proposals of a training sample that are refined."""
    foreground: Share = 0.5
    """Largest share of them that overlaps an object."""
    matched: Share = 0.55
    """3D overlap from which a proposal is foreground, and beyond which its box is regressed."""
    score_range: tuple[Share, Share] = (0.25, 0.75)
    """3D overlaps at which the score to learn is 0 and 1."""
    easy: Share = 0.1
    """3D overlap below which background is easy."""
    hard_share: Share = 0.8
    """Share of hard background in the background."""


@dataclass(frozen=True)
class DetectorConfig(Checked):
    """Voxel R-CNN: the defaults are OpenPCDet's `voxel_rcnn_car.yaml`."""

    backbone: BackboneConfig = field(default_factory=BackboneConfig)
    anchors: AnchorConfig = field(default_factory=AnchorConfig)
    roi: RoiConfig = field(default_factory=RoiConfig)
    train_proposals: ProposalConfig = ProposalConfig(before=9000, overlap=0.8, after=512)
    proposals: ProposalConfig = ProposalConfig(before=2048, overlap=0.7, after=100)
    final: ProposalConfig = ProposalConfig(before=4096, overlap=0.1, after=500)
    score: Share = 0.3
    """Detections below it are left out."""
    intensity_m: Positive = 1.0
    """What an intensity of 1 is to the first convolution, which also sums the points' x, y and z in metres. At the
    published 1 it is next to nothing, and a short training never sees it."""
    cls_weight: NotNegative = 1.0
    loc_weight: NotNegative = 2.0
    dir_weight: NotNegative = 0.2
    roi_cls_weight: NotNegative = 1.0
    roi_reg_weight: NotNegative = 1.0
    roi_corner_weight: NotNegative = 1.0


@dataclass(frozen=True)
class AugmentConfig(Checked):
    """Changes to a training scene, in this order."""

    sampled: Whole = 15
    """Objects of other scenes that are pasted in; those that would collide are not. 0: none."""
    min_points: Whole = 5
    """Of an object that is pasted."""
    on_ground: bool = False
    """Set pasted objects on the road plane of `planes/NNNNNN.txt` (published: yes, but the planes are no part of
    KITTI's download)."""
    flip: Share = 0.5
    """Chance that left and right change sides."""
    rotation_rad: NotNegative = 0.78539816
    """Largest turn about the vertical, either way."""
    scaling: tuple[Positive, Positive] = (0.95, 1.05)


@dataclass(frozen=True)
class OneCycleConfig(Checked):
    """Adam with decoupled weight decay and one cycle of rate and momentum (OpenPCDet's `adam_onecycle`)."""

    lr: Positive = 0.01
    """Highest rate."""
    div_factor: Positive = 10.0
    """Of the first rate; the last is 1e-4 of the first."""
    pct_start: Share = 0.4
    """Share of the steps in which the rate rises."""
    momenta: tuple[Share, Share] = (0.95, 0.85)
    """Adam's first beta at the ends and at the highest rate."""
    beta2: Share = 0.99
    weight_decay: NotNegative = 0.01
    clip: Positive = 10.0
    """Largest norm of the gradient."""
    batch: Count = 2
    """Scenes a step, over all devices."""
    epochs: Whole = 80
    """A resumed run may not change it: its rates depend on how long it is to learn."""


@dataclass(frozen=True)
class DetectorExperiment(Checked):
    """One experiment of the detector: data, voxels, network, augmentation, optimiser, run."""

    data: DataConfig = field(default_factory=DataConfig)
    in_image: bool = True
    """Only points that the camera sees, as published: KITTI labels nothing else."""
    scored: Literal["all", "inside"] = "all"
    """Labels that validation scores count: all, as in KITTI's evaluation, or only those inside the range of the voxels,
    for a range shorter than KITTI's; the others are then ignored, as KITTI ignores labels beyond a difficulty."""
    voxels: VoxelConfig = field(default_factory=VoxelConfig)
    detector: DetectorConfig = field(default_factory=DetectorConfig)
    augment: AugmentConfig = field(default_factory=AugmentConfig)
    optim: OneCycleConfig = field(default_factory=OneCycleConfig)
    run: RunConfig = field(default_factory=RunConfig)
