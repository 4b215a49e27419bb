"""`python eval.py ablation`, on runs that never trained."""

import json
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import pytest

from jaxsim.cli.ablation import Ablation, ablation
from jaxsim.metrics import Score
from jaxsim.metrics.frechet import FrechetScore
from jaxsim.studies.ablation.page import ablation_table, best_networks
from jaxsim.studies.ablation.stages import train_all
from jaxsim.studies.ablation.table import MODALITIES, AblationRow, besides, modality
from jaxsim.train.experiments import load_experiment
from tests.untrained import untrained_run

INPUTS = (("depth", "row"), ("semantic", "row", "rgb", "edges", "depth"))


def experiment(inputs, **data):
    base, _ = load_experiment("ablation")
    return replace(
        base,
        data=replace(base.data, train="0-1", validation="2-4", **data),
        prepare=replace(base.prepare, inputs=inputs, columns=64, network_size=(64, 128)),
        generator=replace(base.generator, filters=4, blocks=1, downsamples=2, enhancer_blocks=1),
    )


@pytest.fixture(scope="module")
def work(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("ablation")


@pytest.fixture(scope="module")
def runs(work) -> tuple[Path, ...]:
    cache = work / "cache"
    return tuple(
        untrained_run(work / f"run{k}", experiment(inputs, cache=cache), seed=k) for k, inputs in enumerate(INPUTS)
    )


def row(name: str, mae: float, psnr: float, distance: float) -> AblationRow:
    scores = {"mae": Score(mae, "1", 10), "psnr": Score(psnr, "dB", 10)}
    return AblationRow(name, MODALITIES[name], scores, FrechetScore("frechet_random_64", distance, None, (80, 80), 64))


def test_networks_have_the_papers_names_whatever_the_order_of_their_inputs():
    assert modality(("edges", "semantic", "rgb", "depth")) == "combined"
    assert modality(("rgb", "depth", "row")) == "rgb+depth"
    assert modality(("incidence", "row")) == "none"
    assert besides(("row", "rgb", "incidence")) == ("row", "incidence")


def test_the_table_holds_the_papers_fid_beside_ours_and_marks_the_best():
    rows = [row("rgb", 0.3, 20.0, 5.0), row("combined", 0.2, 20.0, 7.0)]
    assert best_networks(rows) == {"mae": "combined", "psnr": "", "frechet": "rgb"}
    lines = ablation_table(rows, {"global mean": rows[0].scores}).splitlines()
    assert lines[0] == "| inputs | FID in the paper | frechet_random_64 | mae | psnr (dB) |"
    assert lines[2:] == [
        "| rgb | 89.44 | **5.00** | 0.3000 | 20.00 |",
        "| combined | 73.81 | 7.00 | **0.2000** | 20.00 |",
        "| global mean | - | - | 0.3000 | 20.00 |",
    ]


def test_runs_come_into_one_table_with_pictures_and_a_page(runs, work, capsys):
    out = work / "out"
    ablation(Ablation(runs=runs, out=out, pictures=2))
    printed = capsys.readouterr().out
    written = json.loads((out / "ablation.json").read_text())
    assert [r["name"] for r in written["rows"]] == ["depth", "combined"]
    assert [r["paper_fid"] for r in written["rows"]] == [81.43, 73.81]
    assert set(written["baselines"]) == {"global mean", "per-class mean", "per-row mean"}
    assert written["about"]["judged frames"] == "3"
    assert written["about"]["every network also sees"] == "row"
    for line in (out / "ablation.md").read_text().splitlines():
        if line.startswith("|"):
            assert line in printed
    pictures = sorted((out / "pictures").glob("*.png"))
    assert len(pictures) == 2
    assert all(cv2.imread(str(path)).std() > 5 for path in pictures)
    page = (out / "ablation.html").read_text()
    assert page.count("data:image/png;base64,") == 2
    assert "<script" not in page


def test_runs_that_differ_in_more_than_their_inputs_are_refused(runs, work):
    other = untrained_run(
        work / "other", replace(experiment(("rgb", "row")), loss=replace(experiment(("rgb",)).loss, gan=3.0))
    )
    with pytest.raises(ValueError, match=r"differ in more than their inputs: loss\.gan is 3\.0 and 1\.0"):
        ablation(Ablation(runs=(runs[0], other), out=work / "no"))
    plain = untrained_run(work / "plain", experiment(("rgb",)))
    with pytest.raises(ValueError, match=r"prepare\.inputs is \(\) and \('row',\)"):
        ablation(Ablation(runs=(runs[0], plain), out=work / "no"))
    twin = untrained_run(work / "twin", experiment(("row", "depth"), cache=work / "elsewhere"))
    with pytest.raises(ValueError, match="two runs have the inputs depth"):
        ablation(Ablation(runs=(runs[0], twin), out=work / "no"))
    assert not (work / "no").exists()


@pytest.mark.parametrize(
    ("args", "flags", "message"),
    [
        (Ablation(), (), "either --runs FOLDER"),
        (Ablation(runs=(Path("a"),), train="ablation"), (), "either --runs FOLDER"),
        (Ablation(runs=(Path("a"),)), ("--optim.steps", "3"), "give --train EXPERIMENT"),
        (Ablation(runs=(Path("nowhere"),)), (), "no config.json in nowhere"),
        (Ablation(runs=(Path("a"),), fid="nowhere.npz"), (), "nowhere.npz"),
    ],
)
def test_wrong_arguments_say_what_is_right(args, flags, message):
    with pytest.raises((ValueError, FileNotFoundError), match=message):
        ablation(args, flags=flags)


def test_too_few_frames_for_the_distance_are_refused_before_anything_is_scored(runs, work):
    args = Ablation(runs=runs, out=work / "few", fid="random", fid_features=64)
    with pytest.raises(ValueError, match="3 frames to judge, 64 features"):
        ablation(args)


def test_every_network_is_trained_in_its_own_process_and_a_failure_ends_the_command(tmp_path):
    script = tmp_path / "train.py"
    script.write_text(
        "import sys, pathlib\n"
        f"log = pathlib.Path({str(tmp_path / 'log')!r})\n"
        "log.open('a').write(' '.join(sys.argv[1:]) + '\\n')\n"
        "sys.exit(3 if '--run.name edges' in ' '.join(sys.argv) and '--stop' in sys.argv else 0)\n"
    )
    trainer = (sys.executable, str(script))
    runs = train_all("ablation", tmp_path / "out", ["--optim.steps", "5"], more=("row",), trainer=trainer)
    assert [run.name for run in runs] == list(MODALITIES)
    lines = (tmp_path / "log").read_text().splitlines()
    assert lines[0] == (
        "ablation --optim.steps 5 --prepare.inputs rgb depth semantic edges row --run.name combined "
        f"--run.out {tmp_path / 'out'}"
    )
    with pytest.raises(SystemExit, match="training edges ended with status 3"):
        train_all("ablation", tmp_path / "out", ["--stop"], trainer=trainer)
