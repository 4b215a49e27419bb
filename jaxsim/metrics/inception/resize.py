"""Images at the size that Inception takes: the two programs' resizing to 299 x 299, as one matrix a side, whose rows
are new cells and whose columns are old ones."""

from __future__ import annotations

from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxsim.frame import Array
from jaxsim.metrics.inception.network import Form

SIZE = 299
Matrix = Float[np.ndarray, "new old"]


def _gathered(places: Float[np.ndarray, " new taps"], weights: Float[np.ndarray, " new taps"], old: int) -> Matrix:
    """Taps outside are moved to the border's cell."""
    matrix = np.zeros((len(places), old))
    np.add.at(matrix, (np.arange(len(places))[:, None], np.clip(places, 0, old - 1).astype(int)), weights)
    return matrix.astype(np.float32)


@cache
def bilinear(new: int, old: int) -> Matrix:
    """Between the two nearest centres, `align_corners=False`, no antialiasing (pytorch-fid)."""
    # Centres lie half a cell in; PyTorch takes what lies before the first old centre to be there.
    at = np.maximum((np.arange(new) + 0.5) * old / new - 0.5, 0)
    low = np.floor(at)
    return _gathered(np.stack([low, low + 1], 1), np.stack([1 - (at - low), at - low], 1), old)


@cache
def bicubic(new: int, old: int) -> Matrix:
    """Keys' cubic with a = -3/4 over four cells, `align_corners=True`, no antialiasing (Imaginaire)."""
    a = -0.75
    at = np.arange(new) * (old - 1) / max(new - 1, 1)
    low = np.floor(at)
    places = low[:, None] + np.arange(-1, 3)
    t = np.abs(at[:, None] - places)
    # Keys's two cubics: up to one cell away, and from one to two.
    near = ((a + 2) * t - (a + 3)) * t * t + 1
    far = ((a * t - 5 * a) * t + 8 * a) * t - 4 * a
    return _gathered(places, np.where(t <= 1, near, far), old)


def prepared_images(images: Float[Array, "b h w c"], form: Form) -> Float[Array, "b 299 299 3"]:
    """Images in [-1, 1], grey or colour, at the network's size."""
    if images.shape[-1] not in (1, 3):
        raise ValueError(f"inception: images have {images.shape[-1]} channels; it takes 1 (repeated) or 3")
    _, rows, columns, _ = images.shape
    images = jnp.clip(images, -1.0, 1.0) if form == "torchvision" else images
    matrix = bicubic if form == "torchvision" else bilinear
    product = partial(jnp.einsum, precision=jax.lax.Precision.HIGHEST)
    images = product("bhwc,ih->biwc", images, matrix(SIZE, rows))
    images = product("biwc,jw->bijc", images, matrix(SIZE, columns))
    return jnp.broadcast_to(images, (*images.shape[:-1], 3))
