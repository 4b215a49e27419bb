"""The Inception network."""

import jax
import numpy as np

from jaxsim.metrics.inception import (
    INPUT_SIZE,
    _abstract,
    prepared_images,
)
from jaxsim.metrics.inception.network import Inception


def test_the_two_forms_differ_at_borders_and_in_the_last_pooling_alone():
    definitions = {form: _abstract(form)[1] for form in ("torchvision", "pytorch_fid")}
    shapes = [jax.tree.map(lambda leaf: leaf.shape, tree) for tree in definitions.values()]
    assert shapes[0] == shapes[1]


def test_images_are_brought_to_one_size():
    assert prepared_images(np.zeros((2, 9, 30, 1), np.float32), "pytorch_fid").shape == (2, INPUT_SIZE, INPUT_SIZE, 3)
    assert Inception.__call__.__doc__
