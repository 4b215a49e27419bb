import dataclasses
import fcntl
import json
import shutil
import subprocess
import sys

import numpy as np
import pytest

from jaxsim.config import Experiment
from jaxsim.files import unlock
from jaxsim.frame import Camera, CameraFrame
from jaxsim.geometry import preset
from jaxsim.runs.frames import RunFrames, read_frames
from jaxsim.runs.run import describe_run, load_run, start_run

CAMERA = Camera(np.eye(3, dtype=np.float32), np.eye(4, dtype=np.float32))
VIEW = CameraFrame(np.zeros((375, 1242, 3), np.uint8), CAMERA)


def run(**changes):
    experiment = Experiment()
    optim = dataclasses.replace(experiment.optim, **changes)
    return describe_run(dataclasses.replace(experiment, optim=optim), preset("hdl64e"), VIEW)


def test_what_is_saved_is_loaded(tmp_path):
    start_run(tmp_path, run(lr=3e-4))
    assert load_run(tmp_path) == run(lr=3e-4)


def test_more_steps_resume_a_run_but_another_rate_does_not(tmp_path):
    start_run(tmp_path, run())
    start_run(tmp_path, run(steps=99999))
    assert load_run(tmp_path).experiment.optim.steps == 99999
    with pytest.raises(ValueError, match=r"optim\.lr was 0\.0002, now 0\.1"):
        start_run(tmp_path, run(steps=99999, lr=0.1))


def test_a_run_that_lost_its_settings_is_not_gone_on_with(tmp_path):
    start_run(tmp_path, run())
    (tmp_path / "checkpoints/40").mkdir(parents=True)
    (tmp_path / "config.json").unlink()
    with pytest.raises(ValueError, match=r"is not empty, and no config\.json says .*give another --run\.name"):
        start_run(tmp_path, run(lr=0.1))
    assert not (tmp_path / "config.json").exists()


def test_how_what_was_learned_is_told_may_change(tmp_path):
    start_run(tmp_path, run())
    generator = dataclasses.replace(Experiment().generator, widen=1.3, looks=1)
    start_run(tmp_path, describe_run(dataclasses.replace(Experiment(), generator=generator), preset("hdl64e"), VIEW))
    assert load_run(tmp_path).experiment.generator == generator


def test_a_folder_that_is_no_run_names_the_runs_in_it(tmp_path):
    start_run(tmp_path / "one", run())
    with pytest.raises(ValueError, match=r"there are runs at .*one"):
        load_run(tmp_path)
    with pytest.raises(ValueError, match=r"no config.json in .*oen; there are runs at .*one; `embedded` names"):
        load_run(tmp_path / "oen")


def test_settings_of_another_version_are_refused_with_the_field(tmp_path):
    start_run(tmp_path, run())
    path = tmp_path / "config.json"
    path.write_text(path.read_text().replace('"batch": 8', '"batch": "many"'))
    with pytest.raises(ValueError, match=r"experiment\.optim\.batch"):
        load_run(tmp_path)


@pytest.mark.parametrize("focal", ["1e30", "-700.0", "0.0"])
def test_a_camera_that_is_none_is_refused(tmp_path, focal):
    start_run(tmp_path, run())
    path = tmp_path / "config.json"
    content = json.loads(path.read_text())
    content["intrinsics"][0][0] = float(focal)
    path.write_text(json.dumps(content))
    with pytest.raises(ValueError, match=r"intrinsics are .* in pixels"):
        load_run(tmp_path)


TRAINER = """
import sys
from pathlib import Path
from jaxsim.runs.run import load_run, start_run

start_run(Path(sys.argv[1]), load_run(sys.argv[2]))
print("started", flush=True)
sys.stdin.read()
"""


def test_a_folder_in_training_is_refused_until_its_process_is_gone(tmp_path):
    start_run(tmp_path / "template", run())
    command = [sys.executable, "-c", TRAINER, tmp_path / "run", tmp_path / "template"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as other:
        try:
            assert other.stdout.readline() == "started\n"
            with pytest.raises(ValueError, match=rf"pid {other.pid} on .* another --run\.name"):
                start_run(tmp_path / "run", run())
            assert load_run(tmp_path / "run") == run()
        finally:
            other.kill()
    start_run(tmp_path / "run", run())


def test_a_folder_that_was_deleted_is_locked_anew(tmp_path):
    start_run(tmp_path / "run", run())
    shutil.rmtree(tmp_path / "run")
    start_run(tmp_path / "run", run())
    with (tmp_path / "run" / ".lock").open() as file, pytest.raises(BlockingIOError):
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


def test_a_moved_run_resumes(tmp_path):
    settings = dataclasses.replace(Experiment().run, name="a", out=tmp_path / "one")
    first = describe_run(dataclasses.replace(Experiment(), run=settings), preset("hdl64e"), VIEW)
    start_run(tmp_path / "one" / "a", first)
    unlock(tmp_path / "one" / "a")
    (tmp_path / "one" / "a").rename(tmp_path / "b")
    moved = dataclasses.replace(settings, name="b", out=tmp_path)
    start_run(tmp_path / "b", dataclasses.replace(first, experiment=dataclasses.replace(Experiment(), run=moved)))
    assert load_run(tmp_path / "b").experiment.run == moved


def test_the_names_of_frames_are_kept_where_a_run_begins_and_never_beside_one_that_began_without(tmp_path):
    first, second = RunFrames(("a",), ("b",)), RunFrames(("a",), ("c",))
    start_run(tmp_path / "new", run(), first)
    assert read_frames(tmp_path / "new") == first
    start_run(tmp_path / "new", run(), second)
    assert read_frames(tmp_path / "new") == second
    start_run(tmp_path / "earlier", run())
    start_run(tmp_path / "earlier", run(), first)
    assert read_frames(tmp_path / "earlier") is None


def test_a_refused_run_leaves_the_names_of_frames_as_they_were(tmp_path):
    start_run(tmp_path, run(), RunFrames(("a",), ("b",)))
    with pytest.raises(ValueError, match=r"optim\.lr"):
        start_run(tmp_path, run(lr=0.1), RunFrames(("c",), ("b",)))
    assert read_frames(tmp_path).train == ("a",)


def test_a_run_whose_data_have_moved_resumes_where_it_knows_its_frames_by_name(tmp_path):
    def on(root):
        data = dataclasses.replace(Experiment().data, kind="kitti_raw", root=root)
        return describe_run(dataclasses.replace(Experiment(), data=data), preset("hdl64e"), VIEW)

    here, there = tmp_path / "here", tmp_path / "there"
    here.mkdir()
    frames = RunFrames(("a",), ("b",))
    start_run(tmp_path / "run", on(here), frames)
    with pytest.raises(ValueError, match=r"data\.root was"):
        start_run(tmp_path / "run", on(there), frames)
    here.rename(there)
    start_run(tmp_path / "run", on(there), frames)
    assert load_run(tmp_path / "run").experiment.data.root == there
    # Without names others would be taken for them.
    start_run(tmp_path / "earlier", on(here))
    with pytest.raises(ValueError, match=r"data\.root was"):
        start_run(tmp_path / "earlier", on(there))
