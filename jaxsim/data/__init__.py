"""Where frames come from: KITTI drives, renderers, the embedded world; LiDAR-only recordings as polar frames.

A data set is anything with a name, a sensor and a frame for every number:

    dataset = open_dataset(DataConfig(kind="kitti_raw", root=Path("kitti_raw")))
    frame = dataset[0]

A row of DATASETS a kind. Readers, with the files of their formats beside them:

    kitti, kitti_odometry, kitti_together, kitti_files   KITTI's raw drives, its benchmarks, all as one
    kitti_step, cityscapes                    panoptic labels, and the classes that all frames carry
    point_labels                              labels of points, and as rasters of the camera
    kitti_depth                               depth completion
    vkitti2, vkitti2_files, carla             renderers
    synthetic                                 the embedded world
    prepared_set, tfds_builder, records       pairs that `jaxsim prepare` made
    polar_frames, polar_checks, polar_views   `jaxsim discover`'s format, and as a data set of views
    sweeps, logs, clouds                      recordings of LiDARs alone
    calibration, select, turned, batches      what a calibration can be; frames by number; their other sides; batches
    seen                                      whether what judges is what was learned from
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

from jaxsim.config import DataConfig
from jaxsim.data.kitti import KittiObject, KittiRaw
from jaxsim.data.kitti_odometry import KittiOdometry
from jaxsim.data.kitti_step import KittiStep
from jaxsim.data.kitti_together import KittiTogether
from jaxsim.data.polar_views import PolarViews
from jaxsim.data.select import select
from jaxsim.data.sweeps import Sweep, read_lidar_top, read_pcap
from jaxsim.frame import Frame
from jaxsim.geometry import LidarSpec, camera_at_lidar, preset

__all__ = [
    "DATASETS",
    "Dataset",
    "DatasetKind",
    "KittiObject",
    "KittiOdometry",
    "KittiRaw",
    "KittiStep",
    "KittiTogether",
    "Sweep",
    "open_dataset",
    "read_lidar_top",
    "read_pcap",
    "select",
    "source_of",
]


@runtime_checkable
class Dataset(Protocol):
    """Frames by number, and the sensor that measured them.

    One may also have `splits`, positions by the name of a part: `select("training", dataset)` takes it; and `lacks`, by
    that name, what of a part is not there and what to do. One of files has `files_of(i)`, those of a frame: what was
    made of it is made anew once they have changed, or `told_of(i)`, a text of what a file of the whole set says of it.
    """

    name: str

    @property
    def spec(self) -> LidarSpec: ...

    def __len__(self) -> int: ...

    def __getitem__(self, index: int, /) -> Frame: ...

    def name_of(self, index: int, /) -> str:
        """The frame's name, without making the frame."""
        ...


def _synthetic(config: DataConfig) -> Dataset:
    from jaxsim.data.synthetic import SyntheticWorld, kitti_camera

    camera = camera_at_lidar(kitti_camera().intrinsics) if config.lidar == "camera" else None
    # At the sensor's full rate: with fewer columns than the camera's window asks for, gaps would look like drops.
    return SyntheticWorld(seed=config.seed, columns=preset("hdl64e").columns, camera=camera, streets=config.streets)


def _vkitti2(config: DataConfig) -> Dataset:
    from jaxsim.data.vkitti2 import VirtualKitti2

    return VirtualKitti2(
        _root(config), scenes=config.scenes, variations=config.variations, camera=config.camera, lidar=config.lidar
    )


def _prepared(config: DataConfig) -> Dataset:
    from jaxsim.data.prepared_set import PreparedSet

    return PreparedSet(_root(config))


@dataclass(frozen=True)
class DatasetKind:
    """What a kind of data set is to commands that know no more of it than its name."""

    open: Callable[[DataConfig], Dataset]
    licence: str = "other"
    """Of its files, by the name that model hubs use: what is learned from them must heed it."""
    of_scenes: bool = False
    """Whether some of its scenes can be chosen. Of pairs they are those that the frames were chosen by."""
    of_files: bool = True
    """Whether its frames lie in a folder."""


KITTIS = partial(DatasetKind, licence="cc-by-nc-sa-3.0")
"""A kind of KITTI's, or of Virtual KITTI's."""
DATASETS: dict[str, DatasetKind] = {
    "synthetic": DatasetKind(_synthetic, licence="apache-2.0", of_files=False),
    "kitti_raw": KITTIS(lambda config: KittiRaw(_root(config), rows=config.rows)),
    "kitti_object": KITTIS(lambda config: KittiObject(_root(config), rows=config.rows)),
    "kitti_tracking": KITTIS(
        lambda config: KittiStep(_root(config), sequences=config.scenes, rows=config.rows, panoptic=False),
        of_scenes=True,
    ),
    "kitti_step": KITTIS(
        lambda config: KittiStep(_root(config), sequences=config.scenes, rows=config.rows), of_scenes=True
    ),
    "kitti_odometry": KITTIS(
        lambda config: KittiOdometry(_root(config), sequences=config.scenes, rows=config.rows), of_scenes=True
    ),
    "kitti": KITTIS(lambda config: KittiTogether(_root(config), rows=config.rows)),
    "vkitti2": KITTIS(_vkitti2, of_scenes=True),
    "polar": DatasetKind(lambda config: PolarViews(_root(config))),
    "prepared": DatasetKind(_prepared, of_scenes=True),
}


_SIGNS = {
    "kitti_raw": "[12][0-9][0-9][0-9]_[0-9][0-9]_[0-9][0-9]",
    "kitti_object": "training/label_2",
    "kitti_tracking": "training/label_02",
    "kitti_odometry": "sequences",
    "vkitti2": "Scene[0-9][0-9]",
    "polar": "grid.json",
    "prepared": "jaxsim_pairs",
}
"""What lies in the folder of a kind and in no other's."""


def open_dataset(source: DataConfig | str, root: Path | str | None = None) -> Dataset:
    """The data set that a config, or a kind, names; in the folder `root`, where it is given.

    Raises ValueError for what is neither a kind nor a config, an unknown kind, a folder in its place, a root that is
    missing or that a kind does not read, and scenes of a kind that has no scenes to choose.
    """
    if isinstance(source, str) and source not in DATASETS and Path(source).is_dir():
        likely = next((kind for kind, sign in _SIGNS.items() if any(Path(source).glob(sign))), "KIND")
        raise ValueError(
            f"data: {source} is a folder, and a kind of data set comes before it: open_dataset({likely!r}, "
            f"{source!r}); known kinds: {', '.join(DATASETS)}"
        )
    if not isinstance(source, str | DataConfig):
        raise ValueError(
            f"data: the source is {source!r}; open_dataset takes a kind ({', '.join(DATASETS)}) or a DataConfig first"
        )
    # Any text may come: a config refuses a kind that is none.
    config = DataConfig(kind=source) if isinstance(source, str) else source  # type: ignore[arg-type]
    config = replace(config, root=Path(root)) if root else config
    if config.kind not in DATASETS:
        raise ValueError(f"data: no kind {config.kind!r}; known: {', '.join(DATASETS)}")
    kind = DATASETS[config.kind]
    if config.scenes and not kind.of_scenes:
        raise ValueError(
            f"data: kind {config.kind} takes no scenes ({' '.join(config.scenes)}): leave --data.scenes out, and name "
            "frames by numbers, or by a part of the set, as drive_0009 of kitti_raw"
        )
    if config.root and not kind.of_files:
        others = ", ".join(name for name, one in DATASETS.items() if one.of_files)
        raise ValueError(
            f"data: kind {config.kind} reads no files, and {config.root} was given as its folder: name the kind of "
            f"what lies there (--data.kind, of {others}), or leave --data.root out"
        )
    return kind.open(config)


def source_of(
    of_run: DataConfig, kind: str, *, root: Path | None = None, scenes: tuple[str, ...] = (), **more: Any
) -> DataConfig:
    """The data that a command asks for: `of_run` where `kind` is `same`, or another set, in its own folder.

    `root` and `scenes`, where they are given, also replace those of the run; `more` are further fields.
    """
    if kind == "same":
        return replace(of_run, root=root or of_run.root, scenes=scenes or of_run.scenes, **more)
    # The same: whatever the text is, a config checks it.
    return replace(of_run, kind=kind, root=root, scenes=scenes, **more)  # type: ignore[arg-type]


def _root(config: DataConfig) -> Path:
    if config.root is None:
        raise ValueError(f"data: kind {config.kind} reads files; name their folder with --data.root")
    return config.root
