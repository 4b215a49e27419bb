"""A small KITTI tree that is made on the spot, so that the readers' tests need no sample data."""

import shutil
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from jaxsim.config import DataConfig
from jaxsim.data.synthetic import SyntheticWorld
from jaxsim.frame import Frame
from jaxsim.geometry import preset
from tests.data.drives import write_step
from tests.data.round_room import scan, write_image, write_scan
from tests.data.virtual_drives import write_vkitti2
from tests.untrained import tiny_experiment, untrained_run

P2 = "721.5377 0 609.5593 44.85728 0 721.5377 172.854 0.2163791 0 0 1 0.002745884"
R0 = "0.9999239 0.00983776 -0.007445048 -0.009869795 0.9999421 -0.004278459 0.007402527 0.004351614 0.9999631"
VELO_R = "0.007533745 -0.9999714 -0.000616602 0.01480249 0.0007280733 -0.9998902 0.9998621 0.00752379 0.01480755"
VELO_T = "-0.004069766 -0.07631618 -0.2717806"
CAR = "Car 0.00 0 1.85 387.63 181.54 423.81 203.12 1.67 1.87 3.69 -16.53 2.39 58.49 1.57"
DONT_CARE = "DontCare -1 -1 -10 503.89 169.71 590.61 190.13 -1 -1 -1 -1000 -1000 -1000 -10"


@pytest.fixture
def raw_root(tmp_path: Path) -> Path:
    """Two drives of one date, with two frames and one."""
    root = tmp_path / "raw"
    date = root / "2011_09_26"
    for drive, count in (("0002", 1), ("0001", 2)):
        folder = date / f"2011_09_26_drive_{drive}_sync"
        for k in range(count):
            write_scan(folder / f"velodyne_points/data/{k:010d}.bin", scan())
            write_image(folder / f"image_02/data/{k:010d}.png")
    (date / "calib_cam_to_cam.txt").write_text(
        f"calib_time: 09-Jan-2012 13:57:47\nS_rect_02: 1242 375\nR_rect_00: {R0}\nP_rect_02: {P2}\n"
    )
    (date / "calib_velo_to_cam.txt").write_text(f"calib_time: 15-Mar-2012\nR: {VELO_R}\nT: {VELO_T}\n")
    return root


@pytest.fixture
def object_root(tmp_path: Path) -> Path:
    """One frame of the object benchmark."""
    root = tmp_path / "object"
    folder = root / "training"
    write_scan(folder / "velodyne/000007.bin", scan())
    write_image(folder / "image_2/000007.png")
    r, t = np.array(VELO_R.split()).reshape(3, 3), np.array(VELO_T.split()).reshape(3, 1)
    velo = " ".join(np.concatenate([r, t], axis=1).ravel())
    (folder / "calib").mkdir()
    (folder / "calib/000007.txt").write_text(f"P2: {P2}\nR0_rect: {R0}\nTr_velo_to_cam: {velo}\n\n")
    (folder / "label_2").mkdir()
    (folder / "label_2/000007.txt").write_text(f"{CAR}\n{DONT_CARE}\n")
    return root


@pytest.fixture(scope="session")
def street() -> list[Frame]:
    """Two frames of two streets of the embedded world, rendered at KITTI's size and the sensor's full rate."""
    world = SyntheticWorld(seed=0, columns=preset("hdl64e").columns)
    return [world[i] for i in (0, 4)]


@pytest.fixture(scope="session")
def step_tree(street, tmp_path_factory) -> Path:
    """Sequences 0000 (train) and 0001 (evaluation of the paper; its frame 177 has no scan) of KITTI-STEP."""
    root = tmp_path_factory.mktemp("step")
    write_step(root, "train", "0000", {0: street[0]})
    write_step(root, "train", "0001", {176: street[1], 177: street[1]}, without_scan=(177,))
    return root


@pytest.fixture
def step_root(step_tree, tmp_path) -> Path:
    """A copy of it that a test may spoil."""
    return Path(shutil.copytree(step_tree, tmp_path / "step"))


@dataclass
class Virtual:
    root: Path
    drawn: dict
    """What was rendered, by (frame, camera)."""


@pytest.fixture(scope="session")
def virtual(tmp_path_factory) -> Virtual:
    """Virtual KITTI 2's Scene01: two frames of `clone` by both cameras, and `fog` with the same files."""
    root = tmp_path_factory.mktemp("virtual")
    world = SyntheticWorld(seed=0, columns=preset("hdl64e").columns)
    shots = [(0, 4, 0), (0, 4, 1), (1, 5, 0), (1, 5, 1)]
    drawn = write_vkitti2(root, "Scene01", "clone", world, shots)
    shutil.copytree(root / "Scene01/clone", root / "Scene01/fog")
    return Virtual(root, drawn)


@pytest.fixture
def virtual_root(virtual, tmp_path) -> Path:
    """A copy of its `clone` that a test may spoil."""
    shutil.copytree(virtual.root / "Scene01/clone", tmp_path / "virtual/Scene01/clone")
    return tmp_path / "virtual"


@pytest.fixture(scope="session")
def step_run(tmp_path_factory) -> Path:
    """A run of KITTI-STEP that has saved a random generator."""
    tiny = tiny_experiment()
    experiment = replace(
        tiny,
        data=DataConfig(kind="kitti_step", root=Path("not/here"), scenes=("0000",), train="training"),
        prepare=replace(tiny.prepare, depth="ip_basic"),
    )
    return untrained_run(tmp_path_factory.mktemp("runs") / "step", experiment)
