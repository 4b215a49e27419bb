"""Features of images for the Fréchet Inception distance, as the two published programs take them.

torchvision's form is the default of Imaginaire (its `pretrained`), on which the paper builds: clamp to
[-1, 1], bicubic to 299 x 299 with aligned corners, which overshoots and is left so. pytorch-fid's
(its `inception`): bilinear, corners not aligned. This file has the weights, the features and the two programs'
resizing to 299 x 299, as one matrix a side, whose rows are new cells and whose columns are old ones; network.py is the
network.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from flax import nnx
from jaxtyping import Float

from jaxsim.frame import Array
from jaxsim.metrics.inception.network import WIDTHS, Inception, InceptionForm
from jaxsim.products import einsum
from jaxsim.weights import Arrays, Converter, checked_arrays, fingerprint, kernel_of, load_weights, weights_kind

__all__ = ["CONVERTERS", "FORM_OF_KIND", "WIDTHS", "Extractor", "load_extractor", "open_extractor", "random_extractor"]

BATCH_NORM_EPS = 1e-3
OUTPUTS: dict[InceptionForm, int] = {"torchvision": 1000, "pytorch_fid": 1008}
"""Outputs of the classifier, which is not used: the only shape in which the two state dicts differ."""
FORM_OF_KIND: dict[str, InceptionForm] = {"inception": "torchvision", "inception_fid": "pytorch_fid"}
"""Kind of converted weights -> the form of the network that they are for."""
CONVERTERS = {
    "inception": Converter(
        "Inception v3 of torchvision",
        "https://download.pytorch.org/models/inception_v3_google-0cc3c7bd.pth",
        lambda arrays: checked_arrays(arrays, published_shapes("torchvision")),
        digest="0cc3c7bd",
    ),
    "inception_fid": Converter(
        "the FID Inception of pytorch-fid",
        "https://github.com/mseitzer/pytorch-fid/releases/download/fid_weights/pt_inception-2015-12-05-6726825d.pth",
        lambda arrays: checked_arrays(arrays, published_shapes("pytorch_fid")),
        digest="6726825d",
    ),
}
"""What `jaxsim convert` makes of published weights."""
INPUT_SIZE = 299
_Matrix = Float[np.ndarray, "new old"]


@cache
def _abstract(form: InceptionForm) -> tuple[Any, Any]:
    """Definition, and shapes of all values as nested dicts."""
    definition, state = nnx.split(nnx.eval_shape(lambda: Inception(form, nnx.Rngs(0))))
    return definition, nnx.to_pure_dict(state)


def _convolutions(form: InceptionForm) -> dict[str, tuple[int, ...]]:
    """Published name of every convolution -> shape of its kernel (rows, columns, in, out)."""
    leaves = jax.tree.leaves_with_path(_abstract(form)[1])
    return {".".join(step.key for step in path[:-1]): leaf.shape for path, leaf in leaves if path[-1].key == "kernel"}


def published_shapes(form: InceptionForm, *, classifier: bool = True) -> dict[str, tuple[int, ...]]:
    """Names and shapes of the published state dict that are read."""
    shapes: dict[str, tuple[int, ...]] = {}
    for name, (rows, columns, channels, width) in _convolutions(form).items():
        shapes[f"{name}.conv.weight"] = (width, channels, rows, columns)
        shapes |= {f"{name}.bn.{part}": (width,) for part in ("weight", "bias", "running_mean", "running_var")}
    return shapes | ({"fc.weight": (OUTPUTS[form], WIDTHS[-1]), "fc.bias": (OUTPUTS[form],)} if classifier else {})


def _folded(arrays: Arrays, form: InceptionForm) -> Any:
    """The network's values: kernels scaled, and biases from the batch norm's stored statistics."""

    def adopt(path: Any, leaf: Any) -> np.ndarray:
        name = ".".join(step.key for step in path[:-1])
        scale = arrays[f"{name}.bn.weight"].astype(np.float64)
        shift = arrays[f"{name}.bn.bias"].astype(np.float64)
        mean = arrays[f"{name}.bn.running_mean"].astype(np.float64)
        variance = arrays[f"{name}.bn.running_var"].astype(np.float64)
        # y = (Wx - mean) scale + shift, as one convolution with a bias; in float64, so that folding loses nothing.
        scale = scale / np.sqrt(variance + BATCH_NORM_EPS)
        if path[-1].key == "bias":
            return (shift - mean * scale).astype(np.float32)
        return (kernel_of(arrays[f"{name}.conv.weight"]) * scale).astype(np.float32)

    return jax.tree.map_with_path(adopt, _abstract(form)[1])


@partial(jax.jit, static_argnames=("form", "width"))
def _pooled(
    values: Any, images: Float[Array, "b h w c"], *, form: InceptionForm, width: int
) -> Float[Array, "b width"]:
    network = nnx.merge(_abstract(form)[0], values)
    return network(prepared_images(images, form))[width].mean((1, 2))


@dataclass(frozen=True)
class Extractor:
    """A network with weights, and where its features are taken."""

    form: InceptionForm
    values: Any
    sha256: str
    """SHA-256 of the weights."""
    published: bool
    """The weights are the published ones: only then, and with all 2048 features, is the distance FID."""
    random: bool = False
    width: int = WIDTHS[-1]
    """Number of features."""

    @property
    def name(self) -> str:
        """Form, features and weights: what statistics depend on besides the images."""
        return f"inception_{self.form}-{self.width}-{self.sha256[:16]}"

    @property
    def score(self) -> str:
        """What the Fréchet distance of these features is called."""
        what = "frechet_random" if self.random else "fid" if self.published else "frechet_unpublished"
        return what if self.width == WIDTHS[-1] else f"{what.replace('fid', 'frechet_inception')}_{self.width}"

    def __call__(self, images: Float[Array, "b h w c"]) -> Float[Array, "b width"]:
        """Features of images in [-1, 1] with 1 or 3 channels."""
        return _pooled(self.values, images, form=self.form, width=self.width)

    def batches(self, images: Iterable[Float[Array, "h w c"]], size: int) -> Iterator[Float[np.ndarray, "n width"]]:
        """Features of images one by one, taken `size` at a time; the last batch is filled up and cut again."""
        waiting: list[np.ndarray] = []
        for image in images:
            waiting.append(np.asarray(image, np.float32))
            if len(waiting) == size:
                yield np.asarray(self(np.stack(waiting)))
                waiting = []
        if waiting:
            # Filled up with its last image, the last batch needs no program of its own.
            yield np.asarray(self(np.stack(waiting + [waiting[-1]] * (size - len(waiting)))))[: len(waiting)]


def _checked(width: int) -> int:
    if width not in WIDTHS:
        raise ValueError(f"inception: there are no {width} features; take {', '.join(map(str, WIDTHS))}")
    return width


def load_extractor(path: Path, width: int = WIDTHS[-1]) -> Extractor:
    """The network of a converted file, in the form that its weights are for.

    Raises FileNotFoundError or ValueError, which say what to fetch and convert.
    """
    kind = weights_kind(path) or "inception"
    if kind not in FORM_OF_KIND:
        raise ValueError(
            f"inception: {path} holds {kind}; the distance takes {' or '.join(FORM_OF_KIND)} (jaxsim convert)"
        )
    weights = load_weights(path, kind, CONVERTERS[kind])
    form = FORM_OF_KIND[kind]
    values = jax.device_put(_folded(weights.arrays, form))
    return Extractor(form, values, weights.sha256, weights.published, width=_checked(width))


def open_extractor(source: str, width: int = WIDTHS[-1]) -> Extractor:
    """The network of a command line's `--fid`: a converted file, or `random`.

    Raises FileNotFoundError or ValueError, which say what to fetch and convert.
    """
    return random_extractor(width) if source == "random" else load_extractor(Path(source), width)


def random_extractor(width: int = WIDTHS[-1], *, seed: int = 0) -> Extractor:
    """torchvision's network with random weights (He et al. 2015), the same for the same seed.

    Its distances order images of one size and number; they are no FID.
    """
    generator = np.random.default_rng(seed)
    arrays: Arrays = {}
    for name, shape in sorted(published_shapes("torchvision", classifier=False).items()):
        if len(shape) == 4:
            # Published kernels are (out, in, rows, columns): all but the first are the fan in.
            draw = generator.standard_normal(shape) * np.sqrt(2 / np.prod(shape[1:]))
            arrays[name] = draw.astype(np.float32)
        else:
            arrays[name] = np.full(shape, float(name.endswith(("bn.weight", "running_var"))), np.float32)
    values = jax.device_put(_folded(arrays, "torchvision"))
    return Extractor("torchvision", values, fingerprint(arrays), published=False, random=True, width=_checked(width))


def _gathered(places: Float[np.ndarray, " new taps"], weights: Float[np.ndarray, " new taps"], old: int) -> _Matrix:
    """Taps outside are moved to the border's cell."""
    matrix = np.zeros((len(places), old))
    np.add.at(matrix, (np.arange(len(places))[:, None], np.clip(places, 0, old - 1).astype(int)), weights)
    return matrix.astype(np.float32)


@cache
def bilinear(new: int, old: int) -> _Matrix:
    """Between the two nearest centres, `align_corners=False`, no antialiasing (pytorch-fid)."""
    # Centres lie half a cell in; PyTorch takes what lies before the first old centre to be there.
    at = np.maximum((np.arange(new) + 0.5) * old / new - 0.5, 0)
    low = np.floor(at)
    return _gathered(np.stack([low, low + 1], 1), np.stack([1 - (at - low), at - low], 1), old)


@cache
def bicubic(new: int, old: int) -> _Matrix:
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


def prepared_images(images: Float[Array, "b h w c"], form: InceptionForm) -> Float[Array, "b 299 299 3"]:
    """Images in [-1, 1], grey or colour, at the network's size."""
    if images.shape[-1] not in (1, 3):
        raise ValueError(f"inception: images have {images.shape[-1]} channels; it takes 1 (repeated) or 3")
    _, rows, columns, _ = images.shape
    images = jnp.clip(images, -1.0, 1.0) if form == "torchvision" else images
    matrix = bicubic if form == "torchvision" else bilinear
    images = einsum("bhwc,ih->biwc", images, matrix(INPUT_SIZE, rows))
    images = einsum("biwc,jw->bijc", images, matrix(INPUT_SIZE, columns))
    return jnp.broadcast_to(images, (*images.shape[:-1], 3))
