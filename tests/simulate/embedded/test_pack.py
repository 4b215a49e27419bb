"""A run as the packaged sensor."""

from dataclasses import replace

import jax
import numpy as np

import jaxsim
from configs.embedded import experiment
from jaxsim.simulate.embedded import FOLDER, read_embedded
from jaxsim.simulate.embedded.pack import pack
from jaxsim.simulate.grain import FILE as GRAIN
from jaxsim.simulate.grain import read_grain
from tests.untrained import untrained_run

SMALL = replace(experiment, generator=replace(experiment.generator, filters=4, max_filters=8, downsamples=1))


def test_a_packed_run_is_the_run_wherever_that_lay(tmp_path):
    experiment = replace(SMALL, run=replace(SMALL.run, out=tmp_path))
    run, packed = untrained_run(tmp_path / "run", experiment), tmp_path / "packed"
    packed.mkdir()
    (run / GRAIN).write_bytes((FOLDER / GRAIN).read_bytes())
    pack(run, packed)
    settings, parameters = read_embedded(packed)
    sensor = jaxsim.load(run)
    assert settings == replace(sensor.run, experiment=SMALL)
    jax.tree.map(np.testing.assert_array_equal, parameters, sensor.params)
    assert read_grain(packed) == read_grain(run)
