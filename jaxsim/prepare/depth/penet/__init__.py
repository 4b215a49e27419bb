"""PENet (Hu et al., ICRA 2021): the paper's depth completion, image and sparse depth to dense depth.

This file completes a frame with weights from a file. Below it:

layers.py       blocks that see their cells' coordinates, and DA-CSPN++
network.py      those coordinates; both branches and their fusion
published.py    published weights        training.py    its three stages, and frames to learn from
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from flax import nnx
from jaxtyping import Bool, Float, UInt8

from jaxsim.files import read_once
from jaxsim.frame import Array
from jaxsim.prepare.depth.ip_basic import fill_in_multiscale
from jaxsim.prepare.depth.penet.network import MULTIPLE, Convention
from jaxsim.prepare.depth.penet.published import (
    CONVERTERS,
    TRAINED,
    TRAINED_KIND,
    Values,
    definition,
    from_published,
    to_published,
)
from jaxsim.weights import load_weights, weights_kind, write_trained

NEAREST_M = 0.1
"""A guess nearer than this is none, as for points and in IP-Basic."""


@dataclass(frozen=True)
class Penet:
    """A network with weights."""

    width: int
    convention: Convention
    """How it was told where pixels are in space when it was trained."""
    values: Values

    def __call__(
        self,
        rgb: UInt8[np.ndarray, "h w 3"],
        sparse_depth_m: Float[np.ndarray, "h w"],
        valid: Bool[np.ndarray, "h w"],
        *,
        intrinsics: Float[np.ndarray, "3 3"],
        rows_cut: int = 0,
    ) -> tuple[Float[np.ndarray, "h w"], Bool[np.ndarray, "h w"]]:
        """Dense depth in metres, and where the LiDAR's points around a pixel back it.

        The network gives every pixel a number, in the sky too; it counts where multi-scale IP-Basic finds points to
        fill from. `intrinsics` are those of the crop; `rows_cut` says how many rows it takes off the top, for the
        published weights were told that it takes half of them.

        Raises ValueError where no pixel has depth, or rows or columns are no multiples of 32.
        """
        if not valid.any():
            raise ValueError("penet: not one pixel has depth, so there is nothing to complete")
        check_crop((valid.shape[0], valid.shape[1]))
        moved = np.array(intrinsics, np.float32)
        if self.convention == "published":
            moved[1, 2] += rows_cut / 2
        sparse = np.where(valid, sparse_depth_m, 0).astype(np.float32)
        form = {"width": self.width, "convention": self.convention}
        depth = complete(self.values, rgb[None], sparse[None], valid=valid[None], intrinsics=moved[None], **form)
        dense = np.asarray(depth)[0]
        # For its mask alone.
        _, backed = fill_in_multiscale(sparse, valid)
        known = backed & np.isfinite(dense) & (dense > NEAREST_M)
        return np.where(known, dense, np.float32(0)), known


def check_crop(size: tuple[int, int], flag: str = "--prepare.image-crop") -> None:
    """Raises ValueError where rows or columns, which `flag` sets, are no multiples of 32."""
    rows, columns = size
    if rows % MULTIPLE or columns % MULTIPLE or not rows * columns:
        least = [max(side - side % MULTIPLE, MULTIPLE) for side in size]
        raise ValueError(
            f"penet: the network is given {rows} x {columns} pixels; both must be multiples of {MULTIPLE}: "
            f"{flag} {least[0]} {least[1]}"
        )


@partial(jax.jit, static_argnames=("width", "convention"))
def complete(
    values: Values,
    rgb: UInt8[Array, "b h w 3"],
    sparse_m: Float[Array, "b h w"],
    *,
    valid: Bool[Array, "b h w"],
    intrinsics: Float[Array, "b 3 3"],
    width: int,
    convention: Convention,
) -> Float[jax.Array, "b h w"]:
    """Dense depth of a batch, in metres."""
    network = nnx.merge(definition(width, convention), values)
    seen = network.coarse(rgb, sparse_m, valid, intrinsics=intrinsics, train=False)
    return network.refine(seen, sparse_m, valid, train=False)


def open_penet(path: Path | None) -> Penet:
    """The network of a file that `jaxsim convert penet` or a training wrote, read once unless it changes.

    Raises ValueError where no file is named, and FileNotFoundError or ValueError where it is not the right one; they
    say what to fetch or train.
    """
    if path is None:
        raise ValueError(
            f"depth: penet needs its weights: fetch {CONVERTERS['penet'].fetch}; then `jaxsim convert penet FILE --out "
            "penet.npz`, or train one (`jaxsim train penet_synthetic`); and --prepare.depth-weights penet.npz"
        )
    return _open(path)


@partial(read_once, most=4)
def _open(path: Path) -> Penet:
    trained = path.is_file() and weights_kind(path) == TRAINED_KIND
    kind, converter = (TRAINED_KIND, TRAINED) if trained else ("penet", CONVERTERS["penet"])
    width, values = from_published(load_weights(path, kind, converter).arrays)
    return Penet(width, "exact" if trained else "published", jax.tree.map(jnp.asarray, values))


def save_penet(path: Path, values: Values) -> None:
    """Writes a network that was trained here as a file for `--prepare.depth-weights`."""
    write_trained(path, TRAINED_KIND, to_published(values))
