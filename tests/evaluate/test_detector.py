"""What a detector found, scored by KITTI's rules."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from jaxsim.config import DataConfig
from jaxsim.data.synthetic import SyntheticWorld
from jaxsim.detect.results import Detected, outlines
from jaxsim.detect.scenes import View
from jaxsim.detect.steps import Network
from jaxsim.evaluate.detector import experiment_scenes, find_all, kitti_curves, main_scores, mean_curves
from tests.detect.tiny import EXPERIMENT, RECT_FROM_VELO, scene

SCENES = [scene(seed) for seed in range(8)]


def scored(found, experiment=EXPERIMENT, scenes=SCENES):
    return main_scores(kitti_curves(scenes, found, experiment))


def the_labels(scenes=SCENES, shift=(0.0,) * 7):
    return [Detected(s.boxes + np.array(shift, np.float32), np.full(len(s.boxes), 0.6, np.float32)) for s in scenes]


def test_the_labels_themselves_score_100():
    scores = scored(the_labels())
    assert scores["AP_3d_moderate"].count == 48
    assert scores["AP_3d_moderate"].value == pytest.approx(100)
    assert scores["AP_bev_hard"].value == pytest.approx(100)


def test_boxes_that_are_off_score_less_and_nothing_found_scores_0():
    aside = scored(the_labels(shift=(0, 0, 0.4, 0, 0, 0, 0)))
    assert aside["AP_3d_moderate"].value == 0  # 0.4 m too high: less than 0.7 of the volume
    assert aside["AP_bev_moderate"].value == pytest.approx(100)
    nothing = [Detected(np.zeros((0, 7), np.float32), np.zeros(0, np.float32)) for _ in SCENES]
    assert scored(nothing)["AP_3d_moderate"].value == 0


def test_labels_outside_the_range_count_only_where_all_do():
    near = replace(EXPERIMENT.voxels, range_m=(0, -12.8, -3, 16.0, 12.8, 1))
    inside = [Detected(f.boxes[f.boxes[:, 0] <= 16], f.score[f.boxes[:, 0] <= 16]) for f in the_labels()]
    few = sum(len(f.score) for f in inside)
    assert few < 48
    everything = scored(inside, replace(EXPERIMENT, voxels=near, scored="all"))
    assert everything["AP_3d_moderate"].count == 48
    assert everything["AP_3d_moderate"].value < 80
    within = scored(inside, replace(EXPERIMENT, voxels=near, scored="inside"))
    assert within["AP_3d_moderate"].count == few


def test_a_car_that_is_found_outside_the_range_costs_nothing_in_any_metric():
    wide = View(np.array([[800.0, 0, 3000], [0, 800, 300], [0, 0, 1]]), RECT_FROM_VELO, RECT_FROM_VELO, (900, 6000))
    seen = [outlines(s.boxes.astype(np.float64), wide).astype(np.float32) for s in SCENES]
    scenes = [replace(s, view=wide, labels=replace(s.labels, bbox_px=px)) for s, px in zip(SCENES, seen, strict=True)]
    ahead_m = np.sort(np.concatenate([s.boxes[:, 0] for s in scenes]))
    nearer = replace(EXPERIMENT.voxels, range_m=(0, -12.8, -3, float(ahead_m[-2:].mean()), 12.8, 1))
    curves = kitti_curves(scenes, the_labels(scenes), replace(EXPERIMENT, voxels=nearer, scored="inside"))
    assert {c.metric for c in curves} == {"bbox", "bev", "3d", "aos"}
    assert {c.truths for c in curves} == {47}
    np.testing.assert_allclose([c.ap_r40 for c in curves], 100)


def test_a_scene_without_labels_is_refused():
    bare = replace(SCENES[0], labels=None)
    with pytest.raises(ValueError, match="000000 has no labels"):
        kitti_curves([bare], the_labels([bare]), EXPERIMENT)


def test_boxes_that_are_not_finite_are_told_by_the_scene_and_not_by_a_file_that_is_gone():
    found = the_labels()
    found[3].boxes[1, 2] = np.nan
    with pytest.raises(ValueError, match=r"^detect: 1 of \d+ detections in 000003 are not finite"):
        kitti_curves(SCENES, found, EXPERIMENT)
    labels = replace(SCENES[2].labels, size_m=np.full_like(SCENES[2].labels.size_m, np.inf))
    with pytest.raises(ValueError, match=r"^detect: 000002: kitti: object 0 \(Car\) .* must be finite"):
        kitti_curves([replace(SCENES[2], labels=labels)], the_labels([SCENES[2]]), EXPERIMENT)


def test_labels_are_scored_to_the_last_digit_of_what_they_say():
    """To two decimals 0.304 would be within the 0.30 of moderate, and the tree's own label files score otherwise."""
    cut = [replace(s, labels=replace(s.labels, truncated=np.full(len(s.boxes), 0.304, np.float32))) for s in SCENES]
    counts = {c.difficulty: c.truths for c in kitti_curves(cut, the_labels(), EXPERIMENT)}
    assert counts == {"easy": 0, "moderate": 0, "hard": 48}


def test_hidden_shares_count_as_the_levels_of_their_difficulty():
    shares = [replace(s, labels=replace(s.labels, occluded=np.full(len(s.boxes), 0.35, np.float32))) for s in SCENES]
    ones = [replace(s, labels=replace(s.labels, occluded=np.ones(len(s.boxes), np.int32))) for s in SCENES]
    of_shares, of_ones = (kitti_curves(scenes, the_labels(), EXPERIMENT) for scenes in (shares, ones))
    assert [c.truths for c in of_shares] == [c.truths for c in of_ones]
    np.testing.assert_array_equal([c.ap_r40 for c in of_shares], [c.ap_r40 for c in of_ones])
    counts = {c.difficulty: c.truths for c in of_shares if c.metric == "3d"}
    assert counts["easy"] == 0
    assert counts["moderate"] == 48


def test_the_mean_over_epochs_has_its_spread():
    curves = [kitti_curves(SCENES, the_labels(shift=(0, 0, dz, 0, 0, 0, 0)), EXPERIMENT) for dz in (0.0, 0.4)]
    mean, spread = mean_curves(curves)["3d", "0.7", "moderate"]
    assert (mean, spread) == (pytest.approx(50), pytest.approx(50))


def test_voxels_left_out_are_told(capsys):
    def find(network, points):
        return the_labels()[0], {"voxels": len(points)} if len(points) else {}

    clouds = [(name, np.zeros((n, 4), np.float32)) for name, n in (("a", 0), ("b", 70), ("c", 3))]
    assert [name for name, _ in find_all(find, Network({}, {}), clouds, total=3, quiet=True)] == ["a", "b", "c"]
    assert "2 of 3 clouds had more voxels" in (said := capsys.readouterr().out)
    assert "worst b: 70 of voxels left out; training makes room with --voxels.max-voxels" in said
    list(find_all(find, Network({}, {}), clouds, total=3, quiet=True, more_room="raise --max-voxels"))
    assert "left out; raise --max-voxels\n" in capsys.readouterr().out


@cache
def rendered():
    """A frame of the embedded world."""
    return SyntheticWorld(columns=200, image_size=(94, 311))[0]


class TwoFrames:
    """A frame twice, the second time without labels."""

    def __getitem__(self, i):
        return replace(rendered(), boxes=None) if i else rendered()

    def name_of(self, i):
        return str(i)


@pytest.mark.long
def test_frames_without_labels_are_left_out_and_told(tmp_path, capsys):
    experiment = replace(EXPERIMENT, data=DataConfig(cache=tmp_path))
    assert len(experiment_scenes(TwoFrames(), [0, 1], experiment)) == 1
    assert "1 of 2 frames have no labels and are left out" in capsys.readouterr().out
    with pytest.raises(ValueError, match="none of the 1 frames has labels"):
        experiment_scenes(TwoFrames(), [1], experiment)
