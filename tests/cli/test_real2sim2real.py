"""`jaxsim real2sim2real` without training: its words, its order, what it does after a kill."""

import sys
from dataclasses import replace

import pytest

from jaxsim.cli import main
from jaxsim.cli.real2sim2real import run
from jaxsim.config import CloudRecipe
from jaxsim.studies.real2sim2real import claim_loop
from jaxsim.studies.real2sim2real.stages import Stages
from jaxsim.train import read_experiment
from jaxsim.train.experiments import load_loop


@pytest.fixture
def loop(tmp_path):
    config, _ = load_loop("real2sim2real")
    return claim_loop(replace(config, out=tmp_path / "loop", kinds=("raw_64", "raw_32")))


SCRIPT = """
import json, pathlib, sys
from jaxsim.train import read_experiment
experiment = read_experiment(pathlib.Path(sys.argv[1]))
folder = pathlib.Path(experiment.run.out) / experiment.run.name
print("trained", folder, flush=True)
if "stop" in pathlib.Path({stop!r}).read_text():
    sys.exit(3)
folder.mkdir(parents=True)
(folder / "card.md").write_text("done")
"""


@pytest.mark.long
def test_training_is_left_to_a_process_of_its_own_and_is_not_repeated(loop, tmp_path, capfd):
    stop, script = tmp_path / "stop", tmp_path / "train.py"
    stop.write_text("stop")
    script.write_text(SCRIPT.format(stop=str(stop)))
    stages = Stages(loop, discover=lambda loop: None, export=lambda loop: None, trainer=(sys.executable, str(script)))
    run_folder, experiment = loop.detector("raw_64", 0), loop.detector_experiment("raw_64", 0)
    with pytest.raises(SystemExit, match="ended with status 3; the same command resumes"):
        stages.train(run_folder, experiment)
    stop.write_text("")
    stages.train(run_folder, experiment)
    stages.train(run_folder, experiment)
    assert capfd.readouterr().out.count(f"trained {run_folder}") == 2
    kept = loop.out / "settings" / "detectors_seed0_raw_64.json"
    assert read_experiment(kept) == experiment


def test_the_32_lines_are_of_the_reading_that_was_asked_for(loop):
    assert loop.recipe("raw_32") == CloudRecipe(source="depth", lines="32_of_64")
    wide = replace(loop, config=replace(loop.config, lines_32="32_wide"))
    assert wide.recipe("raw_32").lines == "32_wide"
    assert wide.recipe("raw_64").lines == "64"


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (["--config", "nothing"], "no Real2Sim2Real 'nothing'.*real2sim2real, real2sim2real_kitti"),
        (["--config", "nothing.json"], "no file nothing.json"),
        (["--config"], "--config wants a name"),
    ],
)
def test_an_unknown_loop_is_explained(flags, message):
    with pytest.raises(ValueError, match=message):
        run(flags)


def test_help_lists_the_settings_of_the_named_loop(capsys):
    with pytest.raises(SystemExit):
        main(["real2sim2real", "--config", "real2sim2real_kitti", "--help"])
    said = capsys.readouterr().out
    assert "--seeds" in said
    assert "Virtual KITTI 2 is simulated" in said


def test_a_set_that_is_not_there_is_told_before_anything_is_trained(tmp_path):
    (tmp_path / "object").mkdir()
    flags = ["--out", str(tmp_path / "out"), "--detector.data.kind", "kitti_object", "--detector.data.root"]
    with pytest.raises(ValueError, match=r"real2sim2real: --detector\.data: .*training"):
        run([*flags, str(tmp_path / "object")])
    assert not (tmp_path / "out").exists()


def test_a_loop_of_other_settings_is_refused_before_anything_runs(loop, monkeypatch):
    monkeypatch.setattr("jaxsim.cli.real2sim2real.check_sources", lambda config: None)  # it renders a frame
    loop.detector("raw_64", 0).mkdir(parents=True)
    with pytest.raises(SystemExit, match="other settings"):
        main(["real2sim2real", "--out", str(loop.out), "--kinds", "raw_64", "--synthetic.seed", "5"])
    assert not (loop.out / "intensity").exists()
