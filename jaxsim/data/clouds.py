"""Clouds on disk as plain points: `.bin` as KITTI has them, `.npz` as `jaxsim simulate` writes them."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
from jaxtyping import Float

from jaxsim.data.kitti_files import read_velodyne

SUFFIXES = (".bin", ".npz")


def read_cloud(path: Path) -> Float[np.ndarray, "n c"]:
    """Rows x, y, z (m) and intensity (0..1); three columns alone where an `.npz` has no intensity.

    Raises ValueError where the file is broken or is no cloud.
    """
    if path.suffix == ".bin":
        return np.column_stack(read_velodyne(path))
    try:
        with path.open("rb") as file, np.load(file) as archive:
            arrays = {name: np.asarray(archive[name], np.float32) for name in ("xyz", "intensity") if name in archive}
    except (zipfile.BadZipFile, EOFError, OSError, ValueError) as error:
        raise ValueError(f"clouds: {path} is no readable .npz of plain arrays ({error})") from error
    if "xyz" not in arrays:
        raise ValueError(f"clouds: {path} holds no array xyz (n, 3); `jaxsim simulate --formats npz` writes it")
    return np.column_stack(list(arrays.values()))
