"""The prepared pairs of a data set, made once and kept on disk, one file a frame."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import jax
import numpy as np
from pydantic import TypeAdapter
from tqdm import tqdm

import jaxsim
from jaxsim.atomic import replacing
from jaxsim.config import DataConfig, PrepareConfig
from jaxsim.devices import wait
from jaxsim.frame import Painted, Pair, PolarGrid, PolarImage
from jaxsim.prepare import prepare_frame


def _holes(kind: type) -> dict[str, int]:
    return {field.name: 0 for field in fields(kind)}


TEMPLATE = Pair(**{**_holes(Pair), "painted": Painted(**_holes(Painted)), "measured": PolarImage(**_holes(PolarImage))})


def _names() -> list[str]:
    paths = jax.tree_util.tree_flatten_with_path(TEMPLATE)[0]
    return [jax.tree_util.keystr(path, simple=True, separator=".") for path, _ in paths]


def _code() -> bytes:
    """All code that preparation runs: pairs made by other code are not these pairs."""
    root = Path(jaxsim.__file__).parent
    files = [p for part in ("data", "geometry", "prepare") for p in sorted((root / part).rglob("*.py"))]
    return b"".join(path.read_bytes() for path in [*files, root / "frame.py"])


def weights_digest(prepare: PrepareConfig) -> bytes:
    """Of the contents of the weights that preparation uses: pairs made with others are not these pairs.

    Raises FileNotFoundError where a named file is missing.
    """
    used = [path for path in (prepare.denoise_weights,) if path is not None]
    if missing := [str(path) for path in used if not path.is_file()]:
        raise FileNotFoundError(f"prepare: no weights at {', '.join(missing)}; jaxsim convert writes them")
    return b"".join(hashlib.sha256(path.read_bytes()).digest() for path in used)


def cache_folder(data: DataConfig, prepare: PrepareConfig) -> Path:
    """Where pairs of these settings are kept: the name depends on all that they depend on."""
    # Which frames are used and which channels the network sees changes no pair; but a frame without labels is an
    # error where labels are asked for, so such pairs are not shared.
    labels = ("semantic",) if {"semantic", "edges"} & {*prepare.inputs} else ()
    bare = replace(data, train="", validation="", cache=Path(), root=data.root and data.root.resolve())
    settings = TypeAdapter(DataConfig).dump_json(bare)
    settings += TypeAdapter(PrepareConfig).dump_json(replace(prepare, inputs=labels, network_size=(0, 0), classes=()))
    settings += weights_digest(prepare)
    return data.cache / f"{data.kind}-{hashlib.sha256(settings + _code()).hexdigest()[:16]}"


class PreparedPairs(Sequence[Pair]):
    """Pairs by position, read from disk when asked for."""

    def __init__(self, files: Sequence[Path]):
        self.files = list(files)
        self.names, self.scenes, self.grids = [], [], []
        for file in self.files:
            with np.load(file) as archive:
                self.names.append(str(archive["name"]))
                self.scenes.append(str(archive["scene"]))
                self.grids.append(PolarGrid(*(archive[f"grid.{field.name}"] for field in fields(PolarGrid))))

    def __len__(self) -> int:
        return len(self.files)

    def __getitem__(self, i: Any) -> Any:
        with np.load(self.files[i]) as archive:
            leaves = [archive[name] for name in _names()]
        return jax.tree.unflatten(jax.tree.structure(TEMPLATE), leaves)

    @property
    def windows(self) -> set[tuple[int, int]]:
        """Lines and columns of the frames' polar windows: more than one where drives differ in calibration."""
        return {(len(grid.elevation_rad), len(grid.azimuth_rad)) for grid in self.grids}


def prepared(dataset: Any, positions: Sequence[int], data: DataConfig, prepare: PrepareConfig) -> PreparedPairs:
    """The pairs at these positions of a data set; makes those that are not kept yet.

    A killed run keeps what it has made. Several processes divide the work; where they share no disk, each then
    makes the rest for itself.
    """
    folder = cache_folder(data, prepare)
    files = [folder / f"{i:06d}.npz" for i in positions]
    me, processes = jax.process_index(), jax.process_count()
    if processes > 1:
        _make(dataset, positions[me::processes], folder, data, prepare)
        wait("prepared pairs")
    _make(dataset, positions, folder, data, prepare)
    return PreparedPairs(files)


def _make(dataset: Any, positions: Sequence[int], folder: Path, data: DataConfig, prepare: PrepareConfig) -> None:
    missing = [i for i in positions if not (folder / f"{i:06d}.npz").is_file()]
    for i in tqdm(missing, desc=f"preparing {data.kind}", unit="frame", disable=not missing):
        frame = dataset[i]
        pair, grid = prepare_frame(frame, dataset.spec, prepare)
        with replacing(folder / f"{i:06d}.npz") as path:
            arrays: dict[str, Any] = dict(zip(_names(), jax.tree.leaves(pair), strict=True))
            arrays |= {f"grid.{field.name}": np.asarray(getattr(grid, field.name)) for field in fields(PolarGrid)}
            np.savez(path, **arrays, name=np.array(frame.name), scene=np.array(frame.scene))
