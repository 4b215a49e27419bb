"""`jaxsim convert`: published weights to files that jaxsim reads, and a run's network to files that others read."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from jaxsim.detect import published as voxel_rcnn
from jaxsim.files import guess, tidy_file
from jaxsim.metrics import inception, rangenet
from jaxsim.pix2pix import published
from jaxsim.pix2pix.losses import VGG19
from jaxsim.portable import export_network
from jaxsim.prepare.denoise import lidia
from jaxsim.prepare.depth import penet
from jaxsim.simulate import load
from jaxsim.weights import Converter, convert

CONVERTERS: dict[str, Converter] = {
    "vgg19": VGG19,
    **published.CONVERTERS,
    **inception.CONVERTERS,
    "rangenet53": rangenet.CONVERTER,
    "lidia": lidia.CONVERTER,
    voxel_rcnn.KIND: voxel_rcnn.CONVERTER,
    **penet.CONVERTERS,
}
"""Every kind of published weights: its name, and how it is converted."""

NETWORK = "generator"
"""A run's own network, which is converted the other way."""
CONVERTER_LINES = "\n\n".join(f"    {kind:23} {c.title}: {c.fetch}" for kind, c in CONVERTERS.items())


@dataclass(frozen=True)
class Convert:
    __doc__ = f"""Converts published weights to one .npz of plain arrays, after checking every name and shape.

{CONVERTER_LINES}

    PyTorch files need PyTorch (pip install 'jaxsim-lidar[convert]') and are read with weights_only=True; a .npz of the
    same names needs nothing.

    The other way, a trained run's network becomes a file that others read (pip install 'jaxsim-lidar[portable]'):

    jaxsim convert {NETWORK} runs/NAME --to onnx --out generator.onnx

    Beside it a .json says what the channels are; the largest difference to the run's own answer is printed.
    """

    kind: Annotated[str, tyro.conf.Positional]
    """What the file holds."""
    file: Annotated[Path, tyro.conf.Positional]
    """The published state dict: a PyTorch file or a .npz; the folder of several, where it is published so. Of
    `generator` the run's folder, or `embedded`."""
    out: Path
    """The file to write."""
    to: Literal["npz", "stablehlo", "onnx"] = "npz"
    """Of `generator`: StableHLO (jax.export: CPU, CUDA and TPU in one file) or ONNX."""
    batch: int | None = None
    """Of `generator`: the batch that the file takes; any by default, of ONNX 1."""

    def __call__(self) -> None:
        tidy_file(self.out)
        if self.kind == NETWORK:
            self.network()
        else:
            self.published()

    def network(self) -> None:
        if self.to == "npz":
            raise ValueError(f"convert: say what the {NETWORK} becomes: --to stablehlo or --to onnx")
        made = export_network(load(self.file), self.out, to=self.to, batch=self.batch)
        compared = (
            "not compared: no onnxruntime here"
            if made.difference is None
            else f"largest difference to the run's own answer {made.difference:.1e}"
        )
        print(f"{made.path}: {made.size / 1e6:.1f} MB, {compared}; channels: {made.path}.json")

    def published(self) -> None:
        converter = CONVERTERS.get(self.kind)
        if converter is None:
            known = [*CONVERTERS, NETWORK]
            raise ValueError(f"convert: no kind {self.kind!r}{guess(self.kind, known)} Known kinds: {', '.join(known)}")
        if given := [f"--to {self.to}"] * (self.to != "npz") + ["--batch"] * (self.batch is not None):
            raise ValueError(
                f"convert: {self.kind} are published weights, which become npz; {' and '.join(given)} is for {NETWORK}"
            )
        weights = convert(self.kind, converter, self.file, out=self.out)
        print(f"{self.out}: {len(weights.arrays)} arrays of {converter.title}, SHA-256 {weights.sha256[:16]}")
        if converter.digest and not weights.published:
            print(
                f"note: {self.file} is not the published file, whose SHA-256 begins with {converter.digest}; names and "
                "shapes are right, but scores over it do not bear the published network's name"
            )
