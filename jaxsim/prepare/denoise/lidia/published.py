"""Published LIDIA checkpoints: their names and shapes, and which network they are of."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jax
import numpy as np

from jaxsim.files import replacing
from jaxsim.prepare.denoise.lidia.denoiser import Values, abstract
from jaxsim.prepare.denoise.lidia.network import Variant
from jaxsim.weights import ABOUT, Arrays, Converter, Weights, fit, load_weights

COLOUR_NAME = "separable_fc_net.sep_part1_s0.ver_hor_bn_re0.ver_hor.ver.weight"
SMALL_NAME = "separable_fc_net.sep_part1_s0.ver_hor_bn_re1.ver_hor.b"
PREFIX = "state_dict."
"""A checkpoint holds the network beside its optimiser."""


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
    state = {name.removeprefix(PREFIX): array for name, array in arrays.items() if not name.startswith("optimizer")}
    return fit(state, published_shapes(variant_of(state)))


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
    kept = fit(dict(arrays), published_shapes(variant))
    return variant, jax.tree.map_with_path(lambda path, _: kept[_name(path)], abstract(variant))


def to_published(values: Values) -> Arrays:
    """A network's values under their published names."""
    return {_name(path): np.asarray(leaf) for path, leaf in jax.tree.leaves_with_path(values)}


def load_lidia(path: Path) -> tuple[Variant, Values, Weights]:
    """The network of a file that `jaxsim convert lidia` or `save_lidia` wrote.

    Raises FileNotFoundError or ValueError, which say what to fetch and convert.
    """
    weights = load_weights(path, "lidia", CONVERTER)
    return *from_published(weights.arrays), weights


def save_lidia(path: Path, values: Values) -> None:
    """Writes a network that was trained here as a file for `--prepare.denoise-weights`; the file is never half written.

    Raises ValueError where the path does not end in .npz.
    """
    if path.suffix != ".npz":
        raise ValueError(f"lidia: weights are kept as .npz, not as {path.name}; name the file {path.stem}.npz")
    about = json.dumps({"kind": "lidia", "source": "a training of jaxsim", "published": False})
    content: dict[str, Any] = {**to_published(values), ABOUT: np.array(about)}
    with replacing(path) as temporary:
        np.savez(temporary, **content)
