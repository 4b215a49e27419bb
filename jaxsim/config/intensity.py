"""The intensity network: pix2pixHD, its losses and its optimiser."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from jaxsim.config.data import DataConfig, PrepareConfig, RunConfig
from jaxsim.config.ranges import Checked, Count, Decay, File, Lasts, NotNegative, Positive, Share, Used, Whole

Pix2PixForm = Literal["imaginaire", "original"]
"""Whose pix2pixHD: NVlabs/imaginaire's, or NVIDIA/pix2pixHD's own."""
QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
"""Quantiles of a cell's intensity that a `unet` gives: the median, the middle half, and nine tenths."""


@dataclass(frozen=True)
class GeneratorConfig(Checked):
    """pix2pixHD generator: global generator and local enhancers; or a U-Net, which has no enhancers."""

    form: Literal[Pix2PixForm, "unet"] = "imaginaire"
    """`imaginaire`: spectral norm, learned scales in the instance norms, reflection around every convolution, and
    repeated cells before a convolution to double the size. `original`: neither norm's parameters, zeros around
    strided convolutions, transposed convolutions. `unet`: each cell's own response in its surroundings, which gives
    quantiles of the intensity and the probability of a drop instead of an image; it learns without a GAN."""
    filters: Count = 64
    """Width of the global generator's first layer; the last enhancer has filters / 2**enhancers."""
    max_filters: Count = 1024
    downsamples: Whole = 4
    blocks: Whole = 9
    """Residual blocks of the global generator; of `unet`, on either side of each level below full size."""
    enhancers: Whole = 1
    enhancer_blocks: Whole = 3
    out_channels: Count = 1
    members: Count = 1
    """Of `unet`: so many networks, whose mean is the answer (Lakshminarayanan et al. 2017). Each learns from its own
    share of the batch; or `jaxsim join` makes one of runs that were trained apart."""
    widen: Used[NotNegative] = 1.0
    """Of `unet`: how far its quantiles lie from the median, times what was learned. A network is surer of the drives
    that it learned from than of others; how much is told by drives that it has not seen. Nothing is trained by it."""
    looks: Used[Literal[1, 2, 4]] = 4
    """Of `unet`: in how many ways it looks at a window for the mean of its answers: 1 as it is, 2 also in a mirror, 4
    both also lifted by some rows. Four are nearer on unseen drives, and take three times as long as one. Nothing is
    trained by it."""

    @property
    def channels(self) -> int:
        """Channels that come out: of `unet` QUANTILES and the drop's."""
        return len(QUANTILES) + 1 if self.form == "unet" else self.out_channels


@dataclass(frozen=True)
class DiscriminatorConfig(Checked):
    """Multi-scale patch discriminator."""

    form: Pix2PixForm = "imaginaire"
    """`imaginaire`: 3 x 3 kernels, spectral norm, bilinear halving between scales. `original`: 4 x 4 kernels padded
    by 2, no norm in the first layer, average pooling."""
    scales: Count = 2
    """Independent discriminators, each at half the size of the one before."""
    filters: Count = 64
    max_filters: Count = 512
    layers: Count = 3


@dataclass(frozen=True)
class LossConfig(Checked):
    """Weights of the loss terms; 0 leaves a term out."""

    form: Pix2PixForm = "imaginaire"
    """`imaginaire`: hinge loss, mean over scales; VGG sees ImageNet's colours. `original`: least squares, summed over
    scales (half for the discriminator), features weighted 4 / (layers + 1); VGG sees the image in [-1, 1]."""
    gan: NotNegative = 1.0
    feature_matching: NotNegative = 10.0
    perceptual: NotNegative = 0.0
    """The paper's value is 10; it needs VGG-19 weights (`vgg_weights`)."""
    vgg_weights: Path | None = None
    reconstruction: NotNegative = 0.0
    """Mean absolute error of intensity. Not in the paper, which has none; it makes small sets learnable. Of `unet` the
    quantile loss of returned cells, the median's weighted as an absolute error is."""
    drops: NotNegative = 0.05
    """Of `unet`: cross entropy of the drop's probability."""
    drop_weight: NotNegative = 1.0
    """Weight, in the reconstruction term, of a cell that did not come back, beside 1 of one that did."""
    unseen_weight: NotNegative = 0.0
    """Weight there of a cell on which no camera pixel was painted."""
    occluded_weight: NotNegative = 0.0
    """Weight there of a cell into which pixels of several surfaces fell."""


@dataclass(frozen=True)
class OptimConfig(Checked):
    """Adam for both networks, as published."""

    lr: Positive = 2e-4
    """Rate of both networks: how far a step goes. Lower it where a training diverges."""
    betas: tuple[Decay, Decay] = (0.5, 0.999)
    """Share of Adam's averages of gradients, and of their squares, that each step keeps."""
    eps: Positive = 1e-8
    """Added to the root of the squares' average, so that no step is divided by 0."""
    batch: Count = 8
    """Frames a step."""
    steps: Lasts[Whole] = 2000
    """Updates of the generator (and of the discriminator)."""
    epochs: Lasts[Whole] = 0
    """Times that every training frame is seen; sets `steps`. 0: `steps` says."""
    decay_from: Share = 1.0
    """Fraction of the steps after which lr falls linearly to 0; 1 keeps it constant, as the paper does."""
    warm_up: Whole = 0
    """Steps in which lr rises linearly to its value."""
    clip: NotNegative = 0.0
    """Gradients of a larger norm are scaled down to it; 0: none is."""
    start: File[tuple[Path, ...]] = ()
    """Files that `jaxsim convert pix2pixhd_...` wrote: train on from published weights, not from random ones."""
    updates: Literal["discriminator_first", "together"] = "discriminator_first"
    """`discriminator_first`: it learns from an image, then the generator from a fresh one (Imaginaire). `together`:
    both from the same image and the networks as they were (NVIDIA/pix2pixHD)."""
    precision: Literal["float32", "bfloat16"] = "float32"
    """Of the convolutions in training; parameters, statistics and losses stay float32. bfloat16 is for GPUs."""
    flip: bool = False
    """Mirror frames left to right at random. Off in the paper."""
    jitter: NotNegative = 0.0
    """Change the image's exposure, contrast and colours at random by about this share; 0: not."""
    scale_limit: NotNegative = 0.0
    """Magnify frames at random by up to this, and cut the network's size out anywhere: 0.2 in Imaginaire's
    configuration."""
    columns: Whole = 0
    """Cut so many columns of the network's size out of each frame, anywhere; 0: all. A step over parts of more frames
    sees more streets."""
    rows: Whole = 0
    """The same of its rows. What a beam sees at one height above the border of a window it then sees at another, so
    that rows are told by their inputs alone."""
    sides: Share = 0.0
    """Share of the steps, from the first on, that learn from the other sides of each scan too: what the LiDAR measured
    to the left, behind and to the right, as though the camera looked there, without image and labels. Needs whole
    scans, not such as are cropped to the image."""
    ema_decay: Share = 0.999
    """Share of the averaged generator, which is the one that is used, that each step keeps."""
    ema_start: Whole = 500
    """The averaged generator copies the trained one up to this step."""


@dataclass(frozen=True)
class Experiment(Checked):
    """One experiment: data, preparation, networks, losses, optimiser, run."""

    data: DataConfig = field(default_factory=DataConfig)
    prepare: PrepareConfig = field(default_factory=PrepareConfig)
    generator: GeneratorConfig = field(default_factory=GeneratorConfig)
    discriminator: DiscriminatorConfig = field(default_factory=DiscriminatorConfig)
    loss: LossConfig = field(default_factory=LossConfig)
    optim: OptimConfig = field(default_factory=OptimConfig)
    run: RunConfig = field(default_factory=RunConfig)
