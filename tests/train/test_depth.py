"""`python train.py penet_...`: from frames to weights that preparation uses, and on after a stop."""

import json
from dataclasses import replace

import cv2
import jax
import numpy as np
import pytest

from jaxsim.config import DataConfig, DepthExperiment, PenetConfig, RunConfig, Stage
from jaxsim.frame import DepthFrame
from jaxsim.prepare.depth.penet import training
from jaxsim.train import depth, train
from tests.quick import quick_jit

pytestmark = pytest.mark.long

CROP = (32, 64)
# Two stages of the same part: one program to compile, and the step from stage to stage all the same.
EXPERIMENT = DepthExperiment(
    data=DataConfig(kind="synthetic", train="0-7:4", validation="1920-1920"),
    image_crop=(64, 128),
    penet=PenetConfig(width=2, stages=(Stage("branches", 2, 1, CROP, ()),) * 2),
    run=RunConfig(name="depth", log_every=1, save_every=3, picture_every=100),
)


@pytest.fixture(autouse=True)
def standard_promotion():
    """optax raises floats to integers, which strict promotion forbids."""
    with jax.numpy_dtype_promotion("standard"):
        yield


@pytest.fixture(scope="module", autouse=True)
def quickly_compiled_steps():
    """The steps as they are, a few of which run here, without LLVM's work on them."""
    step = quick_jit(
        training.train_step.__wrapped__, static_argnames=("config", "part", "norms"), donate_argnames="state"
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(depth, "train_step", step)
        patch.setattr(depth, "predict", quick_jit(training.predict.__wrapped__, static_argnames=("config", "part")))
        yield


def lines(folder) -> list[dict]:
    return [json.loads(line) for line in (folder / "metrics.jsonl").read_text().splitlines()]


class Alike(list):
    """Frames that are one, by number."""

    def name_of(self, position: int) -> str:
        return f"frame-{position}"


def test_an_image_without_a_guess_ends_no_training(tmp_path, monkeypatch):
    experiment = replace(EXPERIMENT, run=replace(EXPERIMENT.run, out=tmp_path, save_every=100))
    near, saved, everywhere = [], [], np.ones((64, 128), bool)
    wall = np.full(everywhere.shape, 12, np.float32)
    frame = DepthFrame(
        np.zeros((64, 128, 3), np.uint8), wall, everywhere, wall, everywhere, np.eye(3, dtype=np.float32)
    )

    def learn(state, batch, lr, weight, **more):
        return state.replace(step=state.step + 1), {"finite": True, "rmse_m": lr, "loss/depth": lr}

    def guess(values, batch, **more):
        saved.append([path.name for path in (tmp_path / "depth" / "checkpoints").iterdir()])
        return np.full(batch.truth_m.shape, near.pop(0), np.float32)

    monkeypatch.setattr(depth, "frames_of", lambda experiment: (Alike([frame] * 2), Alike([frame] * 2)))
    monkeypatch.setattr(depth, "train_step", learn)
    monkeypatch.setattr(depth, "predict", guess)
    near += [0.0, 5.0, np.nan, np.inf, 0.0, 5.0]
    train(experiment, "No guess.")
    scored = [line for line in lines(tmp_path / "depth") if "validation/rmse" in line]
    assert [line["step"] for line in scored] == [4]  # of step 8's not one image could be scored
    assert "4" in saved[0]  # what was trained is saved before it is judged
    assert "- rmse: " in (tmp_path / "depth" / "card.md").read_text()
    assert "(1 of 2 images)" in (tmp_path / "depth" / "card.md").read_text()


@pytest.mark.parametrize(
    ("change", "flag"),
    [
        ({"image_crop": (60, 128)}, "--image-crop 32 128"),
        ({"penet": PenetConfig(stages=(EXPERIMENT.penet.stages[0], Stage("joint", 1, 1, (32, 70), ())))},
         r"--penet\.stages\.1\.crop 32 64"),
        ({"penet": PenetConfig(stages=(Stage("joint", 1, 1, (96, 64), ()),))}, r"lower --penet\.stages\.0\.crop"),
    ],
)  # fmt: skip
def test_sizes_of_all_stages_are_checked_before_the_first(tmp_path, change, flag):
    with pytest.raises(ValueError, match=flag):
        train(replace(EXPERIMENT, run=replace(EXPERIMENT.run, out=tmp_path), **change), "Wrong.")
    assert not [*tmp_path.iterdir()]


def test_a_stopped_training_goes_on_to_the_weights_of_an_unstopped_one(tmp_path, monkeypatch):
    whole, halved = (replace(EXPERIMENT, run=replace(EXPERIMENT.run, out=tmp_path, name=name)) for name in ("a", "b"))
    train(whole, "Whole.")
    taken, step = [], depth.train_step

    def interrupted(*arguments, **more):
        if len(taken) == 5:
            raise KeyboardInterrupt
        taken.append(1)
        return step(*arguments, **more)

    monkeypatch.setattr(depth, "train_step", interrupted)
    with pytest.raises(KeyboardInterrupt, match="stopped after step 5"):
        train(halved, "Stopped.")
    monkeypatch.setattr(depth, "train_step", step)
    train(halved, "Stopped.")
    assert lines(tmp_path / "a") == lines(tmp_path / "b")
    assert [line["step"] for line in lines(tmp_path / "a") if "rmse_m" in line] == list(range(1, 9))
    one, other = (np.load(tmp_path / name / "weights.npz") for name in "ab")
    arrays = [name for name in one.files if one[name].dtype == np.float32]
    assert len(arrays) > 100
    assert all((one[name] == other[name]).all() for name in arrays)
    assert "- rmse: " in (tmp_path / "a" / "card.md").read_text()
    assert cv2.imread(str(tmp_path / "a" / "figures" / "step_000008.png")) is not None

    other = replace(whole, penet=replace(whole.penet, start_m=3.0))
    with pytest.raises(ValueError, match=r"other settings \(penet\.start_m was .*, now 3\.0\)"):
        train(other, "Other.")
