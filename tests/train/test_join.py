"""Runs that were trained apart, joined to one whose network is their mean."""

from dataclasses import replace
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.config import Experiment
from jaxsim.pix2pix import make_generate, make_train_step, state_shapes
from jaxsim.runs.frames import RunFrames, read_frames, write_frames
from jaxsim.runs.run import Checkpoints, load_run
from jaxsim.train.join import join_runs
from tests.train.made_apart import CHANNELS, EXPERIMENT, trained_apart


def answer(folder: Path, inputs) -> np.ndarray:
    experiment = load_run(folder).experiment
    kept = Checkpoints(folder).restore("generator", state_shapes(experiment, CHANNELS).ema)
    return np.asarray(make_generate(experiment, CHANNELS)(kept, inputs))


def test_the_joined_run_says_the_mean_of_what_each_says(runs, tmp_path):
    join_runs(runs, tmp_path / "joined")
    inputs = jax.random.normal(jax.random.key(0), (2, 8, 16, CHANNELS))
    each = np.stack([answer(run, inputs) for run in runs])
    assert np.abs(each[0] - each[1]).max() > 0.01
    np.testing.assert_allclose(answer(tmp_path / "joined", inputs), each.mean(0), atol=1e-6)
    assert "- third" in (tmp_path / "joined" / "card.md").read_text()


@pytest.mark.long
@pytest.mark.filterwarnings("ignore:.*donated")
def test_the_joined_run_trains_on_as_each_would_from_its_share_of_the_batch(runs, tmp_path):
    joined = join_runs(runs, tmp_path / "joined").experiment
    assert joined.optim.batch == 6
    keys = jax.random.split(jax.random.key(1), 3)
    batch = {
        "inputs": jax.random.normal(keys[0], (6, 8, 16, CHANNELS)),
        "target": jax.random.uniform(keys[1], (6, 8, 16, 1), minval=-1),
        "weight": jnp.ones((6, 8, 16)),
        "returned": jnp.ones((6, 8, 16), bool),
        "dropped": jax.random.uniform(keys[2], (6, 8, 16)) < 0.3,
    }

    def after(folder: Path, experiment: Experiment, items: slice):
        state = Checkpoints(folder).restore("state", state_shapes(experiment, CHANNELS))
        with jax.numpy_dtype_promotion("standard"):
            stepped, _ = make_train_step(experiment, CHANNELS)(state, {k: v[items] for k, v in batch.items()})
        return stepped.generator.parameters

    together = after(tmp_path / "joined", joined, slice(0, 6))["members"]
    second = after(runs[1], EXPERIMENT, slice(2, 4))
    # Adam's first step is the rate times the gradient's sign, however many share the mean.
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, atol=1e-5), dict(together)[1], second)


def test_joined_again_it_is_the_same_run_and_other_runs_are_refused_there(runs, tmp_path):
    out = tmp_path / "joined"
    join_runs(runs, out)
    before = (out / "config.json").read_bytes()
    join_runs(runs, out)
    assert (out / "config.json").read_bytes() == before
    with pytest.raises(ValueError, match=r"generator\.members was 3, now 2.*another"):
        join_runs(runs[:2], out)


def test_joined_again_a_run_that_trained_on_stays_as_it_is(runs, tmp_path):
    """Its first checkpoint, which later ones had replaced, came back in the place of one of them, with its card."""
    out = tmp_path / "joined"
    experiment, saved = join_runs(runs, out).experiment, Checkpoints(out)
    state = saved.restore("state", state_shapes(experiment, CHANNELS))
    for step in (10, 20):
        saved.save(step, state=state.replace(step=jnp.int32(step)), generator=state.ema)
    (out / "card.md").write_text("20 steps")
    join_runs(runs, out)
    assert Checkpoints(out).steps == [10, 20]
    assert (out / "card.md").read_text() == "20 steps"


def test_the_joined_runs_epochs_are_as_many_steps_as_each_had(tmp_path):
    optim = replace(EXPERIMENT.optim, epochs=5)
    apart = [trained_apart(tmp_path / name, seed, optim=optim) for seed, name in enumerate(("first", "second"))]
    joined = join_runs(apart, tmp_path / "joined").experiment.optim
    assert joined.epochs * 2 // joined.batch == optim.epochs * 2 // optim.batch == 5  # of two frames


def test_what_trains_nothing_may_differ_and_is_the_firsts(runs, tmp_path):
    other = trained_apart(tmp_path / "other", 8, generator=replace(EXPERIMENT.generator, widen=1.3, looks=2))
    join_runs([runs[0], other], tmp_path / "joined")
    assert load_run(tmp_path / "joined").experiment.generator == replace(EXPERIMENT.generator, members=2)


def test_what_cannot_be_joined_is_refused(runs, tmp_path):
    first = runs[0]
    with pytest.raises(ValueError, match="name two runs or more, each once"):
        join_runs([first], tmp_path / "out")
    with pytest.raises(ValueError, match="name two runs or more, each once"):
        join_runs([first, first], tmp_path / "out")
    late = trained_apart(tmp_path / "late", 7, step=6)
    with pytest.raises(ValueError, match=r"different steps \(.*first 5, .*late 6\); train them all to the same one"):
        join_runs([first, late], tmp_path / "out")
    other = trained_apart(tmp_path / "other", 8, optim=replace(EXPERIMENT.optim, lr=0.1))
    with pytest.raises(ValueError, match=r"of .*other optim\.lr was 0\.01, now 0\.1; .*differ in their seed alone"):
        join_runs([first, other], tmp_path / "out")
    image = trained_apart(tmp_path / "image", 9, generator=replace(EXPERIMENT.generator, form="original"))
    with pytest.raises(ValueError, match=r"image is original's; name runs of one U-Net each"):
        join_runs([first, image], tmp_path / "out")
    join_runs(runs, tmp_path / "joined")
    with pytest.raises(ValueError, match="joined is joined itself"):
        join_runs([first, tmp_path / "joined"], tmp_path / "out")
    assert not (tmp_path / "out").exists()
    (tmp_path / "empty").mkdir()
    with pytest.raises(ValueError, match=r"no config\.json in .*empty"):
        join_runs([first, tmp_path / "empty"], tmp_path / "out")


def test_members_need_a_unet_and_equal_shares():
    pix2pix = replace(EXPERIMENT, generator=replace(EXPERIMENT.generator, form="original", members=2))
    with pytest.raises(ValueError, match=r"--generator\.members is for --generator\.form unet"):
        state_shapes(pix2pix, CHANNELS)
    five = replace(EXPERIMENT, generator=replace(EXPERIMENT.generator, members=2))
    step = make_train_step(five, CHANNELS)
    shapes = jax.eval_shape(lambda: {"inputs": jnp.zeros((5, 8, 16, CHANNELS)), "target": jnp.zeros((5, 8, 16, 1))})
    with pytest.raises(
        ValueError, match=r"5 items a device cannot be shared by 2 networks .*--optim\.batch a multiple"
    ):
        jax.eval_shape(step, state_shapes(five, CHANNELS), shapes)


def test_runs_that_learned_other_frames_are_not_joined_and_the_joined_run_knows_its_own(runs, tmp_path):
    for folder in runs[:2]:
        write_frames(folder, RunFrames(("a-0", "a-1"), ("b-0",)))
    join_runs(runs[:2], tmp_path / "joined")
    assert read_frames(tmp_path / "joined") == read_frames(runs[0])
    join_runs(runs[1:], tmp_path / "unknown")  # the third is an earlier version's
    assert read_frames(tmp_path / "unknown") is None
    write_frames(runs[2], RunFrames(("a-0", "c-0"), ("b-0",)))
    with pytest.raises(ValueError, match=r"third learned from other frames than .*first: 1 of its 2 .*a-1.*c-0"):
        join_runs(runs, tmp_path / "out")
    assert not (tmp_path / "out").exists()
