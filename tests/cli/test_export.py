"""What `jaxsim export` refuses."""

from dataclasses import replace
from pathlib import Path

import pytest

from jaxsim.cli.export import Export
from jaxsim.cli.flags import DataSource
from jaxsim.config import CloudRecipe
from jaxsim.effects.chain import SensorModel
from tests.export.made_trees import Six


def test_effects_need_rays(tmp_path, six):
    SensorModel((("random_dropout", {"probability": 0.5}),)).save(tmp_path / "sensor.json")
    with pytest.raises(ValueError, match=r"give --recipe\.source simulated --recipe\.projection grid"):
        Export(out=tmp_path / "out", frames="0", effects=tmp_path / "sensor.json")()


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"frames": ""}, "say which frames"),
        ({"frames": "0-1", "validation": "2"}, "names frames that --frames does not"),
        ({"frames": "0", "occlusion": "paper"}, "is for vkitti2"),
        ({"frames": "0", "recipe": CloudRecipe(lines="128")}, "no lines named '128'; known: 32_of_64, 32_wide"),
        ({"frames": "0", "recipe": CloudRecipe(lines="32_of_64", beams=(9, 13))}, "lines 64 --recipe.beams 9 13"),
        ({"frames": "0", "recipe": CloudRecipe(source="simulated")}, "needs a trained sensor.*--run"),
        ({"frames": "0", "run": Path("embedded")}, r"of source depth; leave --run out, or give --recipe\.source sim"),
        ({"frames": "0", "recipe": CloudRecipe(source="measured", beams=(1,))}, "there are none; name them"),
        ({"frames": "0", "effects": Path("nowhere.json")}, r"no file nowhere\.json"),
        ({"frames": "1-2"}, "no frame of 2 is left"),
        ({"frames": "0", "data": DataSource("kitti_object", lidar="camera")}, "sensors of kitti_object stand apart"),
    ],
)
def test_what_cannot_be_exported_is_told(tmp_path, six, settings, message):
    with pytest.raises(ValueError, match=message):
        Export(out=tmp_path, **settings)()


def test_a_set_without_depth_asks_for_measured_clouds(tmp_path, six, monkeypatch):
    plain = Six.__getitem__

    def without(self, index):
        frame = plain(self, index)
        return replace(frame, camera=replace(frame.camera, depth_m=None, depth_valid=None), cloud=None)

    monkeypatch.setattr(Six, "__getitem__", without)
    with pytest.raises(ValueError, match="six-0 has no depth"):
        Export(out=tmp_path, frames="0")()
    with pytest.raises(ValueError, match="six-0 has no measured cloud"):
        Export(out=tmp_path, frames="0", recipe=CloudRecipe(source="measured"))()
