"""Polar frames written as clouds."""

import numpy as np
import pytest

from jaxsim.data.clouds import read_cloud
from jaxsim.data.polar_frames import open_polar_frames
from jaxsim.recorded import write_clouds
from tests.discover.made_gate import sides


def test_a_frame_becomes_a_file_with_a_point_a_return_and_is_not_written_again(tmp_path):
    folder, _ = sides(tmp_path, scenes=3)
    assert write_clouds(folder, tmp_path / "clouds", "npz", every=2) == 2
    frames = open_polar_frames(folder)
    files = sorted((tmp_path / "clouds").iterdir())
    assert [path.stem for path in files] == [*frames.names[::2]]
    for path in files:
        image, _ = frames.read(path.stem)
        points = read_cloud(path)
        assert len(points) == np.asarray(image.valid).sum()
        distance = np.linalg.norm(points[:, :3], axis=1)
        np.testing.assert_allclose(np.sort(distance), np.sort(image.range_m[image.valid]), rtol=1e-5)
    files[0].write_bytes(b"kept")
    write_clouds(folder, tmp_path / "clouds", "npz", most=1)
    assert files[0].read_bytes() == b"kept"


def test_a_folder_without_frames_is_told(tmp_path):
    with pytest.raises(ValueError, match=r"no grid\.json"):
        write_clouds(tmp_path, tmp_path / "out", "ply")
