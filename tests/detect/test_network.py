"""Both stages together: the published size, finite losses and gradients, batches, bad input."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax import nnx

from jaxsim.config import DetectorExperiment, VoxelConfig
from jaxsim.detect.network import bev_channels
from jaxsim.detect.state import network_shapes
from tests.detect.tiny import EXPERIMENT, scene_batch, values


def count(tree):
    return sum(int(np.prod(leaf.shape)) for leaf in jax.tree.leaves(tree))


def test_the_published_network_has_the_published_number_of_parameters():
    parameters = network_shapes(DetectorExperiment()).parameters
    assert count(parameters) == 7_586_620
    parts = {
        "backbone3d": 711_872,
        "backbone2d": 1_219_328,
        "head": 5_140,
    }
    assert {name: count(parameters[name]) for name in parts} == parts
    roi = parameters["roi"]
    assert count(roi["pools"]) == 9_056
    assert count(roi["shared"]) == 5_374_976
    assert count(roi["of_cls"]) + count(roi["cls"]) == 132_353
    assert count(roi["of_box"]) + count(roi["box"]) == 133_895
