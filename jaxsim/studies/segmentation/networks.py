"""Networks of the segmentation study: a sensor's intensities from geometry and class, and classes from a range image.

Both are the U-Net of intensities with other channels, and learn in memory from parts of the images.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import repeat
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optax
from flax import nnx
from jaxtyping import Float, Int

from jaxsim.config import QUANTILES, GeneratorConfig, SegmentationConfig
from jaxsim.data.logs.range_images import RangeImage
from jaxsim.frame import Array
from jaxsim.pix2pix.convolution import compiler_options, on_cpu
from jaxsim.pix2pix.losses import quantile_loss
from jaxsim.pix2pix.unet import UNet
from jaxsim.simulate.grain import Breaks, Field, Ranks, breaks_of, ranks_of_fields
from jaxsim.simulate.grain_fit import GrainScan
from jaxsim.simulate.predict import Prediction, drawn
from jaxsim.train.in_memory import descend

Targets = dict[str, Array]
Loss = Callable[[Array, Targets], Array]
FARTHEST_M = 120.0


def geometry(image: RangeImage) -> Float[np.ndarray, "rows columns 5"]:
    """What a scan without intensity tells a network: ln range, place, and whether anything came back; 0 where not."""
    logarithm = np.log(np.clip(image.range_m, 1, FARTHEST_M)) / np.log(FARTHEST_M)
    position = image.xyz_m / np.array([50, 50, 3], np.float32)
    return np.where(
        image.valid[..., None], np.concatenate([logarithm[..., None], position, image.valid[..., None]], -1), 0
    )


def of_segmentation(image: RangeImage, intensity: Float[np.ndarray, "rows columns"]) -> np.ndarray:
    """Inputs of the segmentation."""
    return np.concatenate([geometry(image), intensity[..., None]], -1).astype(np.float32)


def of_learned_sensor(image: RangeImage, classes: int) -> np.ndarray:
    """Inputs of the learned sensor: geometry, laser line and class, one channel each."""
    rows, columns = image.range_m.shape
    line = np.broadcast_to(np.eye(rows, dtype=np.float32)[:, None], (rows, columns, rows))
    return np.concatenate([geometry(image), line, np.eye(classes, dtype=np.float32)[image.label]], -1).astype(
        np.float32
    )


def class_loss(outputs: Float[Array, "b h w k"], batch: Targets) -> Float[Array, ""]:
    """Cross entropy of the labelled cells, each class weighted by the root of its rarity."""
    logits = jax.nn.log_softmax(outputs, axis=-1)
    right = (logits * jax.nn.one_hot(batch["label"], outputs.shape[-1])).sum(-1)
    return -(batch["weight"] * right).sum() / jnp.maximum(batch["weight"].sum(), 1e-6)


def intensity_loss(outputs: Float[Array, "b h w k"], batch: Targets) -> Float[Array, ""]:
    """The quantile loss of returned cells."""
    return quantile_loss(outputs, batch["intensity"], batch["weight"])


@cache
def _network(config: GeneratorConfig, channels: tuple[int, int]) -> tuple[Any, Callable[[Any, Array], Array]]:
    """Definition of a network of so many channels in and out; jitted (parameters, one image) -> its outputs."""
    make = lambda: UNet(config, channels[0], nnx.Rngs(0), out_channels=channels[1])  # noqa: E731
    definition = nnx.graphdef(nnx.eval_shape(make))
    return definition, jax.jit(lambda parameters, x: nnx.merge(definition, parameters)(x[None])[0])


@cache
def _learner(config: SegmentationConfig, channels: tuple[int, int], *, loss: Loss, steps: int) -> tuple[Any, Any]:
    """Optimiser, and the jitted step: one program for all seeds, parts and kinds of intensity."""
    definition, _ = _network(config.network, channels)
    warm_up = max(1, min(50, steps // 4))
    rate = optax.warmup_cosine_decay_schedule(0.0, config.lr, warm_up, max(steps, warm_up + 1))
    adam = optax.chain(optax.clip_by_global_norm(1.0), optax.adam(rate, b2=0.99))

    def step(learned: tuple[Any, Any], x: Array, batch: Targets) -> tuple[tuple[Any, Any], Float[Array, ""]]:
        parameters, state = learned
        of = lambda p: loss(nnx.merge(definition, p)(x), batch)  # noqa: E731
        value, gradient = jax.value_and_grad(of)(parameters)
        updates, state = adam.update(gradient, state)
        return (optax.apply_updates(parameters, updates), state), value

    options = compiler_options() if on_cpu() else None
    return adam, jax.jit(step, donate_argnums=0, compiler_options=options)


@dataclass(frozen=True)
class TrainedNetwork:
    """A trained network."""

    config: GeneratorConfig
    channels: tuple[int, int]
    parameters: Any

    def __call__(self, x: Float[np.ndarray, "rows columns c"]) -> Float[Array, "rows columns k"]:
        return _network(self.config, self.channels)[1](self.parameters, x)


def train_network(
    inputs: Sequence[np.ndarray],
    targets: Sequence[Mapping[str, np.ndarray]],
    loss: Loss,
    *,
    out_channels: int,
    steps: int,
    seed: int,
    config: SegmentationConfig,
) -> TrainedNetwork:
    """A network after `steps` updates by Adam on parts of the images; the rate falls to 0."""
    channels = inputs[0].shape[-1], out_channels
    _, parameters = nnx.split(UNet(config.network, channels[0], nnx.Rngs(seed), out_channels=out_channels))
    adam, step = _learner(replace(config, root=None, out=Path(), seeds=()), channels, loss=loss, steps=steps)
    columns = inputs[0].shape[1]

    def batch(random: np.random.Generator) -> tuple[np.ndarray, Targets]:
        chosen = random.integers(len(inputs), size=config.batch)
        cuts = [_cut(columns, min(config.columns, columns), random) for _ in chosen]
        part = lambda rasters: np.stack([r[:, cut] for r, cut in zip(rasters, cuts, strict=True)])  # noqa: E731
        return part([inputs[i] for i in chosen]), {n: part([targets[i][n] for i in chosen]) for n in targets[0]}

    batches = map(batch, repeat(np.random.default_rng(seed), steps))
    update = lambda state, made, _: step(state, *made)  # noqa: E731
    # optax raises floats to integers, which strict promotion forbids.
    with jax.numpy_dtype_promotion("standard"):
        begin = parameters, adam.init(parameters)
        parameters, _ = descend(update, begin, batches, steps=steps, by="segmentation")
    return TrainedNetwork(config.network, channels, parameters)


def _cut(columns: int, width: int, random: np.random.Generator) -> Int[np.ndarray, " width"]:
    """Columns side by side, anywhere around the turn."""
    return (random.integers(columns) + np.arange(width)) % columns


def quantiles_of(
    network: TrainedNetwork, x: Float[np.ndarray, "rows columns c"]
) -> Float[np.ndarray, "rows columns q"]:
    """What a sensor's network holds possible of each cell, 0..1, rising."""
    quantiles = (np.asarray(network(x))[..., : len(QUANTILES)] + 1) / 2
    return np.clip(np.sort(quantiles, axis=-1), 0, 1)


def breaks_in(image: RangeImage) -> Breaks:
    """Where the surfaces of a scan end, classes among them."""
    label = jnp.asarray(image.label)
    return breaks_of(jnp.asarray(image.range_m), jnp.asarray(image.valid), kind=label, thing=label)


def grain_scan(image: RangeImage, quantiles: Float[np.ndarray, "rows columns q"]) -> GrainScan:
    """A scan beside what a sensor's network says of it, to learn its grain from."""
    never = np.zeros(image.range_m.shape)
    return GrainScan(breaks_in(image), image.valid, image.valid, image.intensity, quantiles, never)


def simulate(
    network: TrainedNetwork,
    inputs: Sequence[np.ndarray],
    images: Sequence[RangeImage],
    *,
    grain: Sequence[Field] | None,
    seed: int,
) -> list[Float[np.ndarray, "rows columns"]]:
    """Intensities of the images, drawn from what the sensor holds possible, beside each other with its grain (None:
    each cell for itself); 0 where nothing came back."""
    pictures = []
    for k, (x, image) in enumerate(zip(inputs, images, strict=True)):
        quantiles = jnp.asarray(quantiles_of(network, x), jnp.float32)
        lost = jnp.where(image.valid, 0.0, 1.0)
        says = Prediction(quantiles[..., QUANTILES.index(0.5)], ~image.valid, quantiles, lost)
        key = jax.random.fold_in(jax.random.key(seed), k)
        even = None if grain is None else ranks_of_fields(grain, breaks_in(image), key)
        pictures.append(jax.device_get(drawn(says, key, None if even is None else Ranks(even, even))))
    return pictures


def classify(network: TrainedNetwork, inputs: Sequence[np.ndarray]) -> list[Int[np.ndarray, "rows columns"]]:
    """The likeliest class of each cell, never 0."""
    return [1 + np.asarray(network(x))[..., 1:].argmax(-1) for x in inputs]
