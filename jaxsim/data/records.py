"""A training pair on disk: the arrays of one frame by name, the same in the cache and in a prepared set, and the
settings that they depend on.

`ARRAYS` is the catalogue. Letters of its shapes: r laser lines and c columns of the frame's polar window. Names are
those of `jaxsim.frame`, with `/` where a struct holds another.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Bool
from pydantic import TypeAdapter

from jaxsim.config import DataConfig, PrepareConfig
from jaxsim.config.ranges import settings_of
from jaxsim.files import sha256_of
from jaxsim.frame import Camera, CameraFrame, Painted, Pair, PolarGrid, PolarImage

LABELS = {"semantic", "edges"}
"""Inputs that need class labels."""
IMAGES = {"rgb", "surroundings"}
"""Inputs that need an image."""
_SEEN = {"classes": [], "network_size": [0, 0], "max_range_m": 0.0}
"""Settings of how a network sees a pair, which change none, and what is kept in their places."""
Example = dict[str, Any]
"""A record's values by name, flat."""

ARRAYS: dict[str, tuple[str, type, str]] = {
    "painted/range_m": ("r c", np.float32, "distance from the beam's origin to the camera pixel's point"),
    "painted/depth_m": ("r c", np.float32, "planar depth of the camera pixel"),
    "painted/rgb": ("r c 3", np.float32, "colour of the camera pixel, 0..1"),
    "painted/semantic": ("r c", np.int32, "Cityscapes id, 0 unlabeled"),
    "painted/instance": ("r c", np.int32, "object number in the frame, 0 none"),
    "painted/valid": ("r c", np.bool_, "a camera pixel with known depth fell into the cell"),
    "painted/occluded": ("r c", np.bool_, "pixels of clearly different depth fell into it: don't care"),
    "edges": ("r c", np.bool_, "border between classes or objects, found on this window"),
    "incidence_rad": ("r c", np.float32, "angle between ray and surface normal, pi/2 where unknown"),
    "row": ("r c", np.float32, "laser line, 0 the sensor's top, 1 its bottom"),
    "target": ("r c", np.float32, "intensity to learn, denoised if configured; 0 without return"),
    "measured/range_m": ("r c", np.float32, "range that the LiDAR measured"),
    "measured/intensity": ("r c", np.float32, "intensity that it measured, 0..1"),
    "measured/valid": ("r c", np.bool_, "the beam came back"),
    "grid/azimuth_rad": ("c", np.float32, "of each column's centre, falling"),
    "grid/elevation_rad": ("r", np.float32, "of each beam, top first"),
    "grid/origin_m": ("r", np.float32, "height of each beam's origin"),
    "camera/intrinsics": ("3 3", np.float64, "of the whole image, before it was cropped"),
    "camera/cam_from_velo": ("4 4", np.float64, "the camera's place on the LiDAR"),
    "image_size": ("2", np.int32, "rows and columns of the whole image"),
}


@dataclass(frozen=True)
class PairRecord:
    """One frame's pair, and where it is from."""

    name: str
    scene: str
    position: int
    """Number of the frame in its data set."""
    pair: Pair
    edges: Bool[np.ndarray, "r c"]
    """Grid of the window; the network's own are found at its size."""
    grid: PolarGrid
    camera: Camera
    image_size: tuple[int, int]
    has_image: bool = True
    """Whether the frame has one; where not, the pair's colours are black."""

    @property
    def view(self) -> CameraFrame:
        """The frame's camera, with a black image of the right size: a record does not keep the image."""
        black = np.broadcast_to(np.zeros((), np.uint8), (*self.image_size, 3))
        return CameraFrame(rgb=black, camera=self.camera)


def _holes(kind: type) -> dict[str, int]:
    return {field.name: 0 for field in fields(kind)}


_TREE = {
    "pair": Pair(
        **{**_holes(Pair), "painted": Painted(**_holes(Painted)), "measured": PolarImage(**_holes(PolarImage))}
    ),
    "grid": PolarGrid(**_holes(PolarGrid)),
    "camera": Camera(**_holes(Camera)),
}

_SCALARS = {"name": ("", np.str_), "scene": ("", np.str_), "position": ("", np.integer), "has_image": ("", np.bool_)}


def _names() -> list[str]:
    """The names of the tree's leaves, in their order."""
    paths = jax.tree_util.tree_flatten_with_path(_TREE)[0]
    names = [jax.tree_util.keystr(path, simple=True, separator="/").removeprefix("pair/") for path, _ in paths]
    # Sets that are written already call it so.
    return ["row" if name == "row_share" else name for name in names]


def example_of(record: PairRecord) -> Example:
    """The record's values by name: the arrays of `ARRAYS`, and `name`, `scene`, `position`."""
    leaves = jax.tree.leaves({"pair": record.pair, "grid": record.grid, "camera": record.camera})
    values: Example = dict(zip(_names(), leaves, strict=True))
    values |= {"edges": record.edges, "image_size": np.array(record.image_size)}
    arrays = {name: np.asarray(values[name]).astype(ARRAYS[name][1], casting="same_kind") for name in ARRAYS}
    return {"name": record.name, "scene": record.scene, "position": record.position, **arrays}


def kept_of(record: PairRecord) -> Example:
    """The record's values as the cache keeps them: `example_of`, and `has_image`, which records of a prepared set do
    not hold, for sets of before would be of another format: their metadata has it."""
    return example_of(record) | {"has_image": record.has_image}


def check_pictured(name: str, inputs: Collection[str], *, has_image: bool) -> None:
    """Raises ValueError where a pair of this name has no image, and these inputs need one."""
    needs = [one for one in inputs if one in IMAGES]
    if needs and not has_image:
        raise ValueError(
            f"prepared: {name} has no image, which the inputs {' and '.join(needs)} need; leave them out of "
            "--prepare.inputs, or choose frames that have one"
        )


def check_example(example: Mapping[str, Any]) -> None:
    """Raises ValueError where a value is not of the catalogue's type or shape, or arrays of a letter differ in it."""
    sizes: dict[str, int] = {}
    for name, value in example.items():
        dims, dtype = _SCALARS[name] if name in _SCALARS else ARRAYS[name][:2]
        array = np.asarray(value)
        right = np.issubdtype(array.dtype, dtype) and array.ndim == len(dims.split())
        for dim, n in zip(dims.split(), array.shape, strict=False):
            right = right and n == (int(dim) if dim.isdigit() else sizes.setdefault(dim, n))
        if not right:
            raise ValueError(f"{name} is {array.dtype} {array.shape}, not {dtype.__name__} ({dims.replace(' ', ', ')})")


def record_of(example: Mapping[str, Any]) -> PairRecord:
    """The record of these values. Raises KeyError for a missing one; where they do not say whether there was an image,
    one that is all black is none."""
    tree = jax.tree.unflatten(jax.tree.structure(_TREE), [example[name] for name in _names()])
    rows, columns = example["image_size"]
    return PairRecord(
        name=str(example["name"]),
        scene=str(example["scene"]),
        position=int(example["position"]),
        edges=example["edges"],
        image_size=(int(rows), int(columns)),
        has_image=bool(example.get("has_image", example["painted/rgb"].any())),
        **tree,
    )


class Entry(NamedTuple):
    """What is known of a pair without reading it."""

    name: str
    scene: str
    window: tuple[int, int]
    """Laser lines and columns."""
    key: str
    """Names the pair's settings and its frame: pairs of the same key are the same."""


class PreparedPairs(Sequence):  # of Pair: unnamed, else checks of types would read pairs
    """Pairs by number, read from disk when asked for."""

    def __init__(self, entries: Sequence[Entry], read: Callable[[int], PairRecord]):
        self.entries, self.record = list(entries), read

    def __len__(self) -> int:
        return len(self.entries)

    def __getitem__(self, i: Any) -> Any:
        if isinstance(i, slice):
            chosen = range(len(self))[i]
            return PreparedPairs(self.entries[i], lambda k: self.record(chosen[k]))
        if not -len(self) <= i < len(self):
            raise IndexError(f"pair {i} of {len(self)}")
        return self.record(i % len(self)).pair

    def __add__(self, other: PreparedPairs) -> PreparedPairs:
        own = len(self)
        both = [*self.entries, *other.entries]
        return PreparedPairs(both, lambda i: self.record(i) if i < own else other.record(i - own))

    @property
    def names(self) -> list[str]:
        """The frames' names."""
        return [entry.name for entry in self.entries]

    @property
    def scenes(self) -> list[str]:
        """The scene of each frame."""
        return [entry.scene for entry in self.entries]

    @property
    def keys(self) -> list[str]:
        """The key of each pair, which tells its frame and how it was prepared."""
        return [entry.key for entry in self.entries]

    @property
    def windows(self) -> set[tuple[int, int]]:
        """Lines and columns of the frames' polar windows: more than one where drives differ in calibration."""
        return {entry.window for entry in self.entries}


def pair_settings(data: DataConfig, prepare: PrepareConfig) -> dict[str, Any]:
    """`data` and `prepare` as plain values, without what changes no pair. But a frame without labels is an error where
    labels are asked for, so `prepare.inputs` still says whether they were. A file of weights is named by its contents.

    Raises FileNotFoundError where it is missing.
    """
    paired = TypeAdapter(PrepareConfig).dump_python(prepare, mode="json")
    labels = ["semantic"] if LABELS & {*prepare.inputs} else []
    values = {
        "data": TypeAdapter(DataConfig).dump_python(data.bare, mode="json"),
        "prepare": paired | _SEEN | {"inputs": labels},
    }
    for name in settings_of(PrepareConfig, "weights"):
        if (path := getattr(prepare, name)) is not None:
            values["prepare"][name] = contents_of(path)
    return values


def contents_of(path: Path) -> str:
    """Names a file of weights by what it holds. Raises FileNotFoundError where it is missing."""
    if not path.is_file():
        raise FileNotFoundError(f"prepare: no weights at {path}; jaxsim convert writes them")
    return f"SHA-256 {sha256_of(path)}"
