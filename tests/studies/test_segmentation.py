"""The worth of intensity, in a world whose classes differ in nothing else."""

import json

import numpy as np
import pytest

from jaxsim.cli.real2sim2real import run
from jaxsim.config import GeneratorConfig, SegmentationConfig
from jaxsim.data.range_images import read_range_images
from jaxsim.studies.segmentation import KINDS, Study, class_iou, confusion, run_segmentation, worth

NETWORK = GeneratorConfig(form="unet", filters=4, downsamples=0, enhancers=0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Six images of a flat wall painted in blocks of two classes: 1 reports 0.2, 2 reports 0.8."""
    folder, random = tmp_path_factory.mktemp("images"), np.random.default_rng(0)
    for k in range(6):
        cells = np.full((4, 16, 6), 5.0, np.float32)
        label = random.integers(1, 3, (4, 8)).repeat(2, 1)
        cells[..., 3] = np.where(label == 1, 0.2, 0.8) + random.normal(0, 0.02, label.shape)
        cells[..., 5] = label
        cells[0, 0, 3:] = 0
        np.savez(folder / f"{k:02d}.npz", scan=cells)
    return folder


@pytest.fixture(scope="module")
def study(folder, tmp_path_factory):
    """Part 0 judged, by each kind."""
    config = SegmentationConfig(
        root=folder,
        network=NETWORK,
        steps=40,
        sensor_steps=80,
        batch=4,
        columns=8,
        lr=3e-2,
        out=tmp_path_factory.mktemp("out"),
    )
    study = Study(config, read_range_images(folder))
    for kind in KINDS:
        study.score(kind, 0, 0)
    return study


def of(study, kind):
    return class_iou(np.array(json.loads(study.path(kind, 0, 0).read_text())["confusion"]))


def test_measured_intensity_tells_what_shape_does_not(study):
    assert of(study, "measured").min() > 0.9
    assert np.nanmean(of(study, "none")) < 0.7


def test_simulated_intensity_of_a_sensor_that_saw_other_parts_is_worth_most_of_it(study):
    assert of(study, "simulated").min() > 0.9
    made = np.stack(study.simulated(1, 0))
    truth = np.stack([study.images[i].intensity for i in study.own(1)])
    valid = truth > 0
    assert np.abs(made - truth)[valid].mean() < 0.1
    assert not made[~valid].any()


def test_a_sensor_learns_from_neither_the_part_it_simulates_nor_the_judged_one(study):
    assert study.others(1, 0) == [4, 5]
    assert {*study.intensities("simulated", 0)} == {2, 3, 4, 5}
    assert study.own(0) == [0, 1]


def test_what_is_scored_is_not_scored_again(study, monkeypatch):
    monkeypatch.setattr("jaxsim.studies.segmentation.train", lambda *_, **__: pytest.fail("trained again"))
    for kind in KINDS:
        study.score(kind, 0, 0)


def test_confusions_and_iou_equal_their_definition():
    random = np.random.default_rng(0)
    label, told = random.integers(0, 4, (2, 5, 7))
    told = np.maximum(told, 1)
    found = class_iou(confusion(label, told, 5))
    for k in (1, 2, 3):
        true, guess = label == k, (told == k) & (label > 0)
        assert found[k - 1] == pytest.approx((true & guess).sum() / (true | guess).sum())
    assert np.isnan(found[3])


def test_the_worth_is_the_share_of_the_gain():
    rows = {"none": [[0.2, 0.4]], "simulated": [[0.5, 0.5]], "measured": [[0.6, 0.6]]}
    assert worth({k: np.array(x) for k, x in rows.items()}) == pytest.approx(2 / 3)
    assert np.isnan(worth({k: np.array(rows["none"]) for k in KINDS}))


def test_tables_come_from_the_scores_of_all_parts(folder, tmp_path):
    """Without a training: scores that are there are taken."""
    out = tmp_path / "out"
    flags = ["--task", "segmentation", "--root", str(folder), "--out", str(out), "--seeds", "0", "1"]
    values = {"none": [[0, 0, 0], [0, 5, 5], [0, 5, 5]], "simulated": [[0, 0, 0], [0, 8, 2], [0, 2, 8]]}
    values["measured"] = [[0, 0, 0], [0, 10, 0], [0, 0, 10]]
    (out / "scores").mkdir(parents=True)
    for kind, cells in values.items():
        for name in (f"{kind}_part{part}_seed{seed}.json" for part in range(3) for seed in (0, 1)):
            (out / "scores" / name).write_text(json.dumps({"confusion": cells}))
    run(flags)
    text = (out / "segmentation.md").read_text()
    assert "| 0.333 ± 0.000 | 0.667 ± 0.000 | 1.000 ± 0.000 |" in text
    assert "worth +0.667 of mean IoU; simulated intensity 50 % of that" in text
    assert json.loads((out / "segmentation.json").read_text())["worth"] == pytest.approx(0.5)
    with pytest.raises(ValueError, match="steps"):
        run([*flags, "--steps", "5"])


def test_wrong_settings_are_told(folder, tmp_path):
    for words, change in (
        ("name the folder", {"root": None}),
        ("give some, and each once", {"seeds": (1, 1)}),
        ("both networks are a unet", {"network": GeneratorConfig()}),
        ("6 images in 2 parts", {"parts": 2}),
        ("6 images in 7 parts", {"parts": 7}),
    ):
        with pytest.raises(ValueError, match=words):
            run_segmentation(SegmentationConfig(**({"root": folder, "out": tmp_path} | change)))
    with pytest.raises(ValueError, match="no task 'depth'"):
        run(["--task", "depth"])
