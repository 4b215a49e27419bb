"""Cityscapes' classes."""

import numpy as np

from jaxsim.data.cityscapes import IDS, NAMES, TRAIN_CLASSES, ids_of_train_ids
from jaxsim.frame import CLASSES


def test_train_ids_are_those_of_the_published_table():
    published = {0: 7, 1: 8, 2: 11, 3: 12, 4: 13, 5: 17, 6: 19, 7: 20, 8: 21, 9: 22, 10: 23, 11: 24, 12: 25, 13: 26,
                 14: 27, 15: 28, 16: 31, 17: 32, 18: 33, 255: 0}  # fmt: skip
    raster = np.array([list(published)], np.uint8)
    np.testing.assert_array_equal(ids_of_train_ids(raster)[0], list(published.values()))
    assert len(TRAIN_CLASSES) == 19
    assert len(set(IDS.values())) == len(IDS) == len(NAMES) == CLASSES
