"""`jaxsim export --data vkitti2`, read back by an independent reader's rules."""

from dataclasses import replace
from pathlib import Path

import jax
import numpy as np
import pytest

from jaxsim.cli.export import Export
from jaxsim.cli.flags import DataSource
from jaxsim.config import CloudRecipe
from jaxsim.data import KittiObject
from jaxsim.data.vkitti2 import VirtualKitti2
from jaxsim.detect.scenes import scene_of_frame
from jaxsim.effects.chain import SensorModel
from jaxsim.export.clouds import make_cloud
from jaxsim.geometry.points import FAR_M
from jaxsim.metrics.detection import DIFFICULTIES, read_truth
from jaxsim.metrics.detection.matching import truth_flags
from jaxsim.simulate.learned_sensor import LearnedSensor, load
from tests.cloud import openpcdet_rules as rules


@pytest.fixture(scope="module")
def export(virtual, tmp_path_factory):
    def export(**settings) -> Path:
        out = tmp_path_factory.mktemp("tree")
        data = DataSource("vkitti2", root=virtual.root, scenes=("Scene01",), lidar=settings.pop("lidar", None))
        Export(out=out, data=data, frames="0-1", **settings)()
        return out

    return export


@pytest.fixture(scope="module")
def tree(export) -> Path:
    return export()


@pytest.fixture(scope="module")
def sensor(step_run) -> LearnedSensor:
    return load(step_run)


def test_an_independent_reader_finds_vehicles_where_the_points_are(tree):
    frames = rules.accept(tree)
    assert list(frames) == ["000000", "000001"]
    held = 0
    for frame in frames.values():
        assert frame["in_image"].mean() > 0.99
        assert (frame["points"][:, 3] == 0).all()
        for box, thing in zip(frame["boxes"], frame["objects"], strict=True):
            inside = rules.points_in(box, frame["points"])
            if thing["occluded"] == 0 and thing["truncated"] < 0.1 and box[0] < 40:
                assert inside.sum() > 20, thing
                held += 1
                # The points on it are on its surface that faces the sensor: the box is no larger than the object.
                around = rules.points_in(box, frame["points"], grown_m=0.3) & (frame["points"][:, 2] > box[2])
                assert (inside & around).sum() > 0.8 * around.sum()
    assert held >= 2


def test_levels_are_kittis_or_none_is_visible_or_the_papers_fraction(export, tree, virtual, capsys):
    things = [t for t in VirtualKitti2(virtual.root, scenes=("Scene01",)).objects(0) if t.pixels]
    things = [t for t in things if np.linalg.norm(t.centre_m) <= 80]

    def column(out):
        return [line.split()[2] for line in (out / "training/label_2/000000.txt").read_text().splitlines()]

    levels = [0 if t.occupancy >= 0.5 else 1 if t.occupancy >= 0.25 else 2 for t in things]
    assert column(tree) == [str(level) for level in levels]
    assert column(export(occlusion="never_visible")) == [str(level + 1) for level in levels]
    assert "warning" not in capsys.readouterr().err
    paper = export(occlusion="paper")
    assert "official evaluation reads an integer" in (said := capsys.readouterr().err)
    assert "--occlusion never_visible" in said
    hidden = np.float32([1 - t.occupancy for t in things])
    assert [float(v) for v in column(paper)] == pytest.approx(hidden, abs=1e-6)
    # Our own reader gives the fractions back to the last bit, beside boxes that are those of any other occlusion.
    frame, plain = KittiObject(paper, rows="elevation")[0], KittiObject(tree, rows="elevation")[0]
    assert frame.boxes.occluded.dtype == np.float32
    assert (frame.boxes.occluded == hidden).all()
    for name in ("centre_m", "size_m", "yaw_rad", "bbox_px", "truncated", "kind"):
        assert np.array_equal(getattr(frame.boxes, name), getattr(plain.boxes, name)), name
    # A detector trains on such a scene: nothing in it is easy, and what is large enough in the image is moderate.
    difficulty = scene_of_frame(frame, "Car", in_image=True).difficulty
    assert set(difficulty.tolist()) <= {-1, 1, 2}
    assert 1 in difficulty
    # No object is wholly visible, none unseen: whatever its height, none is easy, and none is beyond moderate.
    assert all(0 < float(v) <= 1 for v in column(paper))
    truth = read_truth(paper / "training/label_2", ["000000", "000001"])
    assert not (truth_flags(truth, "Car", DIFFICULTIES["easy"], rules="openpcdet") == 0).any()


def test_fewer_lines_have_fewer_points_and_both_readings_of_32_are_there(virtual):
    frame = VirtualKitti2(virtual.root, scenes=("Scene01",))[0]
    counts = {}
    for lines in ("none", "64", "32_of_64", "32_wide", "hdl64e", "vlp16"):
        counts[lines] = int(make_cloud(frame, CloudRecipe(lines=lines)).valid.sum())
    assert counts["none"] > 100_000 > 40_000 > counts["64"] > counts["32_wide"] > counts["32_of_64"]
    assert counts["32_of_64"] == pytest.approx(counts["64"] / 2, rel=0.1)
    four = make_cloud(frame, CloudRecipe(beams=(9, 13, 17, 21)))
    assert set(four.row[four.valid].tolist()) == {9, 13, 17, 21}


def test_pixels_at_the_horizon_are_no_points(virtual):
    frame = VirtualKitti2(virtual.root, scenes=("Scene01",))[0]
    depth_m = np.asarray(frame.camera.depth_m).copy()
    depth_m[:100] = 1.02 * FAR_M
    far = replace(frame, camera=replace(frame.camera, depth_m=depth_m, depth_valid=np.ones(depth_m.shape, bool)))
    cloud = make_cloud(far, CloudRecipe(lines="none", max_high_m=1e6))
    assert np.abs(cloud.xyz_m[cloud.valid]).max() <= FAR_M
    assert 0 < cloud.valid.sum() < cloud.valid.size


@pytest.mark.parametrize("lidar", ["kitti", "camera"])
def test_clouds_of_a_trained_sensor_carry_its_intensity_in_all_placements(virtual, sensor, lidar):
    frame = VirtualKitti2(virtual.root, scenes=("Scene01",), lidar=lidar)[0]
    recipe = CloudRecipe(source="simulated", lines="none")
    dropped = make_cloud(frame, recipe, sensor)
    intensity = sensor.intensity_map(frame.camera).ravel()
    assert (dropped.intensity == intensity).all()
    assert (intensity[dropped.valid] > 0).all()
    assert 0 < dropped.valid.sum() < dropped.valid.size
    kept = make_cloud(frame, replace(recipe, keep_zero=True), sensor)
    assert kept.valid.sum() > dropped.valid.sum()
    assert 0 in kept.intensity[kept.valid]
    if lidar == "kitti":
        grid = make_cloud(frame, replace(recipe, projection="grid", lines=""), sensor)
        window, _ = sensor.window
        assert grid.valid.size == len(window.elevation_rad) * len(window.azimuth_rad)
        assert (grid.intensity[grid.valid] > 0).all()
        whole = make_cloud(frame, replace(recipe, projection="grid", lines="", keep_zero=True), sensor)
        assert whole.valid[grid.valid].all()
        middle = np.arange(frame.camera.depth_m.shape[1]) < 600
        depth_m = np.where(middle, np.float32(2 * FAR_M), np.float32(10))
        far = replace(frame.camera, depth_m=np.broadcast_to(depth_m, frame.camera.depth_m.shape))
        far = replace(frame, camera=replace(far, depth_valid=np.ones_like(far.depth_valid)))
        beyond = make_cloud(far, replace(recipe, projection="grid", lines="", keep_zero=True), sensor)
        assert 0 < beyond.valid.sum() < beyond.valid.size / 2 + 500
        assert np.linalg.norm(beyond.xyz_m[beyond.valid], axis=-1).max() < 50


def test_effects_act_on_the_rays_of_the_sensors_grid(virtual, sensor):
    frame = VirtualKitti2(virtual.root, scenes=("Scene01",))[0]
    recipe = CloudRecipe(source="simulated", projection="grid")
    plain = make_cloud(frame, recipe, sensor)
    lossy = SensorModel((("random_dropout", {"probability": 0.4}),))
    first, again, other = (
        make_cloud(frame, recipe, sensor, effects_model=lossy, key=jax.random.key(seed)) for seed in (3, 3, 4)
    )
    assert first.valid.sum() == pytest.approx(0.6 * plain.valid.sum(), rel=0.05)
    assert not first.valid[~plain.valid].any()
    np.testing.assert_array_equal(first.valid, again.valid)
    assert (first.valid != other.valid).any()
    np.testing.assert_allclose(first.xyz_m[first.valid], plain.xyz_m[first.valid], atol=1e-3)


def test_effects_that_drift_count_from_the_first_frame_or_from_the_frame_itself(virtual, sensor, monkeypatch):
    frame = replace(VirtualKitti2(virtual.root, scenes=("Scene01",))[0], time_s=1.3e9 + 60)
    recipe = CloudRecipe(source="simulated", projection="grid")
    seen = []
    monkeypatch.setattr(
        "jaxsim.export.clouds.with_effects", lambda model, image, *of, time_s, **how: (seen.append(time_s), image)[1]
    )
    for first_s in (1.3e9, None):
        make_cloud(frame, recipe, sensor, effects_model=SensorModel(), first_s=first_s)
    assert seen == [60, 0]


@pytest.mark.parametrize("lidar", ["kitti", "camera"])
def test_the_command_writes_a_trained_sensors_clouds(export, step_run, sensor, tree, monkeypatch, lidar):
    monkeypatch.setattr("jaxsim.cli.export.load", lambda folder: sensor)  # compiled already
    out = export(recipe=CloudRecipe(source="simulated"), run=step_run, lidar=lidar)
    simulated = rules.accept(out)
    plain = rules.accept(tree if lidar == "kitti" else export(lidar=lidar))
    for number, frame in simulated.items():
        assert 0 < len(frame["points"]) < len(plain[number]["points"])
        assert (frame["points"][:, 3] > 0).all()
        assert (frame["boxes"] == plain[number]["boxes"]).all()
    if lidar == "camera":
        # The sensor stands in the camera: boxes ahead of it are where the labels have them, axes apart.
        label = next(thing for thing in simulated["000000"]["objects"])
        x, _, z = label["place"]
        assert simulated["000000"]["boxes"][0, :2] == pytest.approx([z, -x], abs=1e-3)
