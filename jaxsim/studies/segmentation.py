"""What simulated intensity is worth to who tells classes apart: segmentation of range images.

The loop of SqueezeSegV2 (Wu et al. 2019), whose intensities are rendered by a network that learned them from real
scans, with three kinds of training images of the same geometry and labels:

none        no intensity
simulated   that of a sensor which learned it from other parts, from range, place, line and class, and never saw these
measured    the sensor's own

All are judged on measured intensities of parts that neither network saw. OUT/settings.json, OUT/intensity/PART.npz,
OUT/scores/KIND_part0_seed0.json, OUT/segmentation.{md,json}. Its many small networks are no runs
of `jaxsim.train`: they learn in memory (`jaxsim.descent`), and what they tell is kept.
"""

from __future__ import annotations

import json
import logging
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
from pydantic import TypeAdapter

from jaxsim.config import QUANTILES, GeneratorConfig, SegmentationConfig
from jaxsim.data.range_images import RangeImage, read_range_images
from jaxsim.descent import descend
from jaxsim.files import claim, parse_json, parse_settings, read_entry, replacing, write_arrays
from jaxsim.files.arrays import read_arrays
from jaxsim.frame import Array
from jaxsim.pix2pix.convolution import compiler_options, on_cpu
from jaxsim.pix2pix.losses import quantile_loss
from jaxsim.pix2pix.unet import UNet
from jaxsim.progress import Progress
from jaxsim.report.results import markdown_table, number_or_none, write_results
from jaxsim.simulate.predict import Prediction, drawn

KINDS = ("none", "simulated", "measured")
"""Intensities that networks learn from, in the order of the table."""
Batch = dict[str, Array]
Loss = Callable[[Array, Batch], Array]
FARTHEST_M = 120.0
_log = logging.getLogger(__name__)

Confusion = Int[np.ndarray, "classes classes"]
"""Cells by true class (rows) and told class (columns), of all that returned and have a label."""


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


def of_sensor(image: RangeImage, classes: int) -> np.ndarray:
    """Inputs of the sensor: geometry, laser line and class, one channel each."""
    rows, columns = image.range_m.shape
    line = np.broadcast_to(np.eye(rows, dtype=np.float32)[:, None], (rows, columns, rows))
    return np.concatenate([geometry(image), line, np.eye(classes, dtype=np.float32)[image.label]], -1).astype(
        np.float32
    )


def class_loss(outputs: Float[Array, "b h w k"], batch: Batch) -> Float[Array, ""]:
    """Cross entropy of the labelled cells, each class weighted by the root of its rarity."""
    logits = jax.nn.log_softmax(outputs, axis=-1)
    right = (logits * jax.nn.one_hot(batch["label"], outputs.shape[-1])).sum(-1)
    return -(batch["weight"] * right).sum() / jnp.maximum(batch["weight"].sum(), 1e-6)


def sensor_loss(outputs: Float[Array, "b h w k"], batch: Batch) -> Float[Array, ""]:
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

    def step(learned: tuple[Any, Any], x: Array, batch: Batch) -> tuple[tuple[Any, Any], Float[Array, ""]]:
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


def train(
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

    def batch(random: np.random.Generator) -> tuple[np.ndarray, Batch]:
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


def simulate(
    network: TrainedNetwork, inputs: Sequence[np.ndarray], images: Sequence[RangeImage], *, seed: int
) -> list[Float[np.ndarray, "rows columns"]]:
    """Intensities of the images, drawn from what the sensor holds possible; 0 where nothing came back."""
    pictures = []
    for k, (x, image) in enumerate(zip(inputs, images, strict=True)):
        quantiles = jnp.clip(jnp.sort((network(x)[..., : len(QUANTILES)] + 1) / 2, axis=-1), 0, 1)
        lost = jnp.where(image.valid, 0.0, 1.0)
        says = Prediction(quantiles[..., QUANTILES.index(0.5)], ~image.valid, quantiles, lost)
        pictures.append(np.asarray(drawn(says, jax.random.fold_in(jax.random.key(seed), k))))
    return pictures


def classify(network: TrainedNetwork, inputs: Sequence[np.ndarray]) -> list[Int[np.ndarray, "rows columns"]]:
    """The likeliest class of each cell, never 0."""
    return [1 + np.asarray(network(x))[..., 1:].argmax(-1) for x in inputs]


def run_segmentation(config: SegmentationConfig) -> Path:
    """Runs all that is missing, prints the table and gives its path.

    Raises ValueError where there are no range images, or too few for the parts, and where OUT holds other settings.
    """
    if config.root is None:
        raise ValueError("segmentation: name the folder of labelled range images with --root")
    if not config.seeds or len({*config.seeds}) < len(config.seeds):
        raise ValueError(f"segmentation: --seeds are {config.seeds}; give some, and each once")
    if config.network.form != "unet":
        raise ValueError(f"segmentation: --network.form is {config.network.form}; both networks are a unet")
    images = read_range_images(config.root)
    if config.parts < 3 or len(images) < config.parts:
        raise ValueError(
            f"segmentation: {len(images)} images in {config.parts} parts; a part is judged, and of two others each "
            "simulates for the other: give 3 parts or more, and an image for each"
        )
    _settle(config)
    study = Study(config, images)
    for part in Progress(range(config.parts), desc="parts", unit="part"):
        for seed in config.seeds:
            for kind in KINDS:
                study.score(kind, part, seed)
    text = study.text()
    _log.info(text)
    return write_results(config.out, "segmentation", study.plain(), text=text)


def _settle(config: SegmentationConfig) -> None:
    adapter = TypeAdapter(SegmentationConfig)
    claim(
        config.out / "settings.json",
        adapter.dump_python(config, mode="json"),
        by="segmentation",
        text=adapter.dump_json(config, indent=1),
        read=lambda record: adapter.dump_python(parse_settings(SegmentationConfig, parse_json(record)), mode="json"),
        free=("seeds", "out"),
    )


@dataclass(frozen=True)
class Worth:
    """Mean IoU of a kind over the classes that are there: over seeds, and their standard deviation."""

    mean: float
    spread: float | None


class Study:
    """One folder's images, sensors and scores."""

    def __init__(self, config: SegmentationConfig, images: Sequence[RangeImage]):
        self.config, self.images = config, images
        self.classes = 1 + max(int(image.label.max()) for image in images)
        self.part = np.arange(len(images)) * config.parts // len(images)

    def own(self, part: int) -> list[int]:
        return [int(i) for i in np.flatnonzero(self.part == part)]

    def others(self, *parts: int) -> list[int]:
        return [int(i) for i in np.flatnonzero(~np.isin(self.part, parts))]

    def simulated(self, part: int, judged: int) -> list[Float[np.ndarray, "rows columns"]]:
        """Intensities of a part's images by a sensor that learned from neither it nor the judged part; kept."""
        config = self.config
        path = config.out / "intensity" / f"part{part}_without{judged}.npz"
        if not path.is_file():
            inputs = [of_sensor(image, self.classes) for image in self.images]
            learned = self.others(part, judged)
            targets = [
                {"intensity": self.images[i].intensity, "weight": self.images[i].valid.astype(np.float32)}
                for i in learned
            ]
            network = train(
                [inputs[i] for i in learned],
                targets,
                sensor_loss,
                out_channels=len(QUANTILES) + 1,
                steps=config.sensor_steps,
                seed=0,
                config=config,
            )
            folder = self.own(part)
            made = simulate(network, [inputs[i] for i in folder], [self.images[i] for i in folder], seed=part)
            write_arrays(path, {"intensity": np.stack(made)})
        again = "delete it, and it is made anew"
        return [*read_arrays(path, by="segmentation", again=again, summed=True)["intensity"]]

    def intensities(self, kind: str, judged: int) -> dict[int, Float[np.ndarray, "rows columns"]]:
        """Of each training image."""
        if kind == "simulated":
            parts = [part for part in range(self.config.parts) if part != judged]
            return {i: x for p in parts for i, x in zip(self.own(p), self.simulated(p, judged), strict=True)}
        return {i: self.images[i].intensity * (kind == "measured") for i in self.others(judged)}

    def path(self, kind: str, part: int, seed: int) -> Path:
        return self.config.out / "scores" / f"{kind}_part{part}_seed{seed}.json"

    def score(self, kind: str, part: int, seed: int) -> None:
        """Trains on all other parts with this kind of intensity and judges on the measured part, unless that is
        done. A network without intensity is judged without."""
        path = self.path(kind, part, seed)
        if path.is_file():
            return
        chosen = self.intensities(kind, part)
        count = np.bincount(np.concatenate([self.images[i].label.ravel() for i in chosen]), minlength=self.classes)
        rarity = (1 / np.sqrt(np.maximum(count, 1) / max(count[1:].sum(), 1))).astype(np.float32)
        rarity[0] = 0
        inputs = [of_segmentation(self.images[i], x) for i, x in chosen.items()]
        targets = [{"label": self.images[i].label, "weight": rarity[self.images[i].label]} for i in chosen]
        network = train(
            inputs,
            targets,
            class_loss,
            out_channels=self.classes,
            steps=self.config.steps,
            seed=seed,
            config=self.config,
        )
        judged = [self.images[i] for i in self.own(part)]
        told = classify(network, [of_segmentation(image, image.intensity * (kind != "none")) for image in judged])
        confusions = sum(confusion(image.label, guess, self.classes) for image, guess in zip(judged, told, strict=True))
        with replacing(path) as temporary:
            temporary.write_text(json.dumps({"confusion": np.asarray(confusions).tolist()}))

    def iou(self, kind: str) -> Float[np.ndarray, "seeds known"]:
        """IoU of each class over all parts; NaN where a class has no cell. Class 0 is left out."""
        shares = []
        for seed in self.config.seeds:
            paths = [self.path(kind, part, seed) for part in range(self.config.parts)]
            read = [read_entry(path, "confusion", list[list[int]], by="segmentation") for path in paths]
            shares.append(class_iou(np.sum(np.array(read), axis=0)))
        return np.stack(shares)

    def plain(self) -> dict[str, object]:
        """All figures for JSON."""
        return {
            "iou": {kind: [[number_or_none(x) for x in row] for row in self.iou(kind)] for kind in KINDS},
            "mean": {kind: mean_iou(self.iou(kind)).mean for kind in KINDS},
            "worth": number_or_none(worth({kind: self.iou(kind) for kind in KINDS})),
        }

    def text(self) -> str:
        """Markdown: IoU a class and their mean, of each kind; what simulated intensity is worth."""
        of = {kind: self.iou(kind) for kind in KINDS}
        cells = np.bincount(np.concatenate([image.label.ravel() for image in self.images]), minlength=self.classes)
        rows = [
            [f"class {k + 1}", str(int(cells[k + 1])), *(_cell(of[kind][:, k]) for kind in KINDS)]
            for k in range(self.classes - 1)
            if cells[k + 1]
        ]
        rows.append(["mean", str(int(cells[1:].sum())), *(_cell(np.nanmean(of[kind], axis=1)) for kind in KINDS)])
        heads = ["IoU", "cells", "no intensity", "simulated", "measured"]
        share = worth(of)
        gain = mean_iou(of["measured"]).mean - mean_iou(of["none"]).mean
        words = (
            f"Measured intensity is worth {gain:+.3f} of mean IoU; simulated intensity {100 * share:.0f} % of that."
            if np.isfinite(share)
            else "Measured intensity is worth nothing here, so simulated intensity has nothing to be measured by."
        )
        seeds = len(self.config.seeds)
        words += " One seed: the spread is not known." if seeds == 1 else ""
        head = f"{len(self.images)} images, {self.config.parts} parts, each judged by what learned from the others; "
        return f"{head}{seeds} seed{'s' * (seeds > 1)}.\n\n{markdown_table(heads, rows)}\n\n{words}"


def confusion(label: Int[np.ndarray, "*n"], told: Int[np.ndarray, "*n"], classes: int) -> Confusion:
    """Labelled cells (class above 0) by true and told class."""
    known = label > 0
    return np.bincount(classes * label[known] + told[known], minlength=classes**2).reshape(classes, classes)


def class_iou(cells: Confusion) -> Float[np.ndarray, " known"]:
    """Intersection over union of classes 1 on; NaN where a class is neither there nor told."""
    hits = np.diag(cells)[1:].astype(float)
    union = cells.sum(0)[1:] + cells.sum(1)[1:] - hits
    return np.where(union > 0, hits / np.maximum(union, 1), np.nan)


def mean_iou(iou: Float[np.ndarray, "seeds known"]) -> Worth:
    """Over classes, then over seeds."""
    values = np.nanmean(iou, axis=1)
    return Worth(float(values.mean()), float(values.std(ddof=1)) if len(values) > 1 else None)


def worth(iou: Mapping[str, Float[np.ndarray, "seeds known"]]) -> float:
    """What simulated intensity gains over none, as a share of what measured intensity does; NaN where that is
    nothing."""
    mean = {kind: mean_iou(iou[kind]).mean for kind in KINDS}
    room = mean["measured"] - mean["none"]
    return (mean["simulated"] - mean["none"]) / room if room > 0 else float("nan")


def _cell(values: Float[np.ndarray, " seeds"]) -> str:
    if not np.isfinite(values).any():
        return "-"
    spread = f" ± {np.nanstd(values, ddof=1):.3f}" if len(values) > 1 else ""
    return f"{np.nanmean(values):.3f}{spread}"
