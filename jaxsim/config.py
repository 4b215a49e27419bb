"""Every stage's settings, as frozen dataclasses. No behaviour lives here.

An experiment (`configs/*.py`) is one `Experiment` value; every field below is a flag of `train.py`
(`--optim.lr 1e-4`). A run folder keeps the whole value as `config.json`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

DataKind = Literal["synthetic", "kitti_raw", "kitti_object", "kitti_tracking", "kitti_step", "vkitti2"]
Form = Literal["imaginaire", "original"]
"""Whose pix2pixHD: NVlabs/imaginaire's, or NVIDIA/pix2pixHD's own."""
InputName = Literal["rgb", "depth", "semantic", "edges", "incidence", "range", "row"]


@dataclass(frozen=True)
class DataConfig:
    """Which frames to learn from."""

    kind: DataKind = "synthetic"
    """`synthetic` is the embedded world and needs no files."""
    root: Path | None = None
    """Folder of the data set: the one that holds `2011_09_26/` (raw), `training/` (object, tracking, step), or
    `Scene01/` (vkitti2)."""
    scenes: tuple[str, ...] = ()
    """Sequences of kitti_tracking and kitti_step to use, `0001 0018`, or scenes of vkitti2, `Scene01`. None named: all,
    and all must be there."""
    variations: tuple[str, ...] = ("clone",)
    """Of vkitti2: `clone`, `15-deg-left`, `fog` ..."""
    camera: Literal[0, 1] = 0
    """Of vkitti2: 0 left, 1 right."""
    lidar: Literal["kitti", "camera"] = "kitti"
    """Where the LiDAR is thought to be in vkitti2: where KITTI's car has it, or in the camera, so that nothing that the
    camera sees is hidden from it."""
    train: str = "0-159"
    """Frame numbers to train on, by position in the data set: `0-3`, `0-99,150`, or `0-99:4` for every fourth. Or a
    part that the data set names, `training` or `evaluation` of kitti_step; `training:4` is every fourth of it."""
    validation: str = "160-199"
    """Frame numbers that training never sees."""
    seed: int = 0
    """World seed of the embedded world: frame i depends on (seed, i) alone."""
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
    depth: Literal["given", "ip_basic", "ip_basic_fast"] = "given"
    """Dense depth: as the frame gives it (renderers), or completed from the LiDAR points by IP-Basic: `ip_basic_fast`
    is nearer with 64 lines, `ip_basic` (multi-scale) fills wider gaps."""
    denoise: Literal["none", "non_local_means", "lidia"] = "none"
    """Denoiser of the target intensity (docs/denoising.md)."""
    denoise_weights: Path | None = None
    """Of `lidia`: the file that `jaxsim convert lidia` wrote."""
    denoise_statistics: Literal["stored", "image"] = "stored"
    """What the batch norms of `lidia` divide by: the statistics of their training, or each image's own, as the
    published scripts do."""
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
    """Steps between checkpoints; a killed run resumes from the last."""
    picture_every: int = 200
    """Steps between validation scores and pictures (input | predicted | measured)."""
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
