"""Segmentation of range images, the second way of asking what simulated intensity is worth."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from jaxsim.config.intensity import GeneratorConfig
from jaxsim.config.ranges import Checked, Count, Positive, Whole


@dataclass(frozen=True)
class SegmentationConfig(Checked):
    """Networks that tell the class of each cell of a range image, learned without, with simulated and with measured
    intensity, and scored on measured ones."""

    root: Path | None = None
    """Folder of labelled range images: NAME.npz with `scan` of (rows, columns, 6): x, y, z, intensity, range, label."""
    parts: Count = 3
    """The images, in order of name, are cut into so many parts; each is judged by what learned from the others. Frames
    of one street lie in one part, but for those at its ends."""
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
    batch: Count = 2
    columns: Count = 256
    """Columns that a step sees of an image, cut out anywhere."""
    lr: Positive = 3e-3
    out: Path = Path("runs/segmentation")
    """Folder of everything. The same command again goes on where a killed one stopped."""
