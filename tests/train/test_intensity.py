"""The main job as a user runs it: train, kill, resume, score, simulate."""

import json
import os
import shutil
import socket
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import cv2
import numpy as np
import pytest

from jaxsim.cli import main
from jaxsim.config import DataConfig, Experiment, GeneratorConfig, LossConfig, OptimConfig, PrepareConfig
from jaxsim.data import open_dataset
from jaxsim.data.polar_frames import read_frame, read_grid
from jaxsim.pairs.prepared import prepared
from jaxsim.pix2pix.unet import cells_alone
from jaxsim.train.intensity import intensity_training, start_files
from tests.programs import ROOT, SMALL, running, said, wait_until
from tests.untrained import tiny_experiment, untrained_run

pytestmark = pytest.mark.long

TRAIN, EVAL = ROOT / "train.py", ROOT / "eval.py"
TINY = [
    "--data.train=0-3", "--data.validation=4-5", *SMALL, "--optim.batch=2", "--optim.steps=6", "--optim.ema-start=2",
    "--run.log-every=1", "--run.save-every=2", "--run.picture-every=3",
]  # fmt: skip
QUICK = {"JAX_DISABLE_MOST_OPTIMIZATIONS": "1"}
"""A few small steps run here, and LLVM would work on them far longer than they run."""
SHARED = {"XLA_FLAGS": os.environ["XLA_FLAGS"]}
"""As many devices as the tests' own process has: what is compiled for another number is not found in the cache."""


def metrics(run: Path) -> dict[tuple[int, str], float]:
    lines = [json.loads(line) for line in (run / "metrics.jsonl").read_text().splitlines()]
    return {(line["step"], name): value for line in lines for name, value in line.items() if name != "step"}


@pytest.fixture(scope="module")
def work(tmp_path_factory) -> Path:
    """A folder with runs/demo: a tiny network trained for six steps on the embedded world.

    Its frames are rendered in this process, which has compiled that for other tests, and in a fourth of the time: a
    program that LLVM did not work on renders slowly.
    """
    work = tmp_path_factory.mktemp("work")
    tiny = tiny_experiment(cache=work / ".cache/jaxsim")
    prepared(open_dataset(tiny.data), range(6), tiny.data, prepare=tiny.prepare)
    output = said(work, TRAIN, "synthetic", *TINY, "--run.name=demo", **QUICK)
    assert "perceptual loss: off" in output
    assert "preparing" not in output
    return work


@pytest.fixture
def told(work, monkeypatch, capsys) -> Callable[..., str]:
    """What a command says that is called in this process, from the folder: it imports and compiles nothing anew.

    A program of its own, whose exit status counts, is started once a command.
    """
    monkeypatch.chdir(work)

    def call(*words: str, fails: bool = False) -> str:
        ended = ""
        if fails:
            with pytest.raises(SystemExit) as stop:
                main([*words])
            ended = str(stop.value)
            assert ended.startswith("error: ")
        else:
            main([*words])
        return "".join(capsys.readouterr()) + ended

    return call


def test_a_run_holds_what_is_needed_to_use_and_to_judge_it(work):
    run = work / "runs" / "demo"
    assert {"config.json", "checkpoints", "metrics.jsonl", "figures", "card.md"} <= {p.name for p in run.iterdir()}
    assert cv2.imread(str(run / "figures" / "step_000006.png")) is not None
    assert (6, "validation/mae") in metrics(run)


def test_a_killed_run_resumes_to_the_result_of_an_uninterrupted_one(work):
    run = work / "runs" / "killed"
    with running(work, TRAIN, "synthetic", *TINY, "--run.name=killed", **QUICK) as process:
        # A checkpoint that is still being written has more than a number for a name.
        wait_until(lambda: any(path.name.isdigit() for path in (run / "checkpoints").glob("*")), process)
        process.kill()
    output = said(work, TRAIN, "synthetic", *TINY, "--run.name=killed", **QUICK)
    assert "resuming" in output
    assert metrics(run) == metrics(work / "runs" / "demo")


def trained_by_two(work: Path, *flags: str) -> list[str]:
    """What each of two processes says that train a run together."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{free.getsockname()[1]}"
    command = (TRAIN, "synthetic", *TINY, "--run.distributed", *flags)
    launcher = {"JAX_COORDINATOR_ADDRESS": address, "JAX_NUM_PROCESSES": "2", **QUICK}
    with ThreadPoolExecutor(2) as threads:
        each = [threads.submit(said, work, *command, **launcher, JAX_PROCESS_ID=str(i)) for i in range(2)]
        return [one.result() for one in each]


def test_two_processes_train_and_resume_the_run_that_one_trains(work):
    first, second = trained_by_two(work, "--run.name=shared")
    assert "6 steps done" in first
    assert "steps done" not in second
    ours, alone = metrics(work / "runs" / "shared"), metrics(work / "runs" / "demo")
    assert set(ours) == set(alone)
    for key, value in alone.items():
        if key[1].startswith("loss/"):  # after an update, Adam's steps on rounding noise differ
            assert ours[key] == pytest.approx(value, rel=1e-5 if key[0] == 1 else 1e-2), key
    # Two resume it, or one; four epochs of four frames are eight batches of two.
    shutil.copytree(work / "runs" / "shared", work / "alone" / "shared")
    first, _ = trained_by_two(work, "--run.name=shared", "--optim.epochs=4")
    assert "resuming" in first
    said(work, TRAIN, "synthetic", *TINY, "--run.name=shared", "--run.out=alone", "--optim.epochs=4", **QUICK)
    ours, alone = metrics(work / "runs" / "shared"), metrics(work / "alone" / "shared")
    assert max(ours)[0] == max(alone)[0] == 8
    for (step, name), value in alone.items():
        if step == 7 and name.startswith("loss/"):
            assert ours[step, name] == pytest.approx(value, rel=1e-5), name


def test_another_command_does_not_overwrite_a_run(work):
    output = said(work, TRAIN, "synthetic", *TINY, "--run.name=demo", "--optim.lr=0.5", fails=True)
    assert "optim.lr was" in output
    assert "--run.name" in output


def test_scores_come_with_every_baseline_beside_them(work):
    output = said(work, EVAL, "runs/demo", **SHARED)
    written = json.loads((work / "runs" / "demo" / "evaluation" / "scores.json").read_text())
    assert list(written["scores"]) == [
        "network",
        "global mean",
        "per-class mean",
        "per-row mean",
        "global median",
        "per-row median",
        "range, incidence, row",
        "previous frame",
    ]
    assert set(written["scores"]["network"]) == {"mae", "rmse", "psnr", "ssim", "drop_iou", "drop_f1"}
    assert all(name in output for name in written["scores"])


def test_too_few_frames_for_a_frechet_distance_stop_the_evaluation(work, told):
    output = told("eval", "runs/demo", "--fid", "random", "--fid-features", "64", "--out", "few", fails=True)
    assert "frechet_random_64: 2 frames to judge, 64 features" in output
    assert not (work / "few").exists()


SIMULATE = ("simulate", "runs/demo", "--batch", "2")


@pytest.fixture(scope="module")
def simulated(work) -> Path:
    """Three frames as the sensor of runs/demo sees them."""
    said(work, "-m", "jaxsim", *SIMULATE, "--frames", "4-6", "--out", "sim", **SHARED)
    return work / "sim"


def test_simulate_writes_frames_clouds_and_pictures_and_does_nothing_twice(work, told, simulated):
    grid, frames = read_grid(simulated / "polar")
    assert len(frames) == 3
    name = next(iter(frames))
    image, more = read_frame(simulated / "polar", name)
    assert image.range_m.shape == (len(grid.elevation_rad), 64)
    assert set(more) == {"semantic", "instance", "rgb", "incidence"}
    points = np.fromfile(simulated / "clouds" / f"{name}.bin", "<f4").reshape(-1, 4)
    assert len(points) == image.valid.sum() > 0
    np.testing.assert_allclose(
        np.sort(np.linalg.norm(points[:, :3] - [0, 0, 0], axis=1)),
        np.sort(image.range_m[image.valid]),
        atol=0.25,
    )
    assert len(list((simulated / "previews").glob("*.png"))) == 6
    compared = told("eval", "generation", "--simulated=sim/polar", "--measured=sim/polar", "--out=same")
    assert "3 simulated and 3 measured frames" in compared
    written = json.loads((work / "same" / "generation.json").read_text())["scores"]
    assert written["chamfer_distance_m"] == {"value": 0.0, "unit": "m", "count": 3}
    assert written["r2dm_jsd"]["value"] == 0
    (simulated / "clouds" / f"{name}.ply").unlink()
    before = {p: p.stat().st_mtime_ns for p in (simulated / "clouds").glob("*") if name not in p.name}
    second = told(*SIMULATE, "--frames", "4-6", "--out", "sim")
    assert "1 frame simulated" in second
    assert "2 were there" in second
    assert "clouds.html turns the frames that were drawn" in second
    assert before == {p: p.stat().st_mtime_ns for p in before}


def test_simulate_puts_a_sensor_model_s_effects_into_the_frames(work, told, simulated):
    chain = [
        {"name": "range_scale", "parameters": {"scale": 0.01}},
        {"name": "random_dropout", "parameters": {"probability": 0.3}},
    ]
    (work / "sensor.json").write_text(json.dumps({"effects": chain}))
    common = ("--formats", "bin", "--previews", "0")
    with_effects = (*common, "--sensor", "sensor.json", "--seed", "3", "--out", "real")
    for frames in ("5", "4-5"):
        result = told(*SIMULATE, "--frames", frames, *with_effects)
    assert "1 were there" in result
    names = read_grid(work / "real" / "polar")[1]
    assert len(names) == 2
    for name in names:
        (ideal, _), (real, _) = (read_frame(folder / "polar", name) for folder in (simulated, work / "real"))
        assert 0.6 < real.valid.sum() / ideal.valid.sum() < 0.8
        assert not (real.valid & ~ideal.valid).any()
        np.testing.assert_allclose(real.range_m[real.valid], 1.01 * ideal.range_m[real.valid], rtol=1e-5)
    for wrong in (("--out", "real"), ("--sensor", "sensor.json", "--seed", "4", "--out", "real")):
        assert "give another --out" in told(*SIMULATE, "--frames", "4-6", *common, *wrong, fails=True)


@pytest.mark.parametrize("part", ["rows", "columns"])
def test_a_part_that_is_larger_than_what_it_is_cut_out_of_is_refused(part):
    with pytest.raises(ValueError, match=f"--optim.{part} 5000 cannot be cut out of"):
        intensity_training(Experiment(optim=OptimConfig(**{part: 5000})))


def test_the_first_steps_learn_from_the_other_sides_of_the_scans_too(tmp_path):
    training = intensity_training(
        Experiment(
            data=DataConfig(kind="synthetic", train="0-1", validation="2-2", cache=tmp_path),
            prepare=PrepareConfig(columns=64, network_size=(64, 128), inputs=("rgb", "depth"), depth="ip_basic_fast"),
            generator=GeneratorConfig(form="unet", filters=4, downsamples=0, enhancers=0, looks=1),
            loss=LossConfig(gan=0.0, feature_matching=0.0, reconstruction=1.0),
            optim=OptimConfig(batch=2, steps=16, sides=0.5),
        )
    )
    assert "6 other sides of their scans, until step 8" in training.facts
    # Two frames and six sides, of which nobody took an image: four batches of two show each of the eight once.
    seen = [int((np.asarray(batch["inputs"])[..., 0] > -1).any((1, 2)).sum()) for batch in training.batches(0, 10)]
    assert (sum(seen[:4]), sum(seen[4:8]), seen[8:]) == (2, 2, [2, 2])


@pytest.mark.parametrize(("kind", "why"), [("prepared", "keeps no scans"), ("polar", "look all round already")])
def test_sets_without_other_sides_are_told(kind, why):
    with pytest.raises(ValueError, match=rf"{why}.* --optim.sides 0"):
        intensity_training(Experiment(data=DataConfig(kind=kind), optim=OptimConfig(sides=0.5)))


def test_a_network_that_hears_nothing_of_the_surroundings_says_so(tmp_path, caplog):
    unet = GeneratorConfig(form="unet", filters=4, downsamples=1, blocks=1, enhancers=0, looks=1)
    training = intensity_training(
        Experiment(
            data=DataConfig(kind="synthetic", train="0-1", validation="2-2", cache=tmp_path),
            prepare=PrepareConfig(columns=64, network_size=(64, 128)),
            generator=unet,
            loss=LossConfig(gan=0.0, feature_matching=0.0, reconstruction=1.0),
            optim=OptimConfig(batch=2),
        )
    )
    network = training.state.ema
    network["head"]["kernel"] = 10 * network["head"]["kernel"]  # as a learned one's: at the start all answers are alike
    training.validate(network, 0)
    assert "silent" not in caplog.text
    training.validate(cells_alone(network), 0)
    assert "each cell answers from its own inputs alone" in caplog.text
    assert "--optim.warm-up" in caplog.text


def test_the_papers_experiment_asks_for_vgg_before_it_reads_any_data(work, told):
    output = told("train", "kitti_step_combined", "--data.root=nowhere", fails=True)
    assert "vgg19-dcbb9e9d.pth" in output
    assert "leave the term out with --loss.perceptual 0" in output
    assert not (work / "runs" / "kitti_step_combined").exists()


def test_a_run_with_a_checkpoint_needs_the_files_no_more_that_it_began_from(tmp_path):
    optim = OptimConfig(start=(tmp_path / "generator.npz",))
    assert start_files(tmp_path / "new", optim) == optim.start
    assert not (tmp_path / "new").exists()
    assert start_files(untrained_run(tmp_path / "run", tiny_experiment()), optim) == ()
