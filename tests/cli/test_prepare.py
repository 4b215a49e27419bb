"""`jaxsim prepare` as a user runs it: killed and started again, by Beam, and trained on."""

import json
import os
import shutil
import signal
import sys
from pathlib import Path

import numpy as np
import psutil
import pytest

from jaxsim.cli import main
from jaxsim.config import DataConfig, PrepareConfig
from jaxsim.data.tfds_builder import NAME
from jaxsim.pairs.sets import make_set
from jaxsim.pairs.shards import DASK_RUNNER, _spelled_out
from jaxsim.prepare.denoise.lidia import Variant, published_shapes
from jaxsim.prepare.depth.penet import save_penet
from jaxsim.prepare.depth.penet.published import create
from tests.prepare.lidia_oracle import random_state
from tests.programs import PATIENCE_S, ROOT, running, said, wait_until

FLAGS = ["--prepare.inputs", "rgb", "depth", "row", "--prepare.depth", "ip_basic_fast", "--prepare.columns", "64"]
PREPARE = PrepareConfig(inputs=("rgb", "depth", "row"), depth="ip_basic_fast", columns=64)
SET = Path("jaxsim_pairs/kitti_raw/1.0.0")


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.fixture
def drives(raw_root) -> Path:
    """Twelve frames."""
    drive = raw_root / "2011_09_26/2011_09_26_drive_0002_sync"
    for k in range(1, 10):
        for kind, suffix in (("velodyne_points", "bin"), ("image_02", "png")):
            shutil.copy(drive / kind / f"data/{0:010d}.{suffix}", drive / kind / f"data/{k:010d}.{suffix}")
    return raw_root


@pytest.mark.long
def test_a_killed_command_leaves_no_process_behind_and_goes_on_to_the_same_bytes(drives, tmp_path):
    out = tmp_path / "set of pairs"
    command = ["-m", "jaxsim", "prepare", "kitti_raw", "--root", drives, "--out", out, *FLAGS]
    command += ["--eval", "9-11", "--train", "0-8", "--pairs-a-file", "2", "--workers", "2"]
    making = out / SET.with_name("1.0.0.making")
    with running(tmp_path, *command) as process:
        wait_until(lambda: bool(list(making.glob("done/*.json"))), process)
        children = psutil.Process(process.pid).children()
        process.kill()
    assert len(children) >= 2
    assert psutil.wait_procs(children, timeout=PATIENCE_S)[1] == []
    if making.is_dir():  # else it had finished before the signal came
        kept = {path.name: path.stat().st_mtime_ns for path in making.glob("done/*.json")}
        assert len(kept) < 7
        output = said(tmp_path, *command)
        assert f"train on it: jaxsim train ... --data.kind prepared --data.root '{out}'" in output
    whole = make_set(
        tmp_path / "whole",
        DataConfig(kind="kitti_raw", root=drives),
        PREPARE,
        train="0-8",
        evaluation="9-11",
        size=2,
        workers=1,
    )
    assert contents(out / SET) == contents(whole)


def test_an_interrupted_command_ends_with_a_line_and_leaves_no_process_behind(drives, tmp_path):
    """As a terminal interrupts: all processes of the command at once."""
    command = ["-m", "jaxsim", "prepare", "kitti_raw", "--root", drives, "--out", tmp_path / "out", *FLAGS]
    command += ["--eval", "9-11", "--train", "0-8", "--pairs-a-file", "2", "--workers", "2"]
    with running(tmp_path, *command) as process:
        wait_until(lambda: len(psutil.Process(process.pid).children()) >= 2, process)
        children = psutil.Process(process.pid).children(recursive=True)
        for one in (process, *children):
            one.send_signal(signal.SIGINT)
        output = process.communicate(timeout=PATIENCE_S)[0]
    assert psutil.wait_procs(children, timeout=PATIENCE_S)[1] == []
    assert process.returncode == 130, output
    assert "Traceback" not in output
    assert "the same command goes on" in output


def test_beams_two_workers_write_the_bytes_of_the_plain_command(drives, tmp_path):
    pytest.importorskip("apache_beam", reason="Apache Beam is not installed: pip install -e '.[beam]'")
    data = DataConfig(kind="kitti_raw", root=drives)
    plain = make_set(tmp_path / "plain", data, PREPARE, size=3, workers=1)
    out = tmp_path / "beam"
    command = ["-m", "jaxsim", "prepare", "kitti_raw", "--root", drives, "--out", out, *FLAGS]
    command += ["--pairs-a-file", "3", "--beam", "runner=DirectRunner"]
    command += ["direct_num_workers=2", "direct_running_mode=multi_processing"]
    broken = drives / "2011_09_26/2011_09_26_drive_0002_sync/velodyne_points/data/0000000009.bin"
    sound = broken.read_bytes()
    broken.write_bytes(sound[:-1])
    output = said(tmp_path, *command, fails=True)
    (error,) = (line for line in output.splitlines() if line.startswith("error: "))
    assert "0000000009.bin is truncated" in error
    broken.write_bytes(sound)
    said(tmp_path, *command)
    assert contents(out / SET) == contents(plain)


def test_a_clusters_workers_write_the_bytes_of_the_plain_command_and_a_broken_frame_spoils_its_file_alone(
    drives, tmp_path, scheduler, monkeypatch
):
    monkeypatch.chdir(tmp_path)  # paths that are relative
    plain = make_set(tmp_path / "plain", DataConfig(kind="kitti_raw", root=drives), PREPARE, size=2, workers=1)
    command = ["prepare", "kitti_raw", "--root", str(drives.relative_to(tmp_path)), "--out", "out", *FLAGS]
    command += ["--pairs-a-file", "2", "--cluster", scheduler]
    broken = drives / "2011_09_26/2011_09_26_drive_0002_sync/velodyne_points/data/0000000009.bin"
    sound, written_ns = broken.read_bytes(), broken.stat().st_mtime_ns
    broken.write_bytes(sound[:-1])
    with pytest.raises(SystemExit, match=r"1 of 6 pieces of work failed.*0000000009\.bin is truncated"):
        main(command)
    made = {note.name: note.stat().st_mtime_ns for note in Path("out").rglob("done/*.json")}
    assert len(made) == 5
    broken.write_bytes(sound)
    os.utime(broken, ns=(written_ns, written_ns))  # as a copy that keeps times; the set names its files by theirs
    main(command)
    assert contents("out" / SET) == contents(plain)


def test_nothing_is_begun_before_the_cluster_answers(drives, tmp_path, monkeypatch):
    pytest.importorskip("distributed", reason="Dask is not installed: pip install -e '.[dask]'")
    monkeypatch.setattr("jaxsim.cluster.ANSWER_S", 0.2)
    command = ["prepare", "kitti_raw", "--root", str(drives), "--out", str(tmp_path / "out"), *FLAGS]
    with pytest.raises(SystemExit, match=r"prepare: no scheduler answers at tcp://127\.0\.0\.1:9; start one"):
        main([*command, "--cluster", "tcp://127.0.0.1:9"])
    assert not (tmp_path / "out").exists()


def test_two_ways_at_once_are_refused(drives, tmp_path):
    command = ["prepare", "kitti_raw", "--root", str(drives), "--out", str(tmp_path / "out"), *FLAGS]
    with pytest.raises(SystemExit, match="--beam and --cluster are two ways"):
        main([*command, "--cluster", "tcp://127.0.0.1:9", "--beam", "runner=DirectRunner"])


@pytest.mark.parametrize(
    ("given", "wanted"),
    [
        (["runner=DirectRunner", "--x=1"], ["runner=DirectRunner", "x=1"]),
        (["runner=DaskRunner"], [f"runner={DASK_RUNNER}", "dask_npartitions=5"]),
        (["--runner=DaskRunner", "dask_npartitions=2"], [f"runner={DASK_RUNNER}", "dask_npartitions=2"]),
        ([f"runner={DASK_RUNNER}"], [f"runner={DASK_RUNNER}", "dask_npartitions=5"]),
    ],
)
def test_beams_runner_on_dask_is_told_to_use_all_workers(given, wanted):
    assert _spelled_out(given, 5) == wanted


def test_beam_that_is_not_installed_says_how_to_install_it(raw_root, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "apache_beam", None)
    with pytest.raises(SystemExit) as stop:
        main(["prepare", "kitti_raw", "--root", str(raw_root), "--out", str(tmp_path), *FLAGS, "--beam", "runner=X"])
    assert "--beam needs Apache Beam" in str(stop.value)
    assert "pip install 'jaxsim-lidar[beam]'" in str(stop.value)


@pytest.fixture(scope="module")
def weights(tmp_path_factory) -> Path:
    """A folder of networks that do not fit: for colour images, cut off, and one that fits for sizes that divide."""
    folder = tmp_path_factory.mktemp("weights")
    np.savez(folder / "state.npz", **random_state(published_shapes(Variant(colour=True)), seed=0))
    main(["convert", "lidia", str(folder / "state.npz"), "--out", str(folder / "colour.npz")])
    (folder / "cut.npz").write_bytes((folder / "colour.npz").read_bytes()[:5000])
    save_penet(folder / "penet.npz", create(2, 0))
    return folder


@pytest.mark.long
@pytest.mark.parametrize(
    ("flags", "said"),
    [
        (["--prepare.denoise", "lidia"], r"lidia needs its weights.*--prepare\.denoise-weights"),
        (
            ["--prepare.denoise", "lidia", "--prepare.denoise-weights", "colour.npz"],
            "these weights are for colour images",
        ),
        (
            ["--prepare.denoise", "lidia", "--prepare.denoise-weights", "cut.npz"],
            "no readable .npz.*convert or copy it",
        ),
        (["--prepare.depth", "penet"], r"penet needs its weights.*--prepare\.depth-weights"),
        (["--prepare.depth", "penet", "--prepare.depth-weights", "colour.npz"], "holds lidia, not penet"),
        (
            ["--prepare.depth", "penet", "--prepare.depth-weights", "penet.npz"],
            "64 x 100 pixels.* --prepare.image-crop 64 96",
        ),
    ],
)
def test_what_is_wrong_with_weights_is_said_before_a_folder_is_begun(tmp_path, weights, flags, said):
    flags = [str(weights / flag) if flag.endswith(".npz") else flag for flag in flags]
    crop = ["--prepare.image-crop", "64", "100", "--workers", "1"]
    with pytest.raises(SystemExit, match=said):
        main(["prepare", "synthetic", "--train", "0-1", "--out", str(tmp_path / "out"), *crop, *flags])
    assert not (tmp_path / "out" / NAME).exists()


def test_a_prepared_set_is_not_prepared_again(tmp_path):
    with pytest.raises(SystemExit) as stop:
        main(["prepare", "prepared", "--root", str(tmp_path), "--out", str(tmp_path)])
    assert "name the data set of its frames" in str(stop.value)


def test_help_shows_a_whole_way_from_frames_to_training(capsys):
    with pytest.raises(SystemExit):
        main(["prepare", "--help"])
    text = capsys.readouterr().out
    for part in (
        "jaxsim prepare kitti_step --data.root",
        "jaxsim prepare kitti_raw --data.root KITTI_RAW --train 0-3 --eval 4-5",
        "--data.kind prepared --data.root PAIRS",
        "goes on",
        "--beam",
    ):
        assert part in text


@pytest.mark.slow
def test_training_on_a_set_gives_the_losses_and_scores_of_training_on_its_frames(drives, tmp_path):
    data = DataConfig(kind="kitti_raw", root=drives)
    make_set(tmp_path / "set", data, PREPARE, train="0-8", evaluation="9-11", workers=2)
    small = ["--generator.filters=4", "--generator.blocks=1", "--generator.downsamples=1", "--generator.enhancers=0"]
    small += ["--discriminator.filters=4", "--discriminator.max-filters=8", "--discriminator.scales=1"]
    small += ["--discriminator.layers=1", "--optim.batch=2", "--optim.steps=2", "--run.log-every=1"]
    small += ["--prepare.network-size", "32", "64"]
    lines = []
    for name, source in (
        ("frames", ["--data.root", drives, "--data.train=0-8", "--data.validation=9-11"]),
        ("pairs", ["--data.kind=prepared", "--data.root", tmp_path / "set", "--data.train=train"]),
    ):
        source += ["--data.validation=eval"] if name == "pairs" else []
        said(tmp_path, ROOT / "train.py", "kitti_raw", *FLAGS, *source, *small, f"--run.name={name}")
        text = (tmp_path / "runs" / name / "metrics.jsonl").read_text()
        lines.append([json.loads(line) for line in text.splitlines()])
    assert lines[0] == lines[1]
    assert len(lines[0]) == 3
    output = said(tmp_path, ROOT / "eval.py", "runs/pairs")
    assert "3 frames of prepared" in output
    refused = said(tmp_path, "-m", "jaxsim", "simulate", "runs/pairs", "--out", "simulated", fails=True)
    assert f"--data kitti_raw --root {drives}" in refused
    said(tmp_path, "-m", "jaxsim", "simulate", "runs/pairs", "--out", "simulated",
         "--data", "kitti_raw", "--root", drives, "--frames", "9-11")  # fmt: skip


@pytest.mark.parametrize(
    ("words", "message"),
    [((), "no data set was named"), (("prepared",), "name the data set of its frames")],
)
def test_only_the_data_set_of_frames_can_be_prepared(tmp_path, words, message):
    with pytest.raises(SystemExit, match=message):
        main(["prepare", *words, "--out", str(tmp_path)])
