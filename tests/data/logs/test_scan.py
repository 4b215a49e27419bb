"""Points whose values have names, as a scan."""

import numpy as np
import pytest

from jaxsim.data.logs import LogOptions
from jaxsim.data.logs.scan import offsets, reading, ring_of_shape, scale_of, scan_of_fields
from tests.data.logs.conftest import room


def scan(fields):
    return scan_of_fields(fields, LogOptions(), by="test", where="here", name="a", scene="room")


@pytest.mark.parametrize("time", ["scalar_GpsTime", "scalar_Gps_Time", "scalar_gps_time", "scalar_Time"])
def test_fields_are_known_as_cloudcompare_writes_them(time):
    plain = room() | {"t": np.linspace(0, 0.1, len(room()["t"]), dtype="f4")}
    names = {"intensity": "scalar_Intensity", "ring": "scalar_Ring", "t": time}
    saved = scan({names.get(name, name): value.astype("f4") for name, value in plain.items()})
    for name in ("intensity", "ring", "offset_s"):
        np.testing.assert_array_equal(getattr(saved, name), getattr(scan(plain), name))


def test_a_field_of_the_plain_name_goes_before_one_of_cloudcompares():
    fields = room()
    both = scan({"scalar_Ring": np.zeros_like(fields["ring"])} | fields)
    np.testing.assert_array_equal(both.ring, fields["ring"])


def test_points_that_neither_came_back_nor_have_a_ring_are_left_out():
    fields = room()
    ring = fields["ring"].astype("f4")
    ring[:3] = np.nan
    fields["x"][:2], fields["x"][5] = np.nan, np.nan
    for axis in "xyz":
        fields[axis][2] = 0
    read = scan(fields | {"ring": ring})
    assert len(read.xyz_m) == len(ring) - 3
    np.testing.assert_array_equal(read.ring, fields["ring"][3:])
    ring[7] = np.nan
    with pytest.raises(ValueError, match=r"here has rings that are no whole numbers, in its field ring"):
        scan(fields | {"ring": ring})


def test_times_in_whole_numbers_are_nanoseconds_and_others_seconds():
    late = np.array([1_700_000_000_000_000_500, 1_700_000_000_000_000_000], np.int64)
    np.testing.assert_allclose(offsets(late), [5e-7, 0])
    np.testing.assert_allclose(offsets(np.array([3.5, np.nan, 3.0])), [0.5, np.nan, 0])
    assert offsets(np.array([])).shape == (0,)


def test_bytes_and_16_bits_have_a_full_scale_and_others_none():
    assert [scale_of(np.zeros(1, kind)) for kind in ("u1", "u2", "u4", "i2", "f4")] == [255, 65535, None, None, None]


def test_rings_of_an_organised_cloud_run_along_the_axis():
    np.testing.assert_array_equal(ring_of_shape((2, 3), 0), [0, 0, 0, 1, 1, 1])
    np.testing.assert_array_equal(ring_of_shape((2, 3), 1), [0, 1, 2, 0, 1, 2])


def test_whatever_a_library_raises_names_the_file_and_what_to_do(tmp_path):
    file = tmp_path / "a.las"
    file.write_bytes(b"x")
    with (
        pytest.raises(ValueError, match=r"las: .*a\.las cannot be read \(KeyError: 7\); copy it again"),
        reading("las", file, "copy it again"),
    ):
        raise KeyError(7)
