"""`jaxsim export` on a data set of six small frames that needs no rendering."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest

from jaxsim.cli.export import Export
from jaxsim.cli.flags import DataSource
from jaxsim.cloud.kitti_tree import tree_files
from jaxsim.config import CloudRecipe
from jaxsim.data import KittiObject
from jaxsim.effects.chain import SensorModel
from jaxsim.export.trees import export_trees
from jaxsim.simulate.learned_sensor import load
from tests.cloud import openpcdet_rules as rules
from tests.export.made_trees import Six, boxes_at

PLAIN = CloudRecipe(source="measured")


def listed(out, name):
    return (out / f"ImageSets/{name}.txt").read_text().split()


def test_objects_too_far_and_frames_without_objects_are_left_out(tmp_path, six, capsys):
    Export(out=tmp_path, frames="0-5", validation="3-5")()
    assert listed(tmp_path, "trainval") == ["000000", "000003", "000004", "000005"]
    assert listed(tmp_path, "train") == ["000000"]
    assert listed(tmp_path, "val") == ["000003", "000004", "000005"]
    assert "4 frames of" in (printed := capsys.readouterr().out)
    assert "2 left out (no object within 80 m)" in printed
    label = (tmp_path / "training/label_2/000004.txt").read_text()
    assert len(label.splitlines()) == 1
    dataset = KittiObject(tmp_path, rows="elevation")
    assert (dataset[0].cloud.intensity == 0).all()
    assert len(dataset[0].cloud.xyz_m) > 100
    about = json.loads((tmp_path / "export.json").read_text())["frames"]["000002"]
    assert (about["name"], about["left_out"]) == ("six-2", "no object within 80 m")


def test_the_same_command_makes_only_what_is_missing(tmp_path, six):
    Export(out=tmp_path, frames="0-3")()
    assert sorted(six.made) == [0, 1, 2, 3]
    tree_files(tmp_path, "000003")[0].unlink()
    six.made.clear()
    Export(out=tmp_path, frames="0-5")()
    assert sorted(six.made) == [3, 4, 5]
    assert all(path.is_file() for path in tree_files(tmp_path, "000003"))
    six.made.clear()
    Export(out=tmp_path, frames="0-5")()
    assert six.made == []


def test_what_a_kill_leaves_after_two_frames_is_gone_on_with(tmp_path, six, monkeypatch):
    plain, killed = Six.__getitem__, tmp_path / "killed"

    def read(self, index):
        if index == 4 and not killed.exists():
            # What is on disk at this moment is what SIGKILL would leave.
            shutil.copytree(tmp_path / "whole", killed)
        return plain(self, index)

    monkeypatch.setattr(Six, "__getitem__", read)
    Export(out=tmp_path / "whole", frames="3-5", workers=1)()
    assert (killed / "training/label_2/000003.txt").is_file()
    with pytest.raises(ValueError, match=r"other settings \(reach_m was 80\.0, now 60"):
        Export(out=killed, frames="3-5", reach_m=60.0)()
    Export(out=killed, frames="3-5")()
    files = sorted(path.relative_to(tmp_path / "whole") for path in (tmp_path / "whole").rglob("*") if path.is_file())
    assert len(files) == 3 * 4 + 3 + 1
    assert all((killed / path).read_bytes() == (tmp_path / "whole" / path).read_bytes() for path in files)


def test_a_clusters_workers_write_the_files_of_the_plain_command(tmp_path, six, scheduler):
    Export(out=tmp_path / "plain", frames="0-5", validation="3-5")()
    Export(out=tmp_path / "spread", frames="0-2", validation="2", cluster=scheduler)()
    six.made.clear()
    Export(out=tmp_path / "spread", frames="0-5", validation="3-5", cluster=scheduler)()
    assert sorted(six.made) == [3, 4, 5]
    files = sorted(path.relative_to(tmp_path / "plain") for path in (tmp_path / "plain").rglob("*") if path.is_file())
    assert len(files) > 4 * 4
    assert all((tmp_path / "spread" / path).read_bytes() == (tmp_path / "plain" / path).read_bytes() for path in files)


@pytest.mark.parametrize("entry", ["six-0", {"name": 3, "left_out": None}, {"name": "six-0"}])
def test_a_record_whose_frames_are_none_is_refused(tmp_path, six, entry):
    Export(out=tmp_path, frames="0")()
    record = json.loads((tmp_path / "export.json").read_text())
    (tmp_path / "export.json").write_text(json.dumps(record | {"frames": {"000000": entry}}))
    with pytest.raises(ValueError, match=r"export\.json cannot be read"):
        Export(out=tmp_path, frames="0-1")()


def test_a_data_set_whose_frames_have_shifted_is_not_mixed_with_what_it_was(tmp_path, six, monkeypatch):
    Export(out=tmp_path, frames="0")()
    monkeypatch.setattr(Six, "name_of", lambda self, index: f"six-{index + 1}")
    with pytest.raises(ValueError, match=r"holds six-0 as 000000, which is six-1 now \(1 such\)"):
        Export(out=tmp_path, frames="0-1")()


def test_several_trees_read_each_frame_once_and_are_what_each_alone_is(tmp_path, six):
    depth, wide = Export(out=tmp_path / "a", frames="0-5"), Export(out=tmp_path / "b", frames="0-3", validation="3")
    wide = replace(wide, recipe=CloudRecipe(lines="none"))

    def export_both():
        first, second = depth.maker(load), wide.maker(load)
        export_trees([*first.plans, *second.plans], first.dataset)

    export_both()
    assert sorted(six.made) == [0, 1, 2, 3, 4, 5]
    for tree in (depth, wide):
        alone = replace(tree, out=tmp_path / f"{tree.out.name}_alone")
        alone()
        files = sorted(path.relative_to(alone.out) for path in alone.out.rglob("*") if path.is_file())
        assert all((alone.out / path).read_bytes() == (tree.out / path).read_bytes() for path in files)
    (wide.out / "training/label_2/000000.txt").unlink()
    six.made.clear()
    export_both()
    assert six.made == [0]


def test_frames_of_another_making_are_not_added(tmp_path, six):
    Export(out=tmp_path, frames="0")()
    with pytest.raises(ValueError, match=r"other settings \(reach_m was 80\.0, now 60"):
        Export(out=tmp_path, frames="0-1", reach_m=60.0)()
    (tmp_path / "export.json").write_text("{")
    with pytest.raises(ValueError, match="cannot be read"):
        Export(out=tmp_path, frames="0")()
    (tmp_path / "export.json").unlink()
    with pytest.raises(ValueError, match=r"no export\.json says"):
        Export(out=tmp_path, frames="0")()


def test_an_error_in_one_frame_keeps_the_record_of_the_others(tmp_path, six):
    six.boxes = lambda index: None if index == 4 else boxes_at((0, 1.5, 10))
    with pytest.raises(ValueError, match="six-4 has no labels"):
        Export(out=tmp_path, frames="0-5", workers=1)()
    done = json.loads((tmp_path / "export.json").read_text())["frames"]
    assert {"000000", "000001", "000002", "000003"} <= set(done)
    six.boxes = None
    six.made.clear()
    Export(out=tmp_path, frames="0-5")()
    assert 4 in six.made
    assert 0 not in six.made


def test_frames_that_cannot_be_read_are_told_once_the_others_are_written(tmp_path, six, monkeypatch):
    plain = Six.__getitem__

    def read(self, index):
        if index in (0, 3):
            raise (ValueError, OSError)[index % 2](f"six-{index} is cut off")
        return plain(self, index)

    monkeypatch.setattr(Six, "__getitem__", read)
    with pytest.raises(ValueError, match=r"export: 2 of 6 pieces .* others are done; .*six-0 is cut off; six-3 is cut"):
        Export(out=tmp_path, frames="0-5", workers=1)()
    assert sorted(json.loads((tmp_path / "export.json").read_text())["frames"]) == [f"{k:06d}" for k in (1, 2, 4, 5)]
    monkeypatch.setattr(Six, "__getitem__", plain)
    six.made.clear()
    Export(out=tmp_path, frames="0-5")()
    assert sorted(six.made) == [0, 3]
    assert listed(tmp_path, "trainval") == ["000000", "000003", "000004", "000005"]


@pytest.mark.parametrize(("keep", "numbers"), [(False, []), (True, ["000001"])])
def test_frames_without_objects_stay_where_they_are_asked_for(tmp_path, six, keep, numbers):
    Export(out=tmp_path, frames="0-1", keep_empty=keep)()
    assert listed(tmp_path, "trainval")[1:] == numbers


def test_measured_clouds_are_written_as_they_are(tmp_path, six):
    Export(out=tmp_path, frames="0", recipe=CloudRecipe(source="measured"))()
    points = np.fromfile(tmp_path / "training/velodyne/000000.bin", "<f4").reshape(-1, 4)
    assert points.tolist() == [[10, 0, 0, 0.25], [12, 1, -1, 0.5]]


def test_a_split_within_a_scene_is_warned_of(tmp_path, six, capsys):
    Export(out=tmp_path, frames="3-5", validation="5")()
    assert "scenes on both sides of the split, street-1" in capsys.readouterr().err


def test_kittis_own_frames_are_copied_without_those_that_hold_nothing(tmp_path, samples):
    settings = {
        "data": DataSource("kitti_object", root=samples / "kitti_object"),
        "recipe": CloudRecipe(source="measured"),
    }
    Export(out=tmp_path, **settings)()
    source, copy = KittiObject(samples / "kitti_object"), KittiObject(tmp_path)
    assert len(copy) == 3
    for k in range(3):
        assert (copy[k].cloud.xyz_m == source[k].cloud.xyz_m).all()
        assert (copy[k].cloud.row == source[k].cloud.row).all()
        assert copy[k].boxes.kind == source[k].boxes.kind
        assert (copy[k].boxes.centre_m == source[k].boxes.centre_m).all()


def test_labels_without_their_calibration_are_told(tmp_path, samples):
    folder = tmp_path / "source" / "training"
    for name in ("velodyne", "image_2", "label_2"):
        shutil.copytree(samples / "kitti_object/training" / name, folder / name)
    settings = {"data": DataSource("kitti_object", root=folder.parent), "recipe": CloudRecipe(source="measured")}
    with pytest.raises(ValueError, match=r"there is no .*calib/000000.txt"):
        Export(out=tmp_path / "out", frames="0", **settings)()


@pytest.mark.slow
def test_the_embedded_worlds_boxes_hold_their_points_from_the_camera_and_from_the_lidar(tmp_path):
    for lidar in ("kitti", "camera"):
        for source in ("depth", "measured"):
            out = tmp_path / f"{lidar}_{source}"
            Export(
                out=out, frames="0-4:4", data=DataSource("synthetic", lidar=lidar), recipe=CloudRecipe(source=source)
            )()
            held = 0
            for frame in rules.accept(out).values():
                for box, thing in zip(frame["boxes"], frame["objects"], strict=True):
                    if thing["occluded"] == 0 and thing["truncated"] < 0.1 and np.hypot(*box[:2]) < 40:
                        count = rules.points_in(box, frame["points"]).sum()
                        assert count > 10, (lidar, source, thing)
                        held += 1
            assert held > 3


def test_effects_that_drift_count_from_the_data_sets_first_frame(tmp_path, six, monkeypatch):
    seen = []

    def made(frame, *rest, first_s, **more):
        seen.append(frame.time_s - first_s)
        raise ValueError("enough")

    def started(self, index, read=Six.__getitem__):
        return replace(read(self, index), time_s=1.3e9 + 0.1 * index)

    drift = SensorModel((("emitter_drift", {"rate": 0.1}),))
    monkeypatch.setattr(Six, "__getitem__", started)
    monkeypatch.setattr("jaxsim.export.trees.make_cloud", made)
    monkeypatch.setattr("jaxsim.export.trees.check_recipe", lambda *of: None)
    drift.save(tmp_path / "sensor.json")
    with pytest.raises(ValueError, match="enough"):
        Export(out=tmp_path / "out", frames="3-5", workers=1, effects=tmp_path / "sensor.json")()
    np.testing.assert_allclose(seen[0], 0.3, atol=1e-3)


def test_frames_of_changed_files_and_clouds_that_are_cut_off_are_made_anew(tmp_path, six, monkeypatch, caplog):
    out, files = tmp_path / "out", {k: tmp_path / f"{k}.bin" for k in range(6)}
    for file in files.values():
        file.write_bytes(b"1")
    monkeypatch.setattr(Six, "files_of", lambda self, index: [files[index]], raising=False)
    Export(out=out, frames="0-5")()
    Export(out=out, frames="0-5")()
    assert sorted(six.made) == [0, 1, 2, 3, 4, 5]
    six.made.clear()
    files[2].write_bytes(b"12")
    files[4].write_bytes(b"12")
    cut = tree_files(out, "000003")[0]
    cut.write_bytes(cut.read_bytes()[:-4])
    Export(out=out, frames="0-5")()
    assert sorted(six.made) == [2, 3, 4]
    assert "export: 000003 made anew: its cloud is cut off" in caplog.text
    assert "export: 000002 and 1 more made anew: what it was made of has changed since" in caplog.text
    assert cut.stat().st_size % 16 == 0
    # Nothing is left of a frame that has no object any more.
    files[4].write_bytes(b"123")
    six.boxes = lambda index: boxes_at()
    Export(out=out, frames="0-5")()
    assert not any(path.exists() for path in tree_files(out, "000004"))
    assert listed(out, "trainval") == ["000000", "000003", "000005"]


def test_a_tree_that_says_nothing_of_its_files_is_gone_on_with(tmp_path, six, monkeypatch):
    Export(out=tmp_path / "out", frames="3-5")()
    monkeypatch.setattr(Six, "files_of", lambda self, index: [tmp_path / "not there"], raising=False)
    Export(out=tmp_path / "out", frames="3-5")()
    assert sorted(six.made) == [3, 4, 5]
