"""Our weights under the names and layouts of published checkpoints: the way back of `jaxsim.pix2pix.published`."""

import jax
import numpy as np

from jaxsim.config import Pix2PixForm
from jaxsim.pix2pix.published import Place, keys_of, places_of
from jaxsim.pix2pix.steps import Network


def to_published(network: Network, form: Pix2PixForm = "imaginaire") -> dict[str, np.ndarray]:
    """Published name -> array, of a generator's or a discriminator's values.

    A network without singular vectors (the averaged generator) gives plain `weight` names.
    """
    places = places_of(network, form)
    return {
        places[keys_of(path)].name: _theirs(np.asarray(value), places[keys_of(path)])
        for tree in (network.parameters, network.vectors)
        for path, value in jax.tree.leaves_with_path(tree)
    }


def _theirs(array: np.ndarray, slot: Place) -> np.ndarray:
    if array.ndim == 4:
        return array[::-1, ::-1].transpose(2, 3, 0, 1) if slot.transposed else array.transpose(3, 2, 0, 1)
    if slot.name.endswith("weight_v"):
        return array.reshape(slot.kernel_shape[:3]).transpose(2, 0, 1).reshape(-1)
    return array
