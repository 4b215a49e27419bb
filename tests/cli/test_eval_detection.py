"""`eval.py RUN` of a detector: what it says of the mean over checkpoints. The detections are the labels, moved."""

import json
from dataclasses import replace

import numpy as np
import pytest

from jaxsim.cli import main
from jaxsim.cli.eval import Evaluation
from jaxsim.config import RunConfig
from jaxsim.detect.results import Detected
from jaxsim.detect.steps import create_state
from jaxsim.evaluate.detector import kitti_curves
from jaxsim.runs.kinds import DetectorRun
from jaxsim.runs.run import Checkpoints, start_run
from tests.detect.tiny import EXPERIMENT, scene

SCENES = [scene(seed) for seed in range(8)]
EVERY_3 = replace(EXPERIMENT, run=RunConfig(save_every=3, keep=2), data=replace(EXPERIMENT.data, validation="0-7"))


class Named(list):
    """A data set: its frames have names."""

    def name_of(self, index):
        return f"frame_{index}"


@pytest.fixture
def run(tmp_path, monkeypatch):
    """Checkpoints of steps 3 and 6; the first finds every car 0.4 m too high, less than 0.7 of its volume."""
    start_run(tmp_path / "run", DetectorRun(EVERY_3, 6, 8))
    state = create_state(EVERY_3, 6, seed=0)
    for step in (3, 6):
        Checkpoints(tmp_path / "run", keep=2).save(step, state=state, network=state.network)
    heights = iter((0.4, 0.0))

    def scored(find, network, scenes, *, experiment):
        off = np.array([0, 0, next(heights), 0, 0, 0, 0], np.float32)
        found = [Detected(s.boxes + off, np.full(len(s.boxes), 0.6, np.float32)) for s in scenes]
        return kitti_curves(scenes, found, experiment), found

    monkeypatch.setattr("jaxsim.evaluate.runs.open_dataset", lambda source: Named(SCENES))
    monkeypatch.setattr("jaxsim.evaluate.runs.experiment_scenes", lambda *_: SCENES)
    monkeypatch.setattr("jaxsim.evaluate.runs.score_detector", scored)
    return tmp_path / "run"


def test_the_mean_over_checkpoints_is_written_with_its_steps(run, capsys):
    Evaluation(run, pictures=1)()
    assert len([*(run / "evaluation").glob("*.png")]) == 1
    for flag in ({"trees": True}, {"fid": "random"}):
        with pytest.raises(ValueError, match="is a detector's run, which --trees and --fid are not for"):
            Evaluation(run, **flag)()
    said = (
        "of the last 2 checkpoints, one every 3 steps (steps 3, 6); the paper's is of 5 (the run keeps 2: --run.keep 5)"
    )
    content = json.loads((run / "evaluation/detection.json").read_text())
    page = (run / "evaluation/detection.md").read_text()
    for place in (capsys.readouterr().out, content["mean"]["of"], page):
        assert said in place
    assert content["mean_of_steps"] == [3, 6]
    means = {(m["metric"], m["overlap_set"], m["difficulty"]): m for m in content["mean"]["averages"]}
    moderate = means["3d", "0.7", "moderate"]
    assert (moderate["ap_r40"], moderate["spread"]) == (pytest.approx(50), pytest.approx(50))
    assert means["bev", "0.7", "moderate"]["ap_r40"] == pytest.approx(100)
    assert "| 0.7 3D |" in page
    assert "50.00 (50.00)" in page
    last = next(
        c for c in content["curves"] if (c["metric"], c["difficulty"], c["overlap_set"]) == ("3d", "moderate", "0.7")
    )
    assert last["ap_r40"] == pytest.approx(100)


def test_classes_must_be_named_and_another_folder(tmp_path):
    with pytest.raises(SystemExit, match=r"--classes names none; give some of Car, Pedestrian, Cyclist"):
        main(["eval", "detection", "--detections", str(tmp_path), "--labels", str(tmp_path), "--classes"])
    with pytest.raises(SystemExit, match=r"detection: .* is read, and would be written into"):
        main(["eval", "detection", f"--detections={tmp_path}", f"--labels={tmp_path}", f"--out={tmp_path}"])
