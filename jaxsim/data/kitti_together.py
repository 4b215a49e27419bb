"""KITTI's raw drives, object benchmark and odometry benchmark as one data set: one sensor measured them all.

ROOT, or ROOT/raw, ROOT/object, ROOT/odometry, hold what each of the three readers asks for; what is not there is left
out. Links will do.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import Counter
from itertools import accumulate
from pathlib import Path
from typing import Any

from jaxsim.data.kitti import DATE, KittiObject, KittiRaw
from jaxsim.data.kitti_files import listing
from jaxsim.data.kitti_odometry import KittiOdometry
from jaxsim.data.select import frame_number
from jaxsim.frame import Frame
from jaxsim.geometry import LidarSpec

READERS = {"raw": KittiRaw, "object": KittiObject, "odometry": KittiOdometry}
OF_ALL = ("training", "evaluation")
"""Names that commands take for parts of the whole set: of several, one's own would leave the others out."""


class KittiTogether:
    """Frames of the raw drives, then of the object benchmark, then of the odometry benchmark.

    The three overlap: the object benchmark's frames are single ones of raw drives, and so are the odometry sequences
    but the third. Keep what judges in a part of its own kind, or the same street is learned and judged.
    """

    name = "kitti"

    def __init__(self, root: Path, *, rows: str = "file_order"):
        folders = _folders(Path(root))
        self.parts = {name: READERS[name](folder, rows=rows) for name, folder in folders.items()}
        self._ends = list(accumulate(len(part) for part in self.parts.values()))

    def __len__(self) -> int:
        return self._ends[-1]

    @property
    def spec(self) -> LidarSpec:
        """The beam table of the first part: raw and object scans have the unit's own."""
        return next(iter(self.parts.values())).spec

    def __getitem__(self, index: int) -> Frame:
        part, local = self._place(index)
        return part[local]

    def name_of(self, index: int) -> str:
        """The frame's name in its part."""
        part, local = self._place(index)
        return part.name_of(local)

    def files_of(self, index: int) -> list[Path]:
        """All that the frame is read from in its part."""
        part, local = self._place(index)
        return part.files_of(local)

    @property
    def splits(self) -> dict[str, list[int]]:
        """Positions by part (`raw`, `object`, `odometry`), and the parts' own names where one part alone has them:
        `drive_0009`, `val`, `sequence_08`; of several parts but OF_ALL."""
        splits: dict[str, list[int]] = {}
        starts = [0, *self._ends[:-1]]
        times = Counter(name for part in self.parts.values() for name in part.splits)
        taken = {*READERS, *(OF_ALL if len(self.parts) > 1 else ())}
        for start, (name, part) in zip(starts, self.parts.items(), strict=True):
            splits[name] = list(range(start, start + len(part)))
            of_part = {key: [start + i for i in positions] for key, positions in part.splits.items()}
            splits |= {key: positions for key, positions in of_part.items() if times[key] == 1 and key not in taken}
        return splits

    @property
    def lacks(self) -> dict[str, str]:
        """What is not there of a part of one of the three, by its name; nothing of names that two of them have."""
        parts = self.parts.values()
        times = Counter(name for part in parts for name in {*part.splits, *getattr(part, "lacks", {})})
        lacking = [item for part in parts for item in getattr(part, "lacks", {}).items()]
        return {name: why for name, why in lacking if times[name] == 1}

    def _place(self, index: Any) -> tuple[KittiRaw | KittiObject | KittiOdometry, int]:
        """The part that holds a position, and the position there."""
        position = frame_number(index, self.name, len(self))
        k = bisect_right(self._ends, position)
        return list(self.parts.values())[k], position - [0, *self._ends][k]


def _folders(root: Path) -> dict[str, Path]:
    """The folder of each part that is there. Raises ValueError where there is none."""
    if not root.is_dir():
        raise ValueError(f"kitti: there is no folder {root}; pass the one that holds raw/, object/ or odometry/")
    folders: dict[str, Path] = {}
    for name in READERS:
        here = [folder for folder in (root / name, root) if _holds(name, folder)]
        if here:
            folders[name] = here[0]
    if not folders:
        raise ValueError(
            f"kitti: no part of it: {listing(root)}; pass the folder that holds 2011_09_26/, training/ or sequences/, "
            "or these in raw/, object/ and odometry/ (links will do)"
        )
    return folders


def _holds(part: str, folder: Path) -> bool:
    if not folder.is_dir():
        return False
    if part == "raw":
        return any(p.is_dir() and DATE.fullmatch(p.name) for p in folder.iterdir())
    names = ("training", "testing") if part == "object" else ("sequences", "dataset/sequences")
    return any((folder / name).is_dir() for name in names)
