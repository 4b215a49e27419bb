"""What export.json says of a tree: one of other settings is not added to."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from jaxsim.cli.export import Export
from jaxsim.cli.flags import DataSource
from jaxsim.config import CloudRecipe
from jaxsim.data.polar_frames import write_grid
from jaxsim.effects.chain import SensorModel
from jaxsim.export.plan import choose_frames
from jaxsim.geometry import LidarSpec, full_grid

PLAIN = CloudRecipe(source="measured")


def test_frames_that_validate_are_among_those_that_are_exported(six):
    assert choose_frames(six, frames="", validation="") == ([0, 1, 2, 3, 4, 5], set())
    assert choose_frames(six, frames="0-3", validation="2-3") == ([0, 1, 2, 3], {2, 3})
    with pytest.raises(ValueError, match="--validation 3-4 names frames that --frames does not"):
        choose_frames(six, frames="0-3", validation="3-4")


def test_frames_of_another_folder_or_read_by_other_rows_are_not_added(tmp_path, six):
    settings = {"out": tmp_path / "out", "recipe": CloudRecipe(source="measured")}

    def kitti(folder: Path, **more) -> DataSource:
        return DataSource("kitti_object", root=folder, **more)

    Export(**settings, data=kitti(tmp_path / "a"), frames="0")()
    Export(**settings, data=kitti(tmp_path / "b" / ".." / "a"), frames="0")()
    with pytest.raises(ValueError, match=r"\(root was .*a, now .*b\); .*\(where a folder has only moved, write"):
        Export(**settings, data=kitti(tmp_path / "b"), frames="0-1")()
    with pytest.raises(ValueError, match=r"settings \(rows was file_order, now elevation\)"):
        Export(**settings, data=kitti(tmp_path / "a", rows="elevation"), frames="0-1")()


def test_lines_of_any_sensor_are_read_from_its_grid(tmp_path, six):
    narrow = LidarSpec("three", (-1.0, -3.0, -5.0), (0.0,) * 3, columns=720, min_range_m=1.0, max_range_m=100.0)
    (tmp_path / "sensor").mkdir()
    write_grid(tmp_path / "sensor", full_grid(narrow))
    recipe = CloudRecipe(lines=str(tmp_path / "sensor"), beams=(0, 2))
    Export(out=tmp_path / "out", frames="0", recipe=recipe)()
    xyz = np.fromfile(tmp_path / "out/training/velodyne/000000.bin", "<f4").reshape(-1, 4)[:, :3]
    elevation = np.rad2deg(np.arctan2(xyz[:, 2], np.hypot(xyz[:, 0], xyz[:, 1])))
    assert len(xyz) > 50
    assert (np.abs(elevation[:, None] - [-1, -5]).min(axis=1) < 1).all()
    write_grid(tmp_path / "sensor", full_grid(replace(narrow, elevation_deg=(-1.0, -3.0, -6.0))))
    with pytest.raises(ValueError, match=r"settings \(recipe\.lines was grid of SHA-256"):
        Export(out=tmp_path / "out", frames="0", recipe=recipe)()


def test_a_tree_of_other_levels_is_not_gone_on_with_and_an_old_one_that_says_none_is(tmp_path, six, monkeypatch):
    monkeypatch.setattr("jaxsim.export.trees.check_recipe", lambda *of: None)

    def export(noise):
        levels = {} if noise is None else {"range_noise": noise}
        SensorModel((("range_scale", {"scale": 0.01}),), levels).save(tmp_path / "sensor.json")
        Export(out=tmp_path / "out", frames="0", recipe=PLAIN, effects=tmp_path / "sensor.json")()

    monkeypatch.setattr("jaxsim.export.trees.make_cloud", lambda frame, *rest, **more: frame.cloud)
    export(0.02)
    record = tmp_path / "out" / "export.json"
    content = json.loads(record.read_text())
    assert content["settings"]["levels"] == {"range_noise": 0.02}
    export(0.02)
    with pytest.raises(ValueError, match=r"other settings \(levels\.range_noise was 0\.02, now 0\.03\)"):
        export(0.03)
    with pytest.raises(ValueError, match=r"levels\.range_noise was 0\.02, now None"):
        export(None)
    # Records of earlier versions say nothing of levels.
    del content["settings"]["levels"], content["settings"]["own"]
    record.write_text(json.dumps(content))
    export(0.02)
    assert json.loads(record.read_text())["settings"]["levels"] == {"range_noise": 0.02}
