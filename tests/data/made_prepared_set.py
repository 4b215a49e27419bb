"""Sets of pairs of a small KITTI tree."""

import hashlib
from pathlib import Path

import jax
import numpy as np
import pytest

from jaxsim.config import DataConfig, PrepareConfig
from jaxsim.pairs.sets import make_set

PREPARE = PrepareConfig(inputs=("rgb", "depth", "row"), depth="ip_basic_fast", columns=64)


def kitti(root: Path, **more) -> DataConfig:
    return DataConfig(kind="kitti_raw", root=root, **more)


def of(out: Path) -> DataConfig:
    return DataConfig(kind="prepared", root=out)


def equal(one, other) -> None:
    assert jax.tree.structure(one) == jax.tree.structure(other)
    for a, b in zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True):
        assert np.asarray(a).dtype == np.asarray(b).dtype
        np.testing.assert_array_equal(a, b)


def digests(folder: Path) -> dict[str, str]:
    """Of every file of a set but the lock."""
    files = [path for path in folder.rglob("*") if path.is_file()]
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


@pytest.fixture
def out(raw_root, tmp_path) -> Path:
    """All three frames of the drives, two of them for training; two pairs a file."""
    make_set(tmp_path / "out", kitti(raw_root), PREPARE, train="0-1", evaluation="2", size=2, workers=1)
    return tmp_path / "out"
