"""The loop's clouds of Virtual KITTI 2 beside KITTI's, on trees generated in their formats."""

import json
from dataclasses import replace

import numpy as np
import pytest

from jaxsim.data import KittiObject
from jaxsim.studies.real2sim2real import claim_loop
from jaxsim.studies.real2sim2real.stages import Stages, check_sources
from jaxsim.train.experiments import load_loop


@pytest.mark.long
def test_trees_of_virtual_kitti_are_made_and_compared_with_kitti_before_any_training(virtual, object_root, tmp_path):
    config, _ = load_loop("real2sim2real_kitti")
    real = replace(config.detector.data, root=object_root, train="0", validation="0", cache=tmp_path / "cache")
    synthetic = replace(
        config.synthetic, root=virtual.root, scenes=("Scene01",), train="0", validation="1", cache=tmp_path / "cache"
    )
    config = replace(
        config,
        intensity=replace(config.intensity, data=real),
        detector=replace(config.detector, data=real),
        synthetic=synthetic,
        kinds=("raw_64", "raw_32"),
        out=tmp_path / "loop",
    )
    check_sources(config)
    loop = claim_loop(config)
    stages = Stages(loop, discover=lambda loop: None)
    stages.export(loop)
    for kind in config.kinds:
        tree = KittiObject(loop.tree(kind), rows="elevation")
        assert len(tree) == 2
        assert (np.asarray(tree[0].boxes.occluded) >= 1).all()  # nothing is easy, as in the paper
    stages.checks()
    cars = json.loads((loop.out / "clouds.json").read_text())["classes"]["Car"]
    assert list(cars) == ["real", "raw_64", "raw_32"]
    assert cars["real"]["objects"] == 1
    assert cars["real"]["points_45_80"] == 0  # the car is 58 m away, behind the wall of the round room
    assert cars["raw_64"]["points"] > 1.5 * cars["raw_32"]["points"] > 1000
    made = {path: path.stat().st_mtime_ns for path in loop.out.rglob("*") if path.is_file()}
    again = Stages(claim_loop(config), discover=lambda loop: None)
    again.export(loop)
    again.checks()
    later = {path: path.stat().st_mtime_ns for path in loop.out.rglob("*") if path.is_file()}
    told = {"loop.json", "export.json", "train.txt", "val.txt", "trainval.txt"}  # small ones, written anew
    assert set(made) == set(later)
    assert {path.name for path in made if made[path] != later[path]} <= told
