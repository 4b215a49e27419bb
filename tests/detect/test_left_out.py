"""What training leaves out is counted at every step, told, and comes with the flag that helps."""

import json
from dataclasses import dataclass, replace

import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.detect import LeftOut
from jaxsim.detect.backbones import DOWN
from jaxsim.detect.steps import REMEDIES
from jaxsim.metrics import Score
from jaxsim.runs.frames import RunFrames
from jaxsim.runs.kinds import DetectorRun
from jaxsim.runs.run import Checkpoints
from jaxsim.train import loop
from jaxsim.train.training import Training
from tests.detect.tiny import EXPERIMENT


def lost(**counts):
    return {"loss/total": jnp.array(1.0), **{f"dropped/{name}": jnp.array(n) for name, n in counts.items()}}


def test_the_most_since_the_last_line_is_kept_and_the_most_of_all():
    left_out = LeftOut()
    for voxels, points in ((0, 0), (7, 0), (3, 0)):
        left_out.see(lost(voxels=voxels, points=points))
    assert left_out.take() == {"dropped/voxels": 7, "dropped/points": 0}
    left_out.see(lost(voxels=2, points=5))
    assert left_out.take() == {"dropped/voxels": 2, "dropped/points": 5}
    said = left_out.words()
    assert "in 3 of 4 steps; most left out: 5 of points, 7 of voxels" in said
    assert said.endswith("raise --voxels.max-points, --voxels.max-voxels-train")


def test_sites_of_later_stages_need_growth():
    left_out = LeftOut()
    left_out.see(lost(conv3=4, out=2, voxels=0))
    assert left_out.words().endswith("4 of conv3, 2 of out; raise --voxels.growth")


def test_nothing_is_said_where_nothing_was_lost():
    left_out = LeftOut()
    left_out.see(lost(voxels=0))
    left_out.see({"loss/total": jnp.array(1.0)})  # an intensity network drops nothing
    assert left_out.words() == ""


@dataclass(frozen=True)
class Counter:
    step: int


def training(drops, experiment):
    """Four steps, of which each drops so many voxels; nothing is learned."""

    def step(state, batch, k):
        return Counter(state.step + 1), {"finite": jnp.array(True), **lost(voxels=drops[k], conv2=0)}

    return Training(
        run=DetectorRun(experiment, len(drops), 8),
        frames=RunFrames(("a",), ("b",)),
        steps=len(drops),
        save_every=100,
        judge_every=100,
        state=Counter(0),
        mesh=lambda k: None,
        batches=lambda a, b: [{"number": np.int32(k)} for k in range(a, b)],
        step=step,
        network="network",
        used=lambda state: {"step": np.int32(state.step)},
        validate=lambda used, step: ({"AP": Score(0.0, "%", 1)}, np.zeros((8, 8, 3), np.uint8)),
        facts=(),
        scored=lambda scores: "",
        use="",
        hint="",
    )


@pytest.mark.parametrize(("drops", "steps"), [((0, 9, 0, 0), 1), ((0, 0, 0, 0), 0)])
def test_a_step_that_is_not_logged_is_counted_and_told(tmp_path, monkeypatch, capsys, drops, steps):
    monkeypatch.setattr(loop, "training_of", lambda experiment: training(drops, experiment))
    monkeypatch.setattr(loop, "Checkpoints", Kept)
    monkeypatch.setattr(loop.devices, "everywhere", lambda mesh, state: state)
    settings = replace(EXPERIMENT.run, name="short", out=tmp_path, log_every=4)
    loop.train(replace(EXPERIMENT, run=settings))
    lines = [json.loads(line) for line in (tmp_path / "short" / "metrics.jsonl").read_text().splitlines()]
    assert [line["dropped/voxels"] for line in lines if "loss/total" in line] == [max(drops)]
    said = capsys.readouterr()
    told = f"no room for all of a scene in {steps} of 4 steps; most left out: 9 of voxels; raise --voxels.max-voxels"
    assert (told in said.out + said.err) == bool(steps)


class Kept(Checkpoints):
    """Checkpoints that keep nothing."""

    latest = None
    steps = ()

    def __init__(self, folder, keep=1):
        pass

    def save(self, step, **trees):
        pass


def test_whatever_a_step_counts_has_its_remedy():
    """A stage without one would end a training at its first line."""
    assert set(REMEDIES) == {"points", "voxels", *DOWN}
