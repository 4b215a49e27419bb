"""`jaxsim convert`: published weights to files that jaxsim reads."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from jaxsim.detect import published as voxel_rcnn
from jaxsim.metrics import inception, rangenet
from jaxsim.pix2pix import published_files
from jaxsim.pix2pix.losses import VGG19
from jaxsim.prepare.denoise import lidia
from jaxsim.prepare.depth import penet
from jaxsim.weights import Converter, convert

CONVERTERS: dict[str, Converter] = {
    "vgg19": VGG19,
    **published_files.CONVERTERS,
    **inception.CONVERTERS,
    "rangenet53": rangenet.CONVERTER,
    "lidia": lidia.CONVERTER,
    voxel_rcnn.KIND: voxel_rcnn.CONVERTER,
    **penet.CONVERTERS,
}
"""Every kind of published weights: its name, and how it is converted."""

KINDS = "\n\n".join(f"    {kind:23} {c.title}: {c.fetch}" for kind, c in CONVERTERS.items())


@dataclass(frozen=True)
class Convert:
    __doc__ = f"""Converts published weights to one .npz of plain arrays, after checking every name and shape.

{KINDS}

    PyTorch files need PyTorch (pip install 'jaxsim-lidar[convert]') and are read with weights_only=True; a .npz of the
    same names needs nothing.
    """

    kind: Annotated[str, tyro.conf.Positional]
    """What the file holds."""
    file: Annotated[Path, tyro.conf.Positional]
    """The published state dict: a PyTorch file or a .npz; the folder of several, where it is published so."""
    out: Path
    """The .npz to write."""

    def __call__(self) -> None:
        converter = CONVERTERS.get(self.kind)
        if converter is None:
            raise ValueError(f"convert: no kind {self.kind!r}; known kinds: {', '.join(CONVERTERS)}")
        weights = convert(self.kind, converter, self.file, out=self.out)
        print(f"{self.out}: {len(weights.arrays)} arrays of {converter.title}, SHA-256 {weights.sha256[:16]}")
        if converter.digest and not weights.published:
            print(
                f"note: {self.file} is not the published file, whose SHA-256 begins with {converter.digest}; names and "
                "shapes are right, but scores over it do not bear the published network's name"
            )
