"""`python eval.py ablation`, on runs that never trained."""

import json
from dataclasses import replace
from pathlib import Path

import cv2
import pytest

from jaxsim.cli.ablation import Ablation, ablation
from jaxsim.train.experiments import load_experiment
from tests.untrained import untrained_run

pytestmark = pytest.mark.long

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


def test_runs_come_into_one_table_with_pictures_and_a_page(runs, work, capsys):
    out = work / "out"
    ablation(Ablation(runs=runs, out=out, pictures=2))
    printed = capsys.readouterr().out
    written = json.loads((out / "ablation.json").read_text())
    assert [r["name"] for r in written["rows"]] == ["depth", "combined"]
    assert [r["paper_fid"] for r in written["rows"]] == [81.43, 73.81]
    of_groups = {f"{group} {what}" for group in ("global", "per-row") for what in ("mean", "median")}
    assert set(written["baselines"]) == {*of_groups, "per-class mean", "range, incidence, row"}
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
        (Ablation(train="penet_synthetic"), (), "penet_synthetic trains a depth completion network"),
        (Ablation(runs=(Path("nowhere"),)), (), "no config.json in nowhere"),
        (Ablation(runs=(Path("a"),), fid="nowhere.npz"), (), "nowhere.npz"),
        # Before any of five networks is trained.
        (
            Ablation(train="ablation", fid="random", fid_features=64),
            ("--data.validation", "1920-1922:2"),
            "2 frames to judge, 64 features",
        ),
    ],
)
def test_wrong_arguments_say_what_is_right(args, flags, message):
    with pytest.raises((ValueError, FileNotFoundError), match=message):
        ablation(args, flags=flags)


def test_too_few_frames_for_the_distance_are_refused_before_anything_is_scored(runs, work):
    args = Ablation(runs=runs, out=work / "few", fid="random", fid_features=64)
    with pytest.raises(ValueError, match="3 frames to judge, 64 features"):
        ablation(args)
