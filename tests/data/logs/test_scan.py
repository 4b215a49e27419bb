"""Points whose values have names, as a scan."""

import numpy as np
import pytest

from jaxsim.data.logs.scan import offsets, reading, ring_of_shape, scale_of


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
