"""Folders of KITTI labels (15 columns) and of a detector's results (16), as flat arrays over all frames.

Columns: kind, truncated, occluded, alpha, left, top, right, bottom, height, width, length, x, y, z, rotation_y, score.
Kinds may be any word here: what is neither of a class nor its neighbour takes no part.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int, Shaped

from jaxsim.files import file_of, files_in, numbers, read_names, read_text

MOST = 1e5
"""No metre, pixel or radian of an object is larger."""
_COLUMNS = {"label": 15, "detection": 16}


@dataclass(frozen=True)
class Objects:
    """Labelled or detected objects of many frames, sorted by frame, within a frame in the order of its file."""

    names: tuple[str, ...]
    """Names of the frames."""
    frame: Int[np.ndarray, " n"]
    """Place in `names`."""
    kind: Shaped[np.ndarray, " n"]
    """The kind as written in the file."""
    bbox_px: Float[np.ndarray, "n 4"]
    """Left, top, right, bottom."""
    size_m: Float[np.ndarray, "n 3"]
    """Length, width, height."""
    centre_m: Float[np.ndarray, "n 3"]
    """Middle of the bottom face, in the rectified camera."""
    yaw_rad: Float[np.ndarray, " n"]
    alpha_rad: Float[np.ndarray, " n"]
    truncated: Float[np.ndarray, " n"]
    occluded: Float[np.ndarray, " n"]
    score: Float[np.ndarray, " n"]
    """Score of a detection; 0 for a label."""

    @cached_property
    def lower_kind(self) -> Shaped[np.ndarray, " n"]:
        """Kinds in lower case, as both tools compare them."""
        return np.char.lower(self.kind)


def read_truth(folder: Path, names: Sequence[str]) -> Objects:
    """Labels of the frames `names` (`label_2/NAME.txt`).

    Raises ValueError for files that are missing (named), a wrong count of columns, and values that are no numbers.
    """
    return _read(folder, names, "label")


def read_detections(folder: Path, names: Sequence[str] | None = None) -> Objects:
    """A detector's results of the frames `names`; by default of every file there is. Raises as `read_truth`."""
    return _read(folder, frames_with_results(folder) if names is None else names, "detection")


def frames_with_results(folder: Path) -> list[str]:
    """Names of the frames that have a file. Raises ValueError where there is none."""
    if not folder.is_dir():
        raise ValueError(f"detection: there is no folder {folder}")
    names = [path.stem for path in files_in(folder, ".txt")]
    if not names:
        inside = "; its data/ has some, pass that" if files_in(folder / "data", ".txt") else ""
        raise ValueError(f"detection: {folder} holds no NUMBER.txt{inside}")
    return names


def frame_list(path: Path) -> list[str]:
    """Frames of a list such as ImageSets/val.txt (`read_names`). Raises ValueError for one without names."""
    if not path.is_file():
        raise ValueError(f"detection: there is no list {path}")
    names = read_names(path, by="detection")
    if not names:
        raise ValueError(f"detection: {path} names no frame; it should hold one a line (000001)")
    return names


def _read(folder: Path, names: Sequence[str], what: str) -> Objects:
    paths = [file_of(folder, name, ".txt", by="detection") for name in names]
    missing = [path.name for path in paths if not path.is_file()]
    if missing:
        more = f" and {len(missing) - 5} more" if len(missing) > 5 else ""
        empty = " A frame without detections needs an empty file." if what == "detection" else ""
        raise ValueError(
            f"detection: {folder} lacks the {what} file of {len(missing)} of {len(paths)} frames: "
            f"{', '.join(missing[:5])}{more}.{empty}"
        )
    kinds: list[str] = []
    values: list[list[float]] = []
    counts = np.zeros(len(paths), int)
    for k, path in enumerate(paths):
        for line, text in enumerate(read_text(path, by="detection").splitlines(), 1):
            if row := text.split():
                values.append(_numbers(path, line, row, what=what))
                kinds.append(row[0])
                counts[k] += 1
    table = np.array(values, np.float64).reshape(len(kinds), _COLUMNS[what] - 1)
    return Objects(
        names=tuple(names),
        frame=np.repeat(np.arange(len(paths)), counts),
        kind=np.array(kinds, str),
        bbox_px=table[:, 3:7],
        # Files have height, width, length.
        size_m=table[:, [9, 8, 7]],
        centre_m=table[:, 10:13],
        yaw_rad=table[:, 13],
        alpha_rad=table[:, 2],
        truncated=table[:, 0],
        occluded=table[:, 1],
        score=table[:, 14] if what == "detection" else np.zeros(len(kinds)),
    )


def _numbers(path: Path, line: int, row: list[str], *, what: str) -> list[float]:
    wanted = _COLUMNS[what]
    if len(row) != wanted:
        hint = {15: " (15 is a label, without score)", 16: " (16 is a detection, with score)"}.get(len(row), "")
        raise ValueError(f"detection: {path}, line {line} has {len(row)} columns{hint}; a {what} has {wanted}")
    values = numbers(row[1:], where=f"detection: {path}, line {line}: columns 2 to {wanted} are numbers")
    # One sum tells of nearly every line that no value is too large or none; only of others each is asked.
    if not sum(map(abs, values)) < MOST and (bad := [k for k, number in enumerate(values) if not abs(number) < MOST]):
        raise ValueError(
            f"detection: {path}, line {line}: column {bad[0] + 2} is {row[bad[0] + 1]}; leave out a box that is not "
            f"finite, or beyond {MOST:g} (a diverged network writes such)"
        )
    left, top, right, bottom = values[3:7]
    if left > right or top > bottom:
        box = " ".join(row[4:8])
        raise ValueError(f"detection: {path}, line {line}: the image box is {box}; it must be left, top, right, bottom")
    return values
