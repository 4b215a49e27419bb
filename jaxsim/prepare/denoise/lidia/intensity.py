"""LIDIA on LiDAR intensity: from 0..1 with cells without return to the network's images and back."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Literal

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from jaxsim.prepare.denoise.gaps import close_gaps
from jaxsim.prepare.denoise.lidia.denoiser import Values, apply, check_size
from jaxsim.prepare.denoise.lidia.network import Variant
from jaxsim.prepare.denoise.lidia.published import CONVERTER, load_lidia

Array = np.ndarray


@dataclass(frozen=True)
class Lidia:
    """A network with weights."""

    variant: Variant
    values: Values
    sha256: str = ""
    """Of the weights."""

    def __call__(
        self,
        intensity: Float[Array, "*b rows columns"],
        valid: Bool[Array, "*b rows columns"],
        *,
        statistics: Literal["stored", "image"] = "image",
        gain: float = 1.0,
    ) -> Float[Array, "*b rows columns"]:
        """Intensity (0..1) without noise where `valid`; 0 elsewhere. Values where it is not are never read.

        The network sees `gain` times the contrast: so much that the sensor's noise becomes what it was trained for.
        One compiled program a shape; images of a batch go through one by one. Raises ValueError where an image has not
        one valid cell, or is smaller than the network's border, where the weights are for colour images, and where
        the gain is not positive.
        """
        self.check(gain)
        rows, columns = intensity.shape[-2:]
        check_size(rows, columns, self.variant)
        if not valid.any((-2, -1)).all():
            raise ValueError(
                "lidia: an image has not one cell whose beam came back, so there is nothing to denoise; check that the "
                "points fall into the window (calibration of another drive, or an empty scan?)"
            )
        flat = intensity.reshape(-1, rows, columns)
        flat_valid = valid.reshape(-1, rows, columns)
        images = [self._one(image, mask, statistics, gain) for image, mask in zip(flat, flat_valid, strict=True)]
        return np.stack(images).reshape(intensity.shape) if images else np.zeros(intensity.shape, np.float32)

    def check(self, gain: float) -> None:
        """Raises ValueError where these weights or this gain are not for intensity."""
        if not gain > 0:
            raise ValueError(f"lidia: a gain of {gain} leaves nothing; it must be positive (--prepare.denoise-gain)")
        if self.variant.colour:
            raise ValueError("lidia: these weights are for colour images; intensity is grey: convert a *_bw.pt file")

    def _one(self, intensity: Array, valid: Array, statistics: Literal["stored", "image"], gain: float) -> Array:
        image = np.float32(gain) * (2 * close_gaps(intensity, valid) - 1)[None, ..., None]
        measured = None if valid.all() else valid[None]
        clean = np.asarray(apply(self.values, image, measured, variant=self.variant, statistics=statistics))
        return np.where(valid, np.clip((clean[0, ..., 0] / np.float32(gain) + 1) / 2, 0, 1), np.float32(0))


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
    return _open(path, path.stat().st_mtime_ns if path.is_file() else 0)


@lru_cache(maxsize=4)
def _open(path: Path, changed_ns: int) -> Lidia:
    """`changed_ns` is when the file was written: one of the same name may hold other weights."""
    variant, values, weights = load_lidia(path)
    return Lidia(variant, jax.tree.map(jnp.asarray, values), weights.sha256)
