"""Labelled range images, as SqueezeSeg and its successors keep SemanticKITTI and nuScenes, as scans.

Their rows are bins of elevation more than beams, for the car's motion was taken out: name the sensor (--log.sensor).
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import Int

from jaxsim.data.cityscapes import IDS
from jaxsim.data.logs.scan import Item, LogOptions, LogScan, Source
from jaxsim.data.range_images import MOST_CLASSES, intensity_scale, range_image_files, read_range_image
from jaxsim.data.semantic_kitti import LEARNING_CLASSES
from jaxsim.files import array_names, files_in


def range_image_items(path: Path, options: LogOptions) -> Iterator[Item]:
    """The images of a folder, each a scene of its own, or one file."""
    files = [path] if path.is_file() else range_image_files(path)
    ids = class_ids(options.classes)
    read = partial(_read, scale=options.full_scale or intensity_scale(files), ids=ids)
    for file in files:
        yield Item(file.stem, partial(read, file), (file,))


def class_ids(text: str) -> Int[np.ndarray, " 256"] | None:
    """Cityscapes ids by the number of a class, -1 for numbers without one; None for "". Raises ValueError for what is
    no class."""
    if not text:
        return None
    ids = np.full(MOST_CLASSES, -1, np.int32)
    if text == "semantickitti":
        ids[: len(LEARNING_CLASSES)] = [IDS[name] for name in LEARNING_CLASSES]
        return ids
    for pair in text.split(","):
        number, _, name = pair.partition(":")
        if not number.strip().isdecimal() or int(number) >= MOST_CLASSES or name.strip() not in IDS:
            raise ValueError(
                f"range images: --log.classes has {pair!r}; write semantickitti, or pairs of a number and a class, "
                f"0:road,2:building; known: {', '.join(IDS)}"
            )
        ids[int(number)] = IDS[name.strip()]
    return ids


def _read(file: Path, *, scale: float, ids: np.ndarray | None) -> LogScan:
    image = read_range_image(file, scale)
    layers: dict[str, np.ndarray] = {}
    if ids is not None:
        if strange := sorted({*np.unique(image.label[image.valid]).tolist()} - {*np.flatnonzero(ids >= 0).tolist()}):
            raise ValueError(
                f"range images: {file} has class {', '.join(map(str, strange[:6]))}, which --log.classes does not "
                "name; add it (NUMBER:unlabeled where it means nothing)"
            )
        layers["semantic"] = np.where(image.valid, ids[image.label], 0).astype(np.int32).ravel()
    return LogScan(
        name=image.name,
        scene=image.name,
        xyz_m=image.xyz_m.reshape(-1, 3).astype(np.float32),  # at the origin where nothing came back
        intensity=image.intensity.ravel(),
        full_scale=1.0,
        columns=image.range_m.shape[1],
        layers=layers,
    )


def _takes(path: Path) -> bool:
    files = [path] if path.suffix == ".npz" and path.is_file() else files_in(path, ".npz") if path.is_dir() else []
    return bool(files) and "scan" in array_names(files[0], by="range images")


SOURCES: dict[str, Source] = {
    "range_images": Source("range images: NAME.npz of x y z intensity range label", _takes, range_image_items),
}
