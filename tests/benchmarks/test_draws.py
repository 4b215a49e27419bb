"""The scatter of draws beside the sensor's: its parts, on numbers made up."""

import numpy as np
import pytest

from benchmarks.studies.draws import again, beside
from jaxsim.frame import PolarImage


def image(intensity, range_m=10.0, valid=True):
    intensity = np.asarray(intensity, np.float32)
    return PolarImage(
        np.broadcast_to(np.float32(range_m), intensity.shape), intensity, np.broadcast_to(valid, intensity.shape)
    )


def test_a_cell_is_compared_with_itself_where_it_is_of_one_surface():
    first = image([[0.1, 0.2, 0.3]])
    second = image([[0.15, 0.5, 0.3]], range_m=np.array([[10.01, 10.2, 10.0]]), valid=np.array([[True, True, False]]))
    differences, _ = again([first, second])
    assert differences == [pytest.approx(0.05)]


def test_drops_that_stay_are_counted():
    masks = ([False, False, True, True], [False, True, False, True], [False, True, True, True])
    _, repeated = again([image([[0.1] * 4], valid=np.array([mask])) for mask in masks])
    assert repeated == pytest.approx(2 / 4)  # of the first two one stays, of the second two one


def test_neighbours_count_on_one_surface_alone():
    intensity, range_m = np.array([[0.1, 0.3, 0.9, 0.2]]), np.array([[5.0, 5.02, 9.0, 9.01]])
    found = beside(intensity, range_m, np.array([[True, True, True, True]]))
    np.testing.assert_allclose(found, [0.2, 0.7])
    assert len(beside(intensity, range_m, np.array([[True, False, True, True]]))) == 1
