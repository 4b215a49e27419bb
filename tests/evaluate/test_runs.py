"""Scores of a run."""

import shutil
from dataclasses import replace
from pathlib import Path

from jaxsim.config import RunConfig
from jaxsim.evaluate.intensity import baseline_sums
from jaxsim.evaluate.runs import mean_words, score_learned_sensor, scores_by_scene
from jaxsim.metrics.paired import total_scores
from jaxsim.runs.frames import RunFrames
from jaxsim.simulate.learned_sensor import LearnedSensor, load
from tests.evaluate.made import street
from tests.untrained import tiny_experiment, untrained_run


def test_scores_come_scene_by_scene():
    judged = [street(seed) for seed in range(10, 14)]
    sums = baseline_sums([street(0), street(1)], judged, [None] * len(judged))
    found = scores_by_scene(sums | {"network": sums["global mean"]}, ["a", "a", "b", "b"])
    assert list(found) == ["a", "b"]
    assert found["a"]["per-row median"] == total_scores(sums["per-row median"][:2])


def test_a_mean_of_five_epochs_needs_no_excuse_and_one_of_fewer_says_why():
    epochs = RunConfig(save_every=0, keep=5)
    assert mean_words([5, 10, 15, 20, 25], epochs).endswith("the last 5 epochs (steps 5, 10, 15, 20, 25)")
    assert mean_words([5, 10], epochs).endswith(
        "the last 2 epochs (steps 5, 10); the paper's is of 5 (no more are there)"
    )


RECORDED = RunFrames(
    tuple(f"2011_09_26_drive_0001_sync-{k:010d}" for k in range(2)), ("2011_09_26_drive_0002_sync-0000000000",)
)
"""The frames that `of_drives` learned from and is judged by."""


def of_drives(root: Path, folder: Path) -> LearnedSensor:
    """A run that is to have learned from two frames of one drive, and to be judged by one of another."""
    data = {"kind": "kitti_raw", "root": root, "train": "0-1", "validation": "2", "cache": folder / "cache"}
    experiment = tiny_experiment(**data)
    prepare = replace(experiment.prepare, inputs=("rgb",), depth="ip_basic")
    return load(untrained_run(folder / "run", replace(experiment, prepare=prepare)))


def test_a_run_is_judged_by_name_where_a_drive_that_sorts_first_joined_its_data(raw_root, tmp_path, caplog):
    """By position it would be judged on what it learned from, beside baselines of what it did not."""
    sensor = of_drives(raw_root, tmp_path)
    own = sensor.run.experiment.data
    before = score_learned_sensor(sensor, own, validation=own.validation, recorded=RECORDED)
    caplog.clear()
    date = raw_root / "2011_09_26"
    shutil.copytree(date / "2011_09_26_drive_0002_sync", date / "2011_09_26_drive_0000_sync")

    after = score_learned_sensor(sensor, own, validation=own.validation, recorded=RECORDED)
    assert after.pairs.names == before.pairs.names == [*RECORDED.validation]
    assert after.scores == before.scores
    told = [message for message in caplog.messages if "no longer those of the run" in message]
    assert [message.split()[0] for message in told] == ["validation", "training"]
    caplog.clear()
    score_learned_sensor(sensor, own, frames="1-2", recorded=RECORDED)
    assert any(
        "2 of the 2 frames that judge are training frames too" in m and RECORDED.train[0] in m for m in caplog.messages
    )


def test_a_run_is_judged_wherever_its_data_have_gone(raw_root, tmp_path, caplog):
    sensor = of_drives(raw_root, tmp_path)
    own = sensor.run.experiment.data
    before = score_learned_sensor(sensor, own, validation=own.validation, recorded=RECORDED)
    moved = raw_root.rename(raw_root.parent / "moved")
    after = score_learned_sensor(sensor, replace(own, root=moved), validation=own.validation, recorded=RECORDED)
    assert after.pairs.names == before.pairs.names
    assert after.scores == before.scores

    # Where only other drives are, the network is judged alone.
    others = tmp_path / "others"
    drive = "2011_09_26/2011_09_26_drive_0001_sync"
    shutil.copytree(moved / drive, others / drive.replace("0001", "0009"))
    for file in (moved / "2011_09_26").glob("*.txt"):
        shutil.copy(file, others / "2011_09_26")
    caplog.clear()
    alone = score_learned_sensor(sensor, replace(own, root=others), frames="0", recorded=RECORDED)
    assert list(alone.scores) == ["network"]
    assert any("is judged without baselines" in message for message in caplog.messages)
