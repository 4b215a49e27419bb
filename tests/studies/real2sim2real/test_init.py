"""Real2Sim2Real: its settings and its folder."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from jaxsim.studies.real2sim2real import claim_loop
from jaxsim.train.experiments import experiment_names, load_experiment, load_loop


@pytest.fixture
def loop(tmp_path):
    config, _ = load_loop("real2sim2real")
    return claim_loop(replace(config, out=tmp_path / "loop", seeds=(0, 1)))


@pytest.mark.parametrize("name", experiment_names("loop"))
def test_every_loop_has_what_the_paper_has(name):
    config, words = load_loop(name)
    assert words.startswith(("Real2Sim2Real", "The paper's Real2Sim2Real"))
    assert {"raw_64", "raw_32", "simulated_64", "discovered_grid"} == {*config.kinds}
    with pytest.raises(ValueError, match=f"jaxsim real2sim2real --config {name}"):
        load_experiment(name)


def test_real_and_synthetic_differ_in_streets_and_statistics():
    config, _ = load_loop("real2sim2real")
    assert config.synthetic.seed != config.intensity.data.seed
    assert config.synthetic.streets != config.intensity.data.streets
    assert config.detector.data.seed == config.intensity.data.seed


def test_the_sensor_does_not_learn_from_frames_that_judge():
    config, _ = load_loop("real2sim2real")
    last_taught = max(int(part.split("-")[-1].split(":")[0]) for part in config.intensity.data.train.split(","))
    assert last_taught < int(config.detector.data.validation.split("-")[0])


def test_more_seeds_and_kinds_may_be_asked_for_but_no_other_settings(loop):
    claim_loop(replace(loop.config, occlusion="never_visible"))  # nothing is made yet
    claim_loop(loop.config)
    loop.intensity.mkdir()
    claim_loop(replace(loop.config, seeds=(0, 1, 2), kinds=("raw_64", "simulated_grid")))
    other = replace(loop.config, synthetic=replace(loop.config.synthetic, seed=9))
    with pytest.raises(ValueError, match=r"other settings \(synthetic\.seed was 1, now 9\); give another --out"):
        claim_loop(other)
    with pytest.raises(ValueError, match="each once"):
        claim_loop(replace(loop.config, seeds=(1, 1)))
    assert json.loads((loop.out / "loop.json").read_text())["seeds"] == [0, 1, 2]


def test_detectors_of_simulated_clouds_learn_from_trees_and_the_real_one_from_its_frames(loop):
    simulated, real = (loop.detector_experiment(kind, 1) for kind in ("raw_64", "real"))
    assert (simulated.data.kind, simulated.data.root) == ("kitti_object", loop.tree("raw_64"))
    assert real.data == loop.config.detector.data
    assert {simulated.run.seed, real.run.seed} == {1}
    assert Path(simulated.run.out) / simulated.run.name == loop.detector("raw_64", 1)
    assert replace(simulated, data=real.data, run=real.run) == real
