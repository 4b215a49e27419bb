"""What trainings share: which frames they learn from, how these become pairs, and where a run is kept."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from jaxsim.config.ranges import (
    Checked,
    Chosen,
    Columns,
    Count,
    Drawn,
    File,
    Kept,
    NotNegative,
    OfFrame,
    Positive,
    WeightsFile,
    Whole,
    settings_of,
)

DataKind = Literal[
    "synthetic",
    "kitti_raw",
    "kitti_object",
    "kitti_tracking",
    "kitti_step",
    "kitti_odometry",
    "kitti",
    "vkitti2",
    "polar",
    "prepared",
]
InputName = Literal[
    "rgb", "depth", "semantic", "edges", "incidence", "range", "log_range", "row", "beam", "surroundings"
]

Streets = Literal["town", "suburb", "wet_town", "wet_suburb"]


@dataclass(frozen=True)
class FrameSource(Checked):
    """A data set, so far as it is named: what is None, or empty, is as a run has it, or as in training."""

    kind: Literal["same", DataKind] = "same"
    """Kind of data set; `same`: the run's own."""
    root: File[Path | None] = None
    """Folder of the data set: the one that holds `2011_09_26/` (raw), `training/` (object, tracking, step),
    `sequences/` (odometry), any of these (kitti), or `Scene01/` (vkitti2); the `--out` of `jaxsim frames`
    (polar) or `jaxsim prepare` (prepared)."""
    scenes: OfFrame[tuple[str, ...]] = ()
    """Sequences of kitti_tracking and kitti_step to use, `0001 0018`, of kitti_odometry, `00 08`, or scenes of vkitti2,
    `Scene01`. None named: all, and all must be there (of kitti_odometry those that are)."""
    variations: OfFrame[tuple[str, ...] | None] = None
    """Of vkitti2: `clone` (the default), `15-deg-left`, `fog` ..."""
    camera: OfFrame[Literal[0, 1] | None] = None
    """Of vkitti2: 0 left (the default), 1 right."""
    lidar: OfFrame[Literal["kitti", "camera"] | None] = None
    """Where the LiDAR is thought to be in vkitti2, and the camera in the embedded world: apart as on KITTI's car (the
    default), or in one place, so that nothing that the camera sees is hidden from the LiDAR (the paper's additional
    camera)."""
    rows: Literal["file_order", "elevation"] | None = None
    """Laser line of a KITTI point: from the file's order (the default), or the nearest beam, for clouds that were
    reordered."""
    seed: OfFrame[Whole | None] = None
    """World seed of the embedded world: frame i depends on (seed, i) alone."""
    streets: OfFrame[Streets | None] = None
    """Traffic and houses of the embedded world: two places that differ in how often what stands there, dry or after
    rain. A seed has the same streets in both, with other traffic: give another place another seed."""


@dataclass(frozen=True)
class DataConfig(FrameSource):
    """Which frames to learn from."""

    kind: DataKind = "synthetic"
    """`synthetic` is the embedded world and needs no files; `prepared` is what `jaxsim prepare` made of another."""
    variations: OfFrame[tuple[str, ...]] = ("clone",)
    camera: OfFrame[Literal[0, 1]] = 0
    lidar: OfFrame[Literal["kitti", "camera"]] = "kitti"
    rows: Literal["file_order", "elevation"] = "file_order"
    seed: OfFrame[Whole] = 0
    streets: OfFrame[Streets] = "town"
    train: Chosen[str] = "0-159"
    """Frame numbers to train on, by position in the data set: `0-3`, `0-99,150`, or `0-99:4` for every fourth. Or a
    part that the data set names, `training` or `evaluation` of kitti_step; `training:4` is every fourth of it."""
    validation: Chosen[str] = "160-199"
    """Frame numbers that training never sees."""
    cache: Kept[Path] = Path(".cache/jaxsim")
    """Prepared pairs are kept here, one file a frame, so that a second run starts at once."""

    @property
    def bare(self) -> DataConfig:
        """The settings that decide what a frame holds: which of them are used, and where results are kept, left out."""
        left_out = {name: type(getattr(self, name))() for name in settings_of(DataConfig, "chosen", "kept")}
        return replace(self, root=self.root and self.root.resolve(), **left_out)

    @property
    def of_frames(self) -> dict[str, Any]:
        """What the frame at a position depends on besides its files, by name: folders of frames are claimed by it."""
        return {name: getattr(self, name) for name in settings_of(DataConfig, "frame")}


@dataclass(frozen=True)
class PrepareConfig(Checked):
    """From camera and LiDAR to aligned pairs on the polar grid."""

    inputs: tuple[InputName, ...] = ("rgb", "depth", "semantic", "edges", "row")
    """Channels the network sees. `incidence`, `range`, `log_range`, `row`, `beam` and `surroundings` are not in the
    paper; `beam` is a channel a laser line, up to 64 of them, `surroundings` are means and spreads of grey and range
    around the cell."""
    classes: tuple[Whole, ...] = tuple(range(34))
    """Cityscapes ids that get a channel of `semantic`; any other is *don't care*."""
    image_crop: tuple[Count, Count] = (352, 1216)
    """Rows and columns of the image that are used: bottom and middle, as depth completion crops it."""
    columns: Columns = 372
    """Columns of the polar window that the camera sees; its rows are the laser lines inside the crop."""
    network_size: tuple[Count, Count] = (64, 512)
    """Rows and columns the window is scaled to for the network."""
    depth: Literal["given", "ip_basic", "ip_basic_fast", "penet"] = "given"
    """Dense depth: as the frame gives it (renderers), or completed from the LiDAR points by IP-Basic: `ip_basic_fast`
    is nearer with 64 lines, `ip_basic` (multi-scale) fills wider gaps. `penet` is learned and also sees the image."""
    depth_weights: WeightsFile[Path | None] = None
    """Of `penet`: the file that `jaxsim convert penet` or a training wrote."""
    denoise: Literal["none", "non_local_means", "lidia"] = "none"
    """Denoiser of the target intensity: OpenCV's non-local means, or the network of the paper, LIDIA."""
    denoise_weights: WeightsFile[Path | None] = None
    """Of `lidia`: the file that `jaxsim convert lidia` wrote."""
    denoise_statistics: Literal["stored", "image"] = "image"
    """What the batch norms of `lidia` divide by: each image's own statistics, as the published scripts do, or those of
    their training, which expect more noise than a LiDAR has."""
    denoise_gain: Positive = 1.0
    """Of `lidia`: times this contrast is shown to the network, so that the sensor's noise becomes what the weights were
    trained for: 15, 25 or 50 / 255, where KITTI's is 0.03."""
    occlusion_m: NotNegative = 1.0
    """A cell is occluded where a camera pixel lies farther behind the cell's nearest one than this, or than a tenth of
    the nearest range if that is more, plus 1.5 times what the nearest range changes by to the next row and the next
    column. Of the changes to both neighbours the smaller counts, and none where they differ in sign, as at a pole."""
    max_range_m: Positive = 120.0
    """Depth and range channels are scaled by this."""


@dataclass(frozen=True)
class RunConfig(Checked):
    """Where the run is kept and how often it reports."""

    name: Kept[str] = ""
    """Folder under `out`; empty: the experiment's name."""
    out: Kept[Path] = Path("runs")
    seed: Drawn[Whole] = 2
    log_every: Kept[Count] = 10
    save_every: Kept[Whole] = 200
    """Steps between checkpoints; a killed run resumes from the last. 0: the end alone; of a detector, every epoch."""
    picture_every: Kept[Whole] = 200
    """Steps between validation scores and pictures (input | predicted | measured). 0: at the end alone; of a detector,
    every epoch."""
    keep: Kept[Count] = 2
    """Checkpoints kept."""
    distributed: Kept[bool] = False
    """Train together with the other processes that a launcher started (Slurm, Open MPI, Kubernetes, TPU pods; any other
    sets JAX_COORDINATOR_ADDRESS, JAX_NUM_PROCESSES and JAX_PROCESS_ID), on all their devices. One process uses all
    devices of its machine without it."""
