"""Depth completion: PENet and its three stages."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from jaxsim.config.data import DataConfig, RunConfig
from jaxsim.config.ranges import Checked, Count, Decay, NotNegative, Positive, Share, Whole

Part = Literal["branches", "refinement", "joint"]
Norms = Literal["batch", "renorm", "stored"]


@dataclass(frozen=True)
class Stage(Checked):
    """One part of the training."""

    part: Part
    """`branches`: ENet alone. `refinement`: DA-CSPN++, the branches' parameters as they are. `joint`: all."""
    epochs: Whole
    batch: Count
    crop: tuple[Count, Count]
    """Rows and columns of the random crop; multiples of 32."""
    falls: tuple[tuple[Whole, Share], ...]
    """From which epoch on the rate is which share of the first one."""
    norms: Norms = "batch"
    """What batch norms divide by: the batch's statistics, as published, where batches are large; `renorm` where they
    are a few small crops (`layers.BatchNorm`); `stored` as they are, when what is left to learn is fine."""


BRANCH_FALLS = ((10, 0.5), (15, 0.1), (25, 0.01))
JOINT_FALLS = ((10, 0.5), (20, 0.1), (30, 0.01), (40, 0.0005), (50, 0.00001))
PUBLISHED_STAGES = (
    Stage("branches", 30, 6, (320, 1216), BRANCH_FALLS),
    Stage("refinement", 30, 6, (320, 1216), BRANCH_FALLS),
    Stage("joint", 60, 10, (160, 576), JOINT_FALLS),
)


@dataclass(frozen=True)
class PenetConfig(Checked):
    """Network and optimiser."""

    width: Count = 32
    """Channels of the first layer; the published network's 32 make 131.9 million parameters."""
    stages: tuple[Stage, ...] = PUBLISHED_STAGES
    lr: Positive = 1e-3
    backbone_lr: NotNegative = 0.1
    """Share of the rate that the branches get in the joint stage."""
    loss: Literal["square", "huber"] = "square"
    """Squared error, as published, or Huber's with 1 m: squared below, linear beyond. In a short training far edges,
    tens of metres off, rule the squared error, and what is near is learned last."""
    start_m: NotNegative = 0.0
    """Both branches begin with depths of this mean and standard deviation. The published ones begin at 0 and 1 m, from
    where a rate of 1e-3 takes thousands of updates to a street's depths: too many for a small training. Where it began
    with too small a deviation, a small training knew what is far and took all of it for 20 to 30 m."""
    weight_decay: NotNegative = 1e-6
    betas: tuple[Decay, Decay] = (0.9, 0.99)
    flip: bool = True
    jitter: NotNegative = 0.1
    """Brightness, contrast and saturation change at random by up to this share."""


@dataclass(frozen=True)
class DepthExperiment(Checked):
    """One training of a depth completion network."""

    data: DataConfig = field(default_factory=DataConfig)
    depth_root: Path | None = None
    """KITTI's depth completion set: the folder that holds `train/` and `val/`; `data.root` is then that of the raw
    drives, for their images. None: the frames of `data`, which must come with true depth (renderers)."""
    depth_validation: Path | None = None
    """Judged by instead of `val/`: `val_selection_cropped`, the 1000 selected images by which the published program
    judges (`--val select`)."""
    image_crop: tuple[Count, Count] = (352, 1216)
    """Rows and columns of the image that are used: bottom and middle."""
    penet: PenetConfig = field(default_factory=PenetConfig)
    run: RunConfig = field(default_factory=RunConfig)
