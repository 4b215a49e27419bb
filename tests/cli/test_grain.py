"""`jaxsim grain`, and draws of a run with and without one."""

import json
from pathlib import Path

import jax
import numpy as np
import pytest

from jaxsim.cli import main
from jaxsim.data.polar_frames import read_frame, read_grid
from jaxsim.simulate.grain import FILE, read_grain
from tests.programs import SMALL
from tests.untrained import tiny_experiment, untrained_run

pytestmark = pytest.mark.long

UNET = [
    "--generator.form=unet", "--generator.filters=2", "--generator.downsamples=0", "--generator.enhancers=0",
    "--loss.gan=0", "--loss.feature-matching=0", "--loss.reconstruction=1",
]  # fmt: skip


@pytest.fixture(scope="module")
def work(tmp_path_factory) -> Path:
    """A folder with runs/unet, which took a step on the embedded world."""
    work = tmp_path_factory.mktemp("work")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(work)
        frames = ["--data.train=0-1", "--data.validation=4-5"]
        flags = ["--optim.batch=2", "--optim.steps=1", "--run.name=unet"]
        # optax raises floats to integers, which strict promotion forbids.
        with jax.numpy_dtype_promotion("standard"):
            main(["train", "synthetic", *frames, *SMALL, *UNET, *flags])
    return work


@pytest.fixture(scope="module")
def simulate(work):
    """Draws the run's two validation frames to a folder; their intensities."""

    def call(out: str, *flags: str) -> np.ndarray:
        with pytest.MonkeyPatch.context() as patch:
            patch.chdir(work)
            main(["simulate", "runs/unet", "--out", out, "--formats", "bin", "--previews", "0", "--draws", *flags])
        _, names = read_grid(work / out / "polar")
        return np.stack([read_frame(work / out / "polar", name)[0].intensity for name in sorted(names)])

    return call


@pytest.fixture(scope="module")
def first(simulate) -> np.ndarray:
    return simulate("first")


def test_a_training_leaves_the_grain_of_its_validation_frames(work):
    grain = read_grain(work / "runs" / "unet")
    assert grain.scenes
    assert sum(field.share for field in grain.intensity) == pytest.approx(1, abs=1e-3)


def test_the_command_learns_what_the_training_did_and_shows_it(work, monkeypatch, capsys):
    monkeypatch.chdir(work)
    before = read_grain(work / "runs" / "unet")
    (work / "runs" / "unet" / FILE).unlink()
    main(["grain", "runs/unet"])
    told = capsys.readouterr().out
    assert "| share | columns | rows | edge, m |" in told
    assert "runs/unet/grain.json: jaxsim simulate runs/unet --draws" in told
    assert read_grain(work / "runs" / "unet") == before
    main(["grain", "runs/unet", "--frames", "0"])
    assert read_grain(work / "runs" / "unet") != before
    main(["grain", "runs/unet"])


def test_draws_of_a_seed_are_the_same_and_those_of_another_or_without_grain_are_not(simulate, first):
    np.testing.assert_array_equal(first, simulate("again"))
    assert (first != simulate("other", "--seed", "1")).mean() > 0.1
    assert (first != simulate("single", "--no-grain")).mean() > 0.1


def test_draws_of_one_kind_do_not_go_on_in_the_folder_of_another(simulate, first):
    with pytest.raises(SystemExit, match=r"data was synthetic, drawn, grain [0-9a-f]{8}, now synthetic, drawn\)"):
        simulate("first", "--no-grain")


def test_a_run_of_before_is_told_what_to_do_and_draws_cells_alone(simulate, work):
    path = work / "runs" / "unet" / FILE
    kept = path.read_text()
    path.unlink()
    try:
        with pytest.raises(SystemExit, match=r"has no grain\.json.*jaxsim grain runs/unet.*\(--no-grain\)"):
            simulate("old")
        simulate("old", "--no-grain")
        path.write_text(json.dumps({"intensity": []}))
        with pytest.raises(SystemExit, match=r"(?s)grain\.json is no run's grain.*learn it anew: jaxsim grain RUN"):
            simulate("bad")
    finally:
        path.write_text(kept)


def test_a_network_of_one_intensity_a_cell_has_no_grain_to_learn_and_nothing_to_draw(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run = untrained_run(tmp_path / "plain", tiny_experiment(validation="0"))
    with pytest.raises(SystemExit, match="no distribution to draw from"):
        main(["grain", str(run)])
    with pytest.raises(SystemExit, match=r"leave out --draws, or train one with --generator\.form unet"):
        main(["simulate", str(run), "--draws", "--previews", "0", "--out", "out"])


def test_a_network_without_a_distribution_is_told_before_frames_are_prepared(tmp_path, monkeypatch):
    """The pairs took minutes, for nothing."""
    monkeypatch.setattr("jaxsim.cli.grain.prepared", None)
    run = untrained_run(tmp_path / "run", tiny_experiment(validation="4", cache=tmp_path / "cache"))
    with pytest.raises(SystemExit, match=r"one intensity a cell, .*--generator\.form unet"):
        main(["grain", str(run)])


def test_the_packaged_sensor_keeps_the_grain_that_it_came_with(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit, match=r"has its grain with it; give the folder of a run of yours"):
        main(["grain", "embedded"])
    assert not (tmp_path / "embedded").exists()
