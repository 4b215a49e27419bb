"""A run as the packaged sensor."""

from dataclasses import replace

import jax
import numpy as np

import jaxsim
from configs.embedded import experiment
from jaxsim.config import GeneratorConfig
from jaxsim.simulate.embedded import read_embedded
from jaxsim.simulate.embedded.pack import pack
from tests.untrained import untrained_run

SMALL = replace(experiment, generator=GeneratorConfig(filters=4, blocks=1, downsamples=1, enhancer_blocks=1))


def test_a_packed_run_is_the_run(tmp_path):
    run, packed = untrained_run(tmp_path / "run", SMALL), tmp_path / "packed"
    packed.mkdir()
    pack(run, packed)
    settings, parameters = read_embedded(packed)
    sensor = jaxsim.load(run)
    assert settings == sensor.run
    jax.tree.map(np.testing.assert_array_equal, parameters, sensor.params)
