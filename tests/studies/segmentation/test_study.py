"""The worth of intensity, in a world whose classes differ in nothing else."""

import json

import numpy as np
import pytest

from jaxsim.config import GeneratorConfig, SegmentationConfig
from jaxsim.data.logs.range_images import read_range_images
from jaxsim.studies.segmentation.study import INTENSITIES, Study, class_iou, confusion, mean_iou, worth


def of(study, kind):
    return class_iou(np.array(json.loads(study.path(kind, 0, 0).read_text())["confusion"]))


@pytest.mark.long
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
    monkeypatch.setattr(
        "jaxsim.studies.segmentation.networks.train_network", lambda *_, **__: pytest.fail("trained again")
    )
    for kind in INTENSITIES:
        study.score(kind, 0, 0)


def test_streets_elsewhere_are_judged_by_what_learned_from_all_parts(folder, tmp_path):
    network = GeneratorConfig(form="unet", filters=4, downsamples=0, enhancers=0)
    config = SegmentationConfig(root=folder, judged=folder, network=network, parts=2, steps=1, columns=8, out=tmp_path)
    study = Study(config, read_range_images(folder)[:4], judged=read_range_images(folder)[4:])
    assert study.rounds == (None,)
    assert study.others(1, None) == [0, 1]
    assert {*study.intensities("measured", None)} == {0, 1, 2, 3}
    study.score("measured", None, 0)
    cells = np.array(json.loads(study.path("measured", None, 0).read_text())["confusion"])
    assert cells.sum() == sum((image.label > 0).sum() for image in study.judged)


def test_confusions_and_iou_equal_their_definition():
    random = np.random.default_rng(0)
    label, told = random.integers(0, 4, (2, 5, 7))
    told = np.maximum(told, 1)
    found = class_iou(confusion(label, told, 5))
    for k in (1, 2, 3):
        true, guess = label == k, (told == k) & (label > 0)
        assert found[k - 1] == pytest.approx((true & guess).sum() / (true | guess).sum())
    assert np.isnan(found[3])


def test_a_class_that_is_not_there_is_not_averaged_whoever_is_told_to_be_one():
    right = np.diag([0, 10, 10, 0])
    slip = right - np.diag([0, 0, 1, 0])
    slip[2, 3] = 1
    assert mean_iou(class_iou(right)[None]) == 1
    assert mean_iou(class_iou(slip)[None]) == pytest.approx((1 + 9 / 10) / 2)


def test_the_worth_is_the_share_of_the_gain():
    rows = {"none": [[0.2, 0.4]] * 2, "simulated": [[0.5, 0.5]] * 2, "measured": [[0.6, 0.6]] * 2}
    assert worth({k: np.array(x) for k, x in rows.items()}) == pytest.approx(2 / 3)
    # Of one seed nobody knows how far it scatters.
    assert np.isnan(worth({k: np.array(x[:1]) for k, x in rows.items()}))
    assert np.isnan(worth({k: np.array(rows["none"]) for k in INTENSITIES}))
    # A gain that is printed as 0, or less than seeds scatter, has no shares.
    slight = {"none": [[0.2, 0.4]] * 2, "simulated": [[0.2, 0.4]] * 2, "measured": [[0.2004, 0.4004]] * 2}
    assert np.isnan(worth({k: np.array(x) for k, x in slight.items()}))
    by_seed = {"none": [[0.2], [0.2]], "simulated": [[0.21], [0.21]], "measured": [[0.2], [0.24]]}
    assert np.isnan(worth({k: np.array(x) for k, x in by_seed.items()}))
