"""The sides that `discover` compares: Lambert's law on measured ranges, against the plainest computation, and what it
refuses. Pairs of a run are tested with the command, in tests/cli/test_sides.py."""

import numpy as np
import pytest

from jaxsim.data.polar_frames import open_polar_frames, write_frame, write_grid
from jaxsim.frame import PolarGrid, PolarImage
from jaxsim.simulate.discover_sides import write_lambert
from tests.discover.made_watch import day

ROWS, COLUMNS = 12, 60


def wall(folder):
    """A wall 10 m ahead of the sensor, whose normal is the x axis, with a class and an object, and a lost ray."""
    azimuth = np.linspace(0.5, -0.5, COLUMNS).astype("f4")
    elevation = np.linspace(0.2, -0.2, ROWS).astype("f4")
    cosine = np.cos(azimuth)[None, :] * np.cos(elevation)[:, None]
    valid = np.ones((ROWS, COLUMNS), bool)
    valid[3, 30] = False
    image = PolarImage((10 / cosine).astype("f4"), np.full((ROWS, COLUMNS), 0.7, "f4"), valid)
    labels = {"semantic": np.full((ROWS, COLUMNS), 11, np.uint8), "instance": np.full((ROWS, COLUMNS), 4, np.int32)}
    write_frame(folder, "000", image, **labels)
    write_grid(folder, PolarGrid(azimuth, elevation, np.zeros(ROWS, "f4")), frames={"000": {"scene": "yard"}})
    return folder, cosine


def test_a_wall_is_as_bright_as_the_cosine_says_at_the_measured_ranges(tmp_path):
    measured, cosine = wall(tmp_path / "measured")
    simulated = open_polar_frames(write_lambert(measured, tmp_path / "out"))
    assert simulated.folder == tmp_path / "out/simulated"
    assert simulated.about == {"000": {"scene": "yard"}}
    image, rasters = simulated.read("000")
    before, _ = open_polar_frames(measured).read("000")
    np.testing.assert_array_equal(image.range_m, before.range_m)
    assert not image.valid[3, 30]
    inner = np.s_[5:-1, 1:-1]
    np.testing.assert_allclose(image.intensity[inner], 0.3 * cosine[inner], atol=1e-4)
    np.testing.assert_allclose(np.cos(rasters["incidence"][inner]), cosine[inner], atol=1e-3)
    assert (rasters["semantic"] == 11).all()
    assert (rasters["instance"] == 4).all()


def test_where_no_neighbour_tells_the_slant_it_is_sixty_degrees(tmp_path):
    measured = day(tmp_path / "measured", 0)
    name = open_polar_frames(measured).names[0]
    image, rasters = open_polar_frames(write_lambert(measured, tmp_path)).read(name)
    unknown = image.valid & (rasters["incidence"] == np.float32(np.pi / 2))
    assert unknown.any()
    np.testing.assert_allclose(image.intensity[unknown], 0.15, rtol=1e-6)


def test_measured_frames_are_not_written_over_and_others_not_mixed_in(tmp_path):
    measured, _ = wall(tmp_path / "simulated")
    with pytest.raises(ValueError, match="is read, and would be written into"):
        write_lambert(measured, tmp_path)
    assert open_polar_frames(measured).read("000")[0].intensity.max() == np.float32(0.7)
    write_lambert(measured, tmp_path / "out")
    with pytest.raises(ValueError, match="holds other frames"):
        write_lambert(day(tmp_path / "day", 0), tmp_path / "out")


def test_frames_of_a_simulator_that_lie_where_lamberts_would_are_not_lost(tmp_path):
    measured, _ = wall(tmp_path / "measured")
    simulated, _ = wall(tmp_path / "simulated")
    before = (simulated / "000.npz").read_bytes()
    with pytest.raises(
        ValueError, match=r"simulated/000\.npz is no frame that a comparison wrote, and would be written"
    ):
        write_lambert(measured, tmp_path)
    assert (simulated / "000.npz").read_bytes() == before


def test_the_same_command_again_writes_the_same(tmp_path):
    measured, _ = wall(tmp_path / "measured")
    first = (write_lambert(measured, tmp_path / "out") / "000.npz").read_bytes()
    assert (write_lambert(measured, tmp_path / "out") / "000.npz").read_bytes() == first
