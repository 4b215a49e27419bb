"""Which images simulate, learn or are judged when; their scores, each kept in a file of its own, and the table."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from jaxsim.config import QUANTILES, SegmentationConfig
from jaxsim.data.logs.range_images import RangeImage, class_names, read_range_images
from jaxsim.files import read_arrays, read_entry, write_arrays, write_text
from jaxsim.metrics.intervals import mean_interval
from jaxsim.report.results import markdown_table
from jaxsim.simulate.grain_fit import fit_intensity
from jaxsim.studies.segmentation import networks

INTENSITIES = ("none", "simulated", "measured")
"""Intensities that networks learn from, in the order of the table."""
NOTHING_IOU = 0.0005
"""Gains of mean IoU up to this are printed as 0."""
Confusion = Int[np.ndarray, "classes classes"]
"""Cells by true class (rows) and told class (columns), of all that returned and have a label."""


def check_parts(parts: int, images: int, *, elsewhere: bool) -> None:
    """Raises ValueError where so many images cannot be cut into so many parts, or these are too few to learn from:
    what is judged is one of them, or `elsewhere`."""
    fewest = 2 if elsewhere else 3
    if parts < fewest or images < parts:
        raise ValueError(
            f"segmentation: {images} images in {parts} parts; "
            + ("of two parts each" if elsewhere else "a part is judged, and of two others each")
            + f" simulates for the other: give {fewest} parts or more, and an image for each"
        )


class Study:
    """One folder's images, sensors and scores."""

    def __init__(
        self,
        config: SegmentationConfig,
        images: Sequence[RangeImage],
        *,
        judged: Sequence[RangeImage] | None = None,
    ):
        check_parts(config.parts, len(images), elsewhere=judged is not None)
        for said, of_kind in (("learn from", images), ("judge", judged)):
            if of_kind is not None and not any(image.label.any() for image in of_kind):
                raise ValueError(
                    f"segmentation: no cell of the {len(of_kind)} images to {said} has a label; labels are numbers of "
                    "classes from 1 on, 0 is none"
                )
        self.config = config
        self.images = images
        self.judged = judged
        self.classes = 1 + max(int(image.label.max()) for image in (*images, *(judged or ())))
        self.names: Sequence[str] = [f"class {number}" for number in range(self.classes)]
        self.part = np.arange(len(images)) * config.parts // len(images)
        self.rounds: tuple[int | None, ...] = tuple(range(config.parts)) if judged is None else (None,)
        """Parts that are judged one after the other; None: other images, by what learned from all parts."""

    @classmethod
    def of_folders(cls, config: SegmentationConfig, root: Path, judged: Path | None) -> Study:
        """Reads the images. Raises ValueError where the two folders are of different sensors."""
        images = read_range_images(root)
        others = None if judged is None else read_range_images(judged)
        if others is not None and others[0].range_m.shape != images[0].range_m.shape:
            raise ValueError(
                f"segmentation: images of {judged} have {others[0].range_m.shape} cells, those of {root} "
                f"{images[0].range_m.shape}; judge frames of the same sensor"
            )
        study = cls(config, images, judged=others)
        study.names = class_names(root, study.classes)
        return study

    def own(self, part: int) -> list[int]:
        return [int(i) for i in np.flatnonzero(self.part == part)]

    def others(self, *parts: int | None) -> list[int]:
        return [int(i) for i in np.flatnonzero(~np.isin(self.part, [part for part in parts if part is not None]))]

    def to_judge(self, part: int | None) -> Sequence[RangeImage]:
        """The images of a part, or of the other folder."""
        return (self.judged or ()) if part is None else [self.images[i] for i in self.own(part)]

    def simulated(self, part: int, judged: int | None) -> list[Float[np.ndarray, "rows columns"]]:
        """Intensities of a part's images by a sensor that learned from neither it nor the judged part; kept."""
        config = self.config
        path = config.out / "intensity" / f"part{part}{'' if judged is None else f'_without{judged}'}.npz"
        if not path.is_file():
            inputs = [networks.of_learned_sensor(image, self.classes) for image in self.images]
            learned = self.others(part, judged)
            targets = [
                {"intensity": self.images[i].intensity, "weight": self.images[i].valid.astype(np.float32)}
                for i in learned
            ]
            network = networks.train_network(
                [inputs[i] for i in learned],
                targets,
                networks.intensity_loss,
                out_channels=len(QUANTILES) + 1,
                steps=config.sensor_steps,
                seed=0,
                config=config,
            )
            scans = (networks.grain_scan(self.images[i], networks.quantiles_of(network, inputs[i])) for i in learned)
            grain = fit_intensity(scans) if config.grain else None
            own = self.own(part)
            made = networks.simulate(
                network, [inputs[i] for i in own], [self.images[i] for i in own], grain=grain, seed=part
            )
            write_arrays(path, {"intensity": np.stack(made)})
        again = "delete it, and it is made anew"
        return [*read_arrays(path, by="segmentation", again=again, summed=True)["intensity"]]

    def intensities(self, kind: str, judged: int | None) -> dict[int, Float[np.ndarray, "rows columns"]]:
        """Of each training image."""
        if kind == "simulated":
            parts = [part for part in range(self.config.parts) if part != judged]
            return {i: x for p in parts for i, x in zip(self.own(p), self.simulated(p, judged), strict=True)}
        return {i: self.images[i].intensity * (kind == "measured") for i in self.others(judged)}

    def path(self, kind: str, part: int | None, seed: int) -> Path:
        judged = "elsewhere" if part is None else f"part{part}"
        return self.config.out / "scores" / f"{kind}_{judged}_seed{seed}.json"

    def score(self, kind: str, part: int | None, seed: int) -> None:
        """Trains on all other parts with this kind of intensity and judges on the measured part, unless that is
        done. A network without intensity is judged without."""
        path = self.path(kind, part, seed)
        if path.is_file():
            return
        chosen = self.intensities(kind, part)
        count = np.bincount(np.concatenate([self.images[i].label.ravel() for i in chosen]), minlength=self.classes)
        rarity = (1 / np.sqrt(np.maximum(count, 1) / max(count[1:].sum(), 1))).astype(np.float32)
        rarity[0] = 0
        inputs = [networks.of_segmentation(self.images[i], x) for i, x in chosen.items()]
        targets = [{"label": self.images[i].label, "weight": rarity[self.images[i].label]} for i in chosen]
        network = networks.train_network(
            inputs,
            targets,
            networks.class_loss,
            out_channels=self.classes,
            steps=self.config.steps,
            seed=seed,
            config=self.config,
        )
        judged = self.to_judge(part)
        predicted = networks.classify(
            network, [networks.of_segmentation(image, image.intensity * (kind != "none")) for image in judged]
        )
        confusions = sum(
            confusion(image.label, guess, self.classes) for image, guess in zip(judged, predicted, strict=True)
        )
        write_text(path, json.dumps({"confusion": np.asarray(confusions).tolist()}))

    def iou(self, kind: str) -> Float[np.ndarray, "seeds known"]:
        """IoU of each class over all parts; NaN where a class has no cell. Class 0 is left out."""
        shares = []
        for seed in self.config.seeds:
            paths = [self.path(kind, part, seed) for part in self.rounds]
            read = [read_entry(path, "confusion", list[list[int]], by="segmentation") for path in paths]
            shares.append(class_iou(np.sum(np.array(read), axis=0)))
        return np.stack(shares)

    def plain(self) -> dict[str, object]:
        """All figures for JSON."""
        of = {kind: self.iou(kind) for kind in INTENSITIES}
        return {"iou": of, "mean": {kind: mean_iou(iou) for kind, iou in of.items()}, "worth": worth(of)}

    def text(self) -> str:
        """Markdown: IoU a class and their mean, of each kind; what simulated intensity is worth."""
        of = {kind: self.iou(kind) for kind in INTENSITIES}
        judged = [image for part in self.rounds for image in self.to_judge(part)]
        cells = np.bincount(np.concatenate([image.label.ravel() for image in judged]), minlength=self.classes)
        rows = [
            [self.names[k + 1], str(int(cells[k + 1])), *(_cell(of[kind][:, k]) for kind in INTENSITIES)]
            for k in range(self.classes - 1)
            if cells[k + 1]
        ]
        rows.append(["mean", str(int(cells[1:].sum())), *(_cell(np.nanmean(of[kind], axis=1)) for kind in INTENSITIES)])
        heads = ["IoU", "cells", "no intensity", "simulated", "measured"]
        share = worth(of)
        gain = mean_iou(of["measured"]) - mean_iou(of["none"])
        words = (
            f"Measured intensity is worth {gain:+.3f} of mean IoU; simulated intensity {100 * share:.0f} % of that."
            if np.isfinite(share)
            else f"Measured intensity is worth {gain:+.3f} of mean IoU: nothing, or no more than seeds may scatter by, "
            "so simulated intensity has nothing to be measured by."
        )
        seeds = len(self.config.seeds)
        words += " One seed: the spread is not known." if seeds == 1 else ""
        head = f"{len(self.images)} images, {self.config.parts} parts, each judged by what learned from the others; "
        if self.judged is not None:
            head = f"{len(self.images)} images, and {len(self.judged)} others to judge; "
        return f"{head}{seeds} seed{'s' * (seeds > 1)}.\n\n{markdown_table(heads, rows)}\n\n{words}"


def confusion(label: Int[np.ndarray, "*n"], predicted: Int[np.ndarray, "*n"], classes: int) -> Confusion:
    """Labelled cells (class above 0) by true and told class."""
    known = label > 0
    return np.bincount(classes * label[known] + predicted[known], minlength=classes**2).reshape(classes, classes)


def class_iou(cells: Confusion) -> Float[np.ndarray, " known"]:
    """Intersection over union of classes 1 on; NaN where a class is not there.

    What is told of a class that is not there counts against the others, which it was not told to be: as a 0 of its own
    it would change the number of classes that a mean is over from network to network.
    """
    there = cells.sum(1)[1:]
    hits = np.diag(cells)[1:].astype(float)
    return np.where(there > 0, hits / np.maximum(cells.sum(0)[1:] + there - hits, 1), np.nan)


def mean_iou(iou: Float[np.ndarray, "seeds known"]) -> float:
    """Over the classes that are there, then over seeds."""
    return float(np.nanmean(iou, axis=1).mean())


def worth(iou: Mapping[str, Float[np.ndarray, "seeds known"]]) -> float:
    """What simulated intensity gains over none, as a share of what measured intensity does; NaN where that is nothing,
    may be nothing by the interval over seeds (90 %), or is that of one seed alone."""
    mean = {kind: mean_iou(iou[kind]) for kind in INTENSITIES}
    room = mean["measured"] - mean["none"]
    by_seed = np.nanmean(iou["measured"], axis=1) - np.nanmean(iou["none"], axis=1)
    sure = len(by_seed) > 1 and mean_interval(by_seed)[0] > 0
    return (mean["simulated"] - mean["none"]) / room if sure and room > NOTHING_IOU else float("nan")


def _cell(values: Float[np.ndarray, " seeds"]) -> str:
    if not np.isfinite(values).any():
        return "-"
    spread = f" ± {np.nanstd(values, ddof=1):.3f}" if len(values) > 1 else ""
    return f"{np.nanmean(values):.3f}{spread}"
