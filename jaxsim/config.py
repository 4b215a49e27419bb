"""Every stage's settings, as frozen dataclasses. No behaviour lives here.

An experiment (`configs/*.py`) is one `Experiment` value; every field below is a flag of `train.py`
(`--optim.lr 1e-4`). A run folder keeps the whole value as `config.json`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

DataKind = Literal["synthetic", "kitti_raw", "kitti_object", "kitti_tracking", "kitti_step", "vkitti2", "prepared"]
Form = Literal["imaginaire", "original"]
"""Whose pix2pixHD: NVlabs/imaginaire's, or NVIDIA/pix2pixHD's own."""
InputName = Literal["rgb", "depth", "semantic", "edges", "incidence", "range", "row"]


@dataclass(frozen=True)
class DataConfig:
    """Which frames to learn from."""

    kind: DataKind = "synthetic"
    """`synthetic` is the embedded world and needs no files; `prepared` is what `jaxsim prepare` made of another."""
    root: Path | None = None
    """Folder of the data set: the one that holds `2011_09_26/` (raw), `training/` (object, tracking, step), or
    `Scene01/` (vkitti2); the `--out` of `jaxsim prepare` (prepared)."""
    scenes: tuple[str, ...] = ()
    """Sequences of kitti_tracking and kitti_step to use, `0001 0018`, or scenes of vkitti2, `Scene01`. None named: all,
    and all must be there."""
    variations: tuple[str, ...] = ("clone",)
    """Of vkitti2: `clone`, `15-deg-left`, `fog` ..."""
    camera: Literal[0, 1] = 0
    """Of vkitti2: 0 left, 1 right."""
    lidar: Literal["kitti", "camera"] = "kitti"
    """Where the LiDAR is thought to be in vkitti2, and the camera in the embedded world: apart as on KITTI's car, or in
    one place, so that nothing that the camera sees is hidden from the LiDAR."""
    train: str = "0-159"
    """Frame numbers to train on, by position in the data set: `0-3`, `0-99,150`, or `0-99:4` for every fourth. Or a
    part that the data set names, `training` or `evaluation` of kitti_step; `training:4` is every fourth of it."""
    validation: str = "160-199"
    """Frame numbers that training never sees."""
    seed: int = 0
    """World seed of the embedded world: frame i depends on (seed, i) alone."""
    streets: Literal["town", "suburb"] = "town"
    """Traffic and houses of the embedded world: two places that differ in how often what stands there."""
    rows: Literal["file_order", "elevation"] = "file_order"
    """Laser line of a KITTI point: from the file's order, or the nearest beam (for clouds that were reordered)."""
    cache: Path = Path(".cache/jaxsim")
    """Prepared pairs are kept here, one file a frame, so that a second run starts at once."""


@dataclass(frozen=True)
class PrepareConfig:
    """From camera and LiDAR to aligned pairs on the polar grid."""

    inputs: tuple[InputName, ...] = ("rgb", "depth", "semantic", "edges", "row")
    """Channels the network sees. `incidence`, `range` and `row` are not in the paper."""
    classes: tuple[int, ...] = tuple(range(34))
    """Cityscapes ids that get a channel of `semantic`; any other is *don't care*."""
    image_crop: tuple[int, int] = (352, 1216)
    """Rows and columns of the image that are used: bottom and middle, as depth completion crops it."""
    columns: int = 372
    """Columns of the polar window that the camera sees; its rows are the laser lines inside the crop."""
    network_size: tuple[int, int] = (64, 512)
    """Rows and columns the window is scaled to for the network."""
    depth: Literal["given", "ip_basic", "ip_basic_fast", "penet"] = "given"
    """Dense depth: as the frame gives it (renderers), or completed from the LiDAR points by IP-Basic: `ip_basic_fast`
    is nearer with 64 lines, `ip_basic` (multi-scale) fills wider gaps. `penet` is learned and also sees the image
    (docs/depth-completion.md)."""
    depth_weights: Path | None = None
    """Of `penet`: the file that `jaxsim convert penet` or a training wrote."""
    denoise: Literal["none", "non_local_means", "lidia"] = "none"
    """Denoiser of the target intensity (docs/denoising.md)."""
    denoise_weights: Path | None = None
    """Of `lidia`: the file that `jaxsim convert lidia` wrote."""
    denoise_statistics: Literal["stored", "image"] = "image"
    """What the batch norms of `lidia` divide by: each image's own statistics, as the published scripts do, or those of
    their training, which expect more noise than a LiDAR has (docs/denoising.md)."""
    denoise_gain: float = 1.0
    """Of `lidia`: times this contrast is shown to the network, so that the sensor's noise becomes what the weights were
    trained for: 15, 25 or 50 / 255, where KITTI's is 0.03 (docs/denoising.md)."""
    occlusion_m: float = 1.0
    """A cell is occluded where a camera pixel lies farther behind the cell's nearest one than this, or than a tenth of
    the nearest range if that is more, plus 1.5 times what the nearest range changes by to the next row and the next
    column. Of the changes to both neighbours the smaller counts, and none where they differ in sign, as at a pole."""
    max_range_m: float = 120.0
    """Depth and range channels are scaled by this."""


@dataclass(frozen=True)
class GeneratorConfig:
    """pix2pixHD generator: global generator and local enhancers."""

    form: Form = "imaginaire"
    """`imaginaire`: spectral norm, learned scales in the instance norms, reflection around every convolution, and
    repeated cells before a convolution to double the size. `original`: neither norm's parameters, zeros around
    strided convolutions, transposed convolutions."""
    filters: int = 64
    """Width of the global generator's first layer; the last enhancer has filters / 2**enhancers."""
    max_filters: int = 1024
    downsamples: int = 4
    blocks: int = 9
    """Residual blocks of the global generator."""
    enhancers: int = 1
    enhancer_blocks: int = 3
    out_channels: int = 1


@dataclass(frozen=True)
class DiscriminatorConfig:
    """Multi-scale patch discriminator."""

    form: Form = "imaginaire"
    """`imaginaire`: 3 x 3 kernels, spectral norm, bilinear halving between scales. `original`: 4 x 4 kernels padded
    by 2, no norm in the first layer, average pooling."""
    scales: int = 2
    """Independent discriminators, each at half the size of the one before."""
    filters: int = 64
    max_filters: int = 512
    layers: int = 3


@dataclass(frozen=True)
class LossConfig:
    """Weights of the loss terms; 0 leaves a term out."""

    form: Form = "imaginaire"
    """`imaginaire`: hinge loss, mean over scales; VGG sees ImageNet's colours. `original`: least squares, summed over
    scales (half for the discriminator), features weighted 4 / (layers + 1); VGG sees the image in [-1, 1]."""
    gan: float = 1.0
    feature_matching: float = 10.0
    perceptual: float = 0.0
    """The paper's value is 10; it needs VGG-19 weights (`vgg_weights`)."""
    vgg_weights: Path | None = None
    reconstruction: float = 0.0
    """Mean absolute error of intensity. Not in the paper, which has none; it makes small sets learnable."""
    drop_weight: float = 1.0
    """Weight, in the reconstruction term, of a cell that did not come back, beside 1 of one that did."""
    unseen_weight: float = 0.0
    """Weight there of a cell on which no camera pixel was painted."""


@dataclass(frozen=True)
class OptimConfig:
    """Adam for both networks, as published."""

    lr: float = 2e-4
    betas: tuple[float, float] = (0.5, 0.999)
    eps: float = 1e-8
    batch: int = 8
    steps: int = 2000
    """Updates of the generator (and of the discriminator)."""
    epochs: int = 0
    """Times that every training frame is seen; sets `steps`. 0: `steps` says."""
    decay_from: float = 1.0
    """Fraction of the steps after which lr falls linearly to 0; 1 keeps it constant, as the paper does."""
    start: tuple[Path, ...] = ()
    """Files that `jaxsim convert pix2pixhd_...` wrote: train on from published weights, not from random ones."""
    updates: Literal["discriminator_first", "together"] = "discriminator_first"
    """`discriminator_first`: it learns from an image, then the generator from a fresh one (Imaginaire). `together`:
    both from the same image and the networks as they were (NVIDIA/pix2pixHD)."""
    precision: Literal["float32", "bfloat16"] = "float32"
    """Of the convolutions in training; parameters, statistics and losses stay float32. bfloat16 is for GPUs."""
    flip: bool = False
    """Mirror frames left to right at random. Off in the paper."""
    scale_limit: float = 0.0
    """Magnify frames at random by up to this, and cut the network's size out anywhere: 0.2 in Imaginaire's
    configuration."""
    ema_decay: float = 0.999
    ema_start: int = 500
    """The averaged generator copies the trained one up to this step."""


@dataclass(frozen=True)
class RunConfig:
    """Where the run is kept and how often it reports."""

    name: str = ""
    """Folder under `out`; empty: the experiment's name."""
    out: Path = Path("runs")
    seed: int = 2
    log_every: int = 10
    save_every: int = 200
    """Steps between checkpoints; a killed run resumes from the last. 0, for a detector: an epoch."""
    picture_every: int = 200
    """Steps between validation scores and pictures (input | predicted | measured). 0, for a detector: an epoch."""
    keep: int = 2
    """Checkpoints kept."""
    distributed: bool = False
    """Train together with the other processes that a launcher started, on all their devices (docs/many-devices.md).
    One process uses all devices of its machine without it."""


@dataclass(frozen=True)
class Experiment:
    """One experiment: data, preparation, networks, losses, optimiser, run."""

    data: DataConfig = field(default_factory=DataConfig)
    prepare: PrepareConfig = field(default_factory=PrepareConfig)
    generator: GeneratorConfig = field(default_factory=GeneratorConfig)
    discriminator: DiscriminatorConfig = field(default_factory=DiscriminatorConfig)
    loss: LossConfig = field(default_factory=LossConfig)
    optim: OptimConfig = field(default_factory=OptimConfig)
    run: RunConfig = field(default_factory=RunConfig)


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
    published 1 it is next to nothing, and a short training never sees it (docs/real2sim2real.md)."""
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
