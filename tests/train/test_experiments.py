"""Experiments by name and by file, and the values of those of configs/."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from pydantic import TypeAdapter

from jaxsim.cli.train import parse_experiment
from jaxsim.runs.kinds import kind_of
from jaxsim.train.experiments import experiment_names, load_experiment, read_experiment


@pytest.mark.parametrize("name", ["rgb", "semantic", "edges", "depth"])
def test_the_papers_experiments_differ_in_their_inputs_alone(name):
    combined, _ = load_experiment("kitti_step_combined")
    experiment, _ = load_experiment(f"kitti_step_{name}")
    assert experiment.prepare.inputs == (name,)
    assert set(experiment.prepare.inputs) < set(combined.prepare.inputs)
    assert replace(experiment, prepare=combined.prepare) == combined
    assert replace(experiment.prepare, inputs=combined.prepare.inputs) == combined.prepare


def test_the_papers_settings_are_those_of_imaginaires_configuration():
    experiment, _ = load_experiment("kitti_step_combined")
    generator, optim, loss = experiment.generator, experiment.optim, experiment.loss
    assert (generator.form, generator.filters, generator.downsamples, generator.blocks) == ("imaginaire", 64, 4, 9)
    assert (generator.enhancers, generator.enhancer_blocks) == (1, 3)
    assert (optim.epochs, optim.batch, optim.lr, optim.betas, optim.eps) == (20, 8, 2e-4, (0.5, 0.999), 1e-8)
    assert (optim.ema_decay, optim.ema_start, optim.flip, optim.scale_limit) == (0.999, 500, False, 0.2)
    assert (loss.gan, loss.feature_matching, loss.perceptual, loss.reconstruction) == (1, 10, 10, 0)
    assert optim.decay_from == 1  # constant: the published rate falls after 100 epochs
    assert experiment.prepare.network_size == (64, 512)
    assert (experiment.prepare.denoise, experiment.prepare.denoise_weights) == ("lidia", None)


def test_the_published_detector_is_openpcdets_configuration():
    """The numbers of `voxel_rcnn_car.yaml` and of the KITTI data set it builds on."""
    experiment, _ = load_experiment("voxel_rcnn_car")
    voxels, network, optim, augment = experiment.voxels, experiment.detector, experiment.optim, experiment.augment
    assert voxels.range_m == (0, -40, -3, 70.4, 40, 1)
    assert (voxels.size_m, voxels.points_per_voxel) == ((0.05, 0.05, 0.1), 5)
    assert (voxels.max_voxels_train, voxels.max_voxels, experiment.in_image) == (16000, 40000, True)
    backbone = network.backbone
    assert (backbone.widths, backbone.out) == ((16, 32, 64, 64), 128)
    assert (backbone.bev_layers, backbone.bev_strides, backbone.bev_widths) == ((5, 5), (1, 2), (64, 128))
    assert (backbone.up_strides, backbone.up_widths) == ((1, 2), (128, 128))
    anchors = network.anchors
    assert (anchors.kind, anchors.size_m, anchors.bottom_m) == ("Car", (3.9, 1.6, 1.56), -1.78)
    assert (anchors.yaws_rad, anchors.matched, anchors.unmatched) == ((0, 1.57), 0.6, 0.45)
    nms = [(p.before, p.overlap, p.after) for p in (network.train_proposals, network.proposals, network.final)]
    assert nms == [(9000, 0.8, 512), (2048, 0.7, 100), (4096, 0.1, 500)]
    roi = network.roi
    assert (roi.grid, roi.radii_m, roi.reach, roi.samples, roi.width) == (6, (0.4, 0.8, 1.6), 4, 16, 32)
    assert (roi.layers, roi.dropout, roi.rois, roi.foreground) == ((256, 256), 0.3, 128, 0.5)
    assert (roi.matched, roi.score_range, roi.easy, roi.hard_share) == (0.55, (0.25, 0.75), 0.1, 0.8)
    assert (network.cls_weight, network.loc_weight, network.dir_weight, network.score) == (1, 2, 0.2, 0.3)
    assert (network.roi_cls_weight, network.roi_reg_weight, network.roi_corner_weight) == (1, 1, 1)
    assert (augment.sampled, augment.min_points, augment.flip) == (15, 5, 0.5)
    assert (augment.rotation_rad, augment.scaling) == (0.78539816, (0.95, 1.05))
    assert (optim.lr, optim.div_factor, optim.pct_start, optim.momenta) == (0.01, 10, 0.4, (0.95, 0.85))
    assert (optim.weight_decay, optim.clip, optim.batch, optim.epochs) == (0.01, 10, 2, 80)


def test_a_file_of_ones_own_is_an_experiment_and_may_build_on_those_of_configs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("mine.py").write_text(
        '"""Mine.\n\nLong."""\nfrom dataclasses import replace\nfrom configs.synthetic import experiment as base\n'
        "experiment = replace(base, optim=replace(base.optim, lr=0.5))\n"
    )
    experiment, words = load_experiment("mine.py")
    assert (experiment.optim.lr, words) == (0.5, "Mine.\n\nLong.")
    parsed, _ = parse_experiment(["mine.py", "--optim.steps", "3"])
    assert (parsed.optim.steps, parsed.optim.lr) == (3, 0.5)
    Path("nothing.py").write_text("answer = 42\n")
    with pytest.raises(ValueError, match=r"nothing\.py holds no experiment; write `experiment = \.\.\.`"):
        load_experiment("nothing.py")
    with pytest.raises(ValueError, match=r"no file none\.py; give one like .*synthetic\.py"):
        load_experiment("none.py")


def test_every_experiment_of_configs_has_its_words():
    assert {"synthetic", "demo", "penet_synthetic", "voxel_rcnn_small"} < {*experiment_names()}
    assert not {*experiment_names()} & {*experiment_names("loop")}
    for name in experiment_names():
        experiment, words = load_experiment(name)
        assert words
        assert kind_of(experiment)


def test_the_settings_of_a_depth_run_are_read_as_such(tmp_path):
    experiment, _ = load_experiment("penet_synthetic")
    path = tmp_path / "config.json"
    path.write_bytes(TypeAdapter(type(experiment)).dump_json(experiment))
    assert read_experiment(path) == experiment
    assert load_experiment(str(path)) == (experiment, f"Settings of {path}.")


def test_a_file_that_is_no_run_is_explained(tmp_path):
    path = tmp_path / "config.json"
    path.write_text(json.dumps({"experiment": {"generator": {}, "optim": {"lr": "fast"}}}))
    with pytest.raises(ValueError, match=r"is not the config\.json of a run of this version"):
        read_experiment(path)
    with pytest.raises(ValueError, match=r"no file .*none\.json"):
        read_experiment(tmp_path / "none.json")
