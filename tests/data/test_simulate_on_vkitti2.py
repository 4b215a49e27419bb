"""`jaxsim simulate RUN --data vkitti2`: of an untrained run of KITTI-STEP, for the way is tested, not the answer."""

from pathlib import Path

import numpy as np
import pytest

from jaxsim.cli.flags import DataSource
from jaxsim.cli.simulate import Simulate
from jaxsim.config import DataConfig
from jaxsim.data.cityscapes import IDS
from jaxsim.data.polar_frames import frame_names, read_frame, read_grid
from jaxsim.simulate.learned_sensor import load
from jaxsim.studies.ablation import draw_unmeasured


@pytest.fixture(scope="module")
def simulate(step_run, virtual):
    """The command on both frames of Scene01."""

    def simulate(out: Path, lidar: str | None = None, **settings) -> Path:
        common = {"frames": "0-1", "batch": 2, "formats": ("bin",), "previews": 0}
        data = DataSource("vkitti2", root=virtual.root, scenes=("Scene01",), lidar=lidar)
        Simulate(run=step_run, out=out, data=data, **common, **settings)()
        return out / "polar"

    return simulate


@pytest.fixture(scope="module")
def out(simulate, tmp_path_factory) -> Path:
    """What the command makes by default."""
    out = tmp_path_factory.mktemp("out")
    simulate(out)
    return out


def test_frames_lie_on_the_runs_window_with_the_renderers_depth_and_classes(out, step_run):
    polar = out / "polar"
    assert frame_names(polar) == ["Scene01-clone-Camera_0-00000", "Scene01-clone-Camera_0-00001"]
    grid, about = read_grid(polar)
    window, _ = load(step_run).window
    np.testing.assert_allclose(grid.elevation_rad, window.elevation_rad, atol=1e-6)
    assert {frame["scene"] for frame in about.values()} == {"Scene01"}
    image, more = read_frame(polar, "Scene01-clone-Camera_0-00000")
    assert image.valid.mean() > 0.3
    ground = image.valid & (more["semantic"] == IDS["road"])
    z = (image.range_m * np.sin(grid.elevation_rad)[:, None] + grid.origin_m[:, None])[ground]
    assert np.median(z) == pytest.approx(-1.73, abs=0.15)
    points = np.fromfile(out / "clouds/Scene01-clone-Camera_0-00000.bin", "<f4").reshape(-1, 4)
    assert len(points) == image.valid.sum()
    assert set(np.unique(more["instance"])) > {0}


@pytest.mark.long
def test_without_projection_points_are_the_same_and_their_intensities_others(simulate, out, tmp_path):
    name = "Scene01-clone-Camera_0-00000"
    plain, _ = read_frame(out / "polar", name)
    scaled, _ = read_frame(simulate(tmp_path, projection="none"), name)
    both = plain.valid & scaled.valid
    np.testing.assert_allclose(plain.range_m[both], scaled.range_m[both], rtol=1e-5)
    assert (plain.intensity[both] != scaled.intensity[both]).mean() > 0.1
    with pytest.raises(ValueError, match=r"\(data was .*, now .*\)"):
        simulate(out, projection="none")
    with pytest.raises(ValueError, match=r"source\.lidar was kitti, now camera; data was .*, now .*"):
        simulate(out, lidar="camera")


def test_an_ablation_draws_frames_that_no_lidar_measured(step_run, virtual):
    source = DataConfig("vkitti2", root=virtual.root, scenes=("Scene01",))
    (picture,) = draw_unmeasured({"combined": load(step_run)}, source, "0").values()
    inputs, predicted = picture[:, :744], picture[:200, 748:]
    assert inputs.std() > 20
    assert predicted.std() > 5


def test_a_frame_of_changed_files_or_cut_off_is_made_anew_and_no_other(step_run, virtual_root, tmp_path, caplog):
    names = [f"Scene01-clone-Camera_0-0000{k}" for k in range(2)]

    def simulated() -> list[tuple[int, bytes]]:
        data = DataSource("vkitti2", root=virtual_root, scenes=("Scene01",))
        Simulate(run=step_run, out=tmp_path, data=data, frames="0-1", batch=2, formats=("bin",), previews=0)()
        files = [tmp_path / "polar" / f"{name}.npz" for name in names]
        return [(file.stat().st_mtime_ns, file.read_bytes()) for file in files]

    first = simulated()
    assert simulated() == first
    depths = [virtual_root / f"Scene01/clone/frames/depth/Camera_0/depth_0000{k}.png" for k in range(2)]
    depths[0].write_bytes(depths[1].read_bytes())
    second = simulated()
    assert second[1] == first[1]
    assert second[0][1] != first[0][1]
    assert f"simulate: {names[0]} made anew: what it was made of has changed since" in caplog.text
    cut = tmp_path / "polar" / f"{names[1]}.npz"
    cut.write_bytes(cut.read_bytes()[:-1000])
    third = simulated()
    assert (third[0], third[1][1]) == (second[0], first[1][1])
    assert f"simulate: {names[1]} made anew: its file is cut off or damaged" in caplog.text
    cloud = tmp_path / "clouds" / f"{names[1]}.bin"
    whole = cloud.read_bytes()
    cloud.write_bytes(whole[:-4])
    fourth = simulated()
    assert (fourth[0], cloud.read_bytes()) == (third[0], whole)
