"""What simulated intensity is worth: clouds of a renderer's frames and Real2Sim2Real, which trains detectors on them;
and segmentation of range images, the second way of asking."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from jaxsim.config.data import DataConfig
from jaxsim.config.detector import DetectorExperiment
from jaxsim.config.intensity import Experiment, GeneratorConfig
from jaxsim.config.ranges import Checked, Count, Positive, Whole


@dataclass(frozen=True)
class CloudRecipe(Checked):
    """How a frame's cloud is made."""

    source: Literal["measured", "depth", "simulated"] = "depth"
    """What the sensor measured; the camera's depth, all of intensity 0; or depth with a trained sensor's intensity."""
    projection: Literal["camera", "grid"] = "camera"
    """Of `simulated`: intensity of the camera's pixels, or of the LiDAR's grid, onto which its rasters are carried."""
    lines: str = ""
    """Laser lines to thin the cloud to: `64`, `32_of_64` (every second), `32_wide` (twice as far apart), `64_fine`, a
    sensor (hdl64e, hdl32e, vlp16, os1_128), a folder whose grid.json has the rows (`elevation`, rad) and columns
    (`azimuth`, rad) of any other, or `none`. Empty: `64` for a cloud of pixels, else `none`."""
    beams: tuple[Whole, ...] = ()
    """Rows of the lines to keep, 0 the top; all by default. Not of `32_of_64`, which keeps rows of its own."""
    keep_zero: bool = False
    """Keep points whose predicted intensity is 0, with 0, instead of taking them for lost rays."""
    published: bool = False
    """As the published program thins: the last pixel wins a cell instead of the nearest point, and what lies beyond
    the lines goes into the border cells."""
    max_high_m: float = 1.0
    """Highest point of a cloud of pixels, above the LiDAR."""


CloudKind = Literal["raw_64", "raw_32", "simulated_64", "simulated_grid", "discovered_grid"]
"""Kinds of clouds that a renderer's frames become: KINDS says how."""


@dataclass(frozen=True)
class LoopConfig(Checked):
    """Real2Sim2Real: a sensor learned from real drives, a renderer's frames seen by it, detectors trained on those
    clouds and scored on real ones."""

    intensity: Experiment = field(default_factory=Experiment)
    """The sensor, trained on real pairs; its validation frames are also what `discover` holds it against."""
    detector: DetectorExperiment = field(default_factory=DetectorExperiment)
    """The detector, and in `data` the labelled frames of the real sensor."""
    synthetic: DataConfig = field(default_factory=DataConfig)
    """The renderer's frames, with labels: to train on, and to judge the detector of real clouds on."""
    kinds: tuple[CloudKind, ...] = ("raw_64", "raw_32", "simulated_64", "discovered_grid")
    """Clouds that they become: a detector is trained on each."""
    lines_32: Literal["32_of_64", "32_wide"] = "32_of_64"
    """The paper's "32 lines": every second of 64, or lines twice as far apart."""
    occlusion: Literal["levels", "never_visible"] = "levels"
    """Of vkitti2's labels, as in `jaxsim export`; `never_visible` leaves nothing easy, as in the paper."""
    seeds: tuple[Whole, ...] = (0,)
    """Of the detectors: each seed trains all of them. The sensor and its clouds are made once."""
    out: Path = Path("runs/real2sim2real")
    """Folder of everything. The same command again goes on where a killed one stopped."""


@dataclass(frozen=True)
class SegmentationConfig(Checked):
    """Networks that tell the class of each cell of a range image, learned without, with simulated and with measured
    intensity, and scored on measured ones."""

    root: Path | None = None
    """Folder of labelled range images: NAME.npz with `scan` of (rows, columns, 6): x, y, z, intensity, range, label.
    None given: the embedded world, whose suburb is learned and whose town is judged."""
    judged: Path | None = None
    """Another folder of them, of the same sensor, to be judged in place of parts of the first: streets elsewhere."""
    frames: Whole = 48
    """Streets of the embedded world's suburb, where no folder is named; half as many of its town."""
    parts: Count = 3
    """The images, in order of name, are cut into so many parts; each is judged by what learned from the others. Frames
    of one street lie in one part, but for those at its ends. With `judged`, each part's intensities are simulated by
    what learned from the others."""
    seeds: tuple[Whole, ...] = (0,)
    network: GeneratorConfig = field(
        default_factory=lambda: GeneratorConfig(
            form="unet", filters=16, max_filters=64, downsamples=3, blocks=1, enhancers=0
        )
    )
    """Of the segmentation and of the sensor: the U-Net of intensities, with other channels."""
    steps: Count = 800
    """Updates of each segmentation."""
    sensor_steps: Count = 800
    """Updates of each sensor, which gives the simulated intensities."""
    grain: bool = True
    """Simulated intensities of rays beside each other scatter together, as measured ones do; without, each for
    itself."""
    batch: Count = 2
    columns: Count = 256
    """Columns that a step sees of an image, cut out anywhere."""
    lr: Positive = 3e-3
    out: Path = Path("runs/segmentation")
    """Folder of everything. The same command again goes on where a killed one stopped."""
