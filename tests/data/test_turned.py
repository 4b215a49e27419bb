"""The other sides of scans, as frames: what a car measures that has turned."""

from dataclasses import replace

import numpy as np
import pytest

from jaxsim.config import DataConfig, PrepareConfig
from jaxsim.data import open_dataset
from jaxsim.data.turned import SIDES, Turned
from jaxsim.pairs.prepared import prepared
from jaxsim.prepare import prepare_frame

PREPARE = PrepareConfig(inputs=(), depth="ip_basic_fast")


@pytest.fixture(scope="module")
def dataset():
    return open_dataset(DataConfig(streets="town"))


class Cropped:
    """One frame, whose scan holds what its camera sees."""

    name, spec = "cropped", None

    def __init__(self, of):
        frame = of[0]
        ahead = frame.cloud.xyz_m[:, 0] > np.abs(frame.cloud.xyz_m[:, 1])
        parts = {name: getattr(frame.cloud, name)[ahead] for name in ("xyz_m", "intensity", "valid", "row")}
        self.frame = replace(frame, cloud=replace(frame.cloud, **parts))

    def __len__(self):
        return 1

    def __getitem__(self, index):
        return self.frame

    def name_of(self, index):
        return "a"


def test_a_side_is_the_scan_of_a_car_that_has_turned(dataset):
    turned = Turned(dataset)
    whole, sides = dataset[3], [turned[i] for i in turned.sides([3])]
    assert [frame.name for frame in sides] == [f"{whole.name}-turned-{degrees:03d}" for degrees in SIDES]
    x, y, z = whole.cloud.xyz_m.T
    # A car that looks to its left has in front of it (x) what was to the left (y), and what was ahead to its right.
    for frame, expected in zip(sides, ((y, -x, z), (-x, -y, z), (-y, x, z)), strict=True):
        np.testing.assert_allclose(frame.cloud.xyz_m, np.stack(expected, -1), atol=1e-4)
        np.testing.assert_array_equal(frame.cloud.row, whole.cloud.row)
        np.testing.assert_array_equal(frame.cloud.intensity, whole.cloud.intensity)
        assert (frame.scene, frame.camera.has_image, frame.camera.semantic) == (whole.scene, False, None)
        assert not frame.camera.rgb.any()
        assert frame.camera.rgb.shape == whole.camera.rgb.shape


def test_the_frames_themselves_come_first_as_they_are(dataset):
    turned = Turned(dataset)
    assert len(turned) == 4 * len(dataset)
    assert turned.sides([0, 7]) == [k * len(dataset) + i for k in (1, 2, 3) for i in (0, 7)]
    assert turned.name_of(5) == dataset.name_of(5) == turned[5].name
    last = turned[-1]
    assert last.name == turned.name_of(-1) == turned[len(turned) - 1].name == f"{dataset.name_of(-1)}-turned-270"
    with pytest.raises(IndexError, match="no frame"):
        turned[len(turned)]


def test_sides_are_prepared_and_kept_beside_the_frames(dataset, tmp_path):
    turned, data = Turned(dataset), DataConfig(cache=tmp_path)
    pairs = prepared(turned, turned.sides([2])[:1], data, prepare=PREPARE)
    [pair] = pairs
    expected, _ = prepare_frame(turned[turned.sides([2])[0]], dataset.spec, PREPARE)
    np.testing.assert_array_equal(pair.measured.intensity, expected.measured.intensity)
    both = pair.measured.valid & pair.painted.valid
    assert both.mean() > 0.3
    # Depth is completed from the turned points: it is that of what the camera would see there.
    assert np.median(np.abs(pair.measured.range_m - pair.painted.range_m)[both]) < 0.1
    assert pairs.scenes == [dataset[2].scene]
    assert not pair.painted.rgb.any()


def test_a_scan_that_is_cropped_to_the_image_has_no_sides(dataset):
    turned = Turned(Cropped(dataset))
    assert turned[0].cloud is not None
    for position, where in zip(turned.sides([0]), ("to the left", "behind", "to the right"), strict=True):
        with pytest.raises(
            ValueError, match=rf"the scan has no points {where}: it was cropped .* pass --optim.sides 0"
        ):
            turned[position]
