"""LIDIA (Vaksman, Elad, Milanfar, CVPR Workshops 2020): the paper's denoiser of intensity, a small network over
patches and their neighbours.

This file has its published weights, and the network on LiDAR intensity. Below it:

    patches.py      patches, and the 14 most alike, at two scales; cells without return do not count
    stages.py       how patches go through layers, and batch norm
    network.py      the network, under its published names
    denoiser.py     whole images
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from jaxsim.files import read_once
from jaxsim.geometry.rasters import close_gaps
from jaxsim.prepare.denoise.lidia.denoiser import abstract, apply, check_image_size
from jaxsim.prepare.denoise.lidia.network import Variant
from jaxsim.weights import Arrays, Converter, Values, checked_arrays, load_weights, write_trained

COLOUR_NAME = "separable_fc_net.sep_part1_s0.ver_hor_bn_re0.ver_hor.ver.weight"
SMALL_NAME = "separable_fc_net.sep_part1_s0.ver_hor_bn_re1.ver_hor.b"


def _name(path: Any) -> str:
    return ".".join(str(step.key) for step in path)


def published_shapes(variant: Variant) -> dict[str, tuple[int, ...]]:
    """Names and shapes of the arrays that are read; the constant blur and the counts of batches are not."""
    return {_name(path): leaf.shape for path, leaf in jax.tree.leaves_with_path(abstract(variant))}


def variant_of(arrays: Mapping[str, np.ndarray]) -> Variant:
    """Grey or colour, full or small, by names and shapes. Raises ValueError where it is no LIDIA."""
    first = arrays.get(COLOUR_NAME)
    if first is None or first.ndim != 2:
        raise ValueError(f"it is no LIDIA network: {COLOUR_NAME} is missing.")
    for variant in (Variant(), Variant(colour=True)):
        if first.shape == (variant.width, variant.numel):
            return variant._replace(small=SMALL_NAME not in arrays)
    raise ValueError(f"{COLOUR_NAME} is {first.shape}; it is (64, 49) in a grey network, (80, 75) in a colour one.")


def _kept(arrays: Arrays) -> Arrays:
    # A checkpoint holds the network under `state_dict`, beside its optimiser.
    state = {
        name.removeprefix("state_dict."): array for name, array in arrays.items() if not name.startswith("optimizer")
    }
    return checked_arrays(state, published_shapes(variant_of(state)))


CONVERTER = Converter(
    "LIDIA",
    "github.com/grishavak/LIDIA-denoiser, models/model_state_sigma_{15,25,50,blind}_bw.pt (grey), "
    "model_state_small_sigma_{15,25,50,blind}_bw.pt, or model_state_sigma_{15,25,50}_c.pt (colour)",
    _kept,
)
"""What `jaxsim convert lidia` makes of a published file: any of its networks."""


def from_published(arrays: Mapping[str, np.ndarray]) -> tuple[Variant, Values]:
    """A network's values. Raises ValueError where names or shapes are not LIDIA's."""
    variant = variant_of(arrays)
    kept = checked_arrays(dict(arrays), published_shapes(variant))
    return variant, jax.tree.map_with_path(lambda path, _: kept[_name(path)], abstract(variant))


def to_published(values: Values) -> Arrays:
    """A network's values under their published names."""
    return {_name(path): np.asarray(leaf) for path, leaf in jax.tree.leaves_with_path(values)}


@dataclass(frozen=True)
class Lidia:
    """A network with weights."""

    variant: Variant
    values: Values

    def __call__(
        self,
        intensity: Float[np.ndarray, "*b rows columns"],
        valid: Bool[np.ndarray, "*b rows columns"],
        *,
        statistics: Literal["stored", "image"] = "image",
        gain: float = 1.0,
    ) -> Float[np.ndarray, "*b rows columns"]:
        """Intensity (0..1) without noise where `valid`; 0 elsewhere. Values where it is not are never read.

        The network sees `gain` times the contrast: so much that the sensor's noise becomes what it was trained for.
        One compiled program a shape; images of a batch go through one by one. Raises ValueError where an image has not
        one valid cell, or is smaller than the network's border, where the weights are for colour images, and where
        the gain is not positive.
        """
        self.check(gain)
        rows, columns = intensity.shape[-2:]
        check_image_size(rows, columns, self.variant)
        if not valid.any((-2, -1)).all():
            raise ValueError(
                "lidia: an image has not one cell whose beam came back, so there is nothing to denoise; check that the "
                "points fall into the window (calibration of another drive, or an empty scan?)"
            )
        flat = intensity.reshape(-1, rows, columns)
        flat_valid = valid.reshape(-1, rows, columns)
        clean = np.zeros(flat.shape, np.float32)
        for k, (image, mask) in enumerate(zip(flat, flat_valid, strict=True)):
            # 0..1 to the network's [-1, 1], stretched about the middle by the gain.
            wide = np.float32(gain) * (2 * close_gaps(image, mask) - 1)[None, ..., None]
            measured = None if mask.all() else mask[None]
            out = np.asarray(apply(self.values, wide, measured, variant=self.variant, statistics=statistics))
            clean[k] = np.where(mask, np.clip((out[0, ..., 0] / np.float32(gain) + 1) / 2, 0, 1), np.float32(0))
        return clean.reshape(intensity.shape)

    def check(self, gain: float) -> None:
        """Raises ValueError where these weights or this gain are not for intensity."""
        if not gain > 0:
            raise ValueError(f"lidia: a gain of {gain} leaves nothing; it must be positive (--prepare.denoise-gain)")
        if self.variant.colour:
            raise ValueError("lidia: these weights are for colour images; intensity is grey: convert a *_bw.pt file")


def open_lidia(path: Path | None) -> Lidia:
    """The network of a file that `jaxsim convert lidia` or `save_lidia` wrote, read once as long as it stays the same.

    Raises ValueError where no file is named, and FileNotFoundError or ValueError where it is not the right one; they
    say what to fetch and convert.
    """
    if path is None:
        raise ValueError(
            f"denoise: lidia needs its weights: fetch {CONVERTER.fetch}; then `jaxsim convert lidia FILE --out "
            "lidia.npz` and --prepare.denoise-weights lidia.npz"
        )
    return _open(path)


@partial(read_once, most=4)
def _open(path: Path) -> Lidia:
    variant, values = from_published(load_weights(path, "lidia", CONVERTER).arrays)
    return Lidia(variant, jax.tree.map(jnp.asarray, values))


def save_lidia(path: Path, values: Values) -> None:
    """Writes a network that was trained here as a file for `--prepare.denoise-weights`; the file is never half written.

    Raises ValueError where the path does not end in .npz.
    """
    if path.suffix != ".npz":
        raise ValueError(f"lidia: weights are kept as .npz, not as {path.name}; name the file {path.stem}.npz")
    write_trained(path, "lidia", to_published(values))
