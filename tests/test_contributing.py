"""The examples of CONTRIBUTING.md, added as it says and used."""

import re
import sys
import tomllib
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Literal, get_type_hints

import jax
import numpy as np
import pytest

import jaxsim.config.ranges
import jaxsim.data
from jaxsim.cli import COMMANDS, main
from jaxsim.cli.command import Command
from jaxsim.config import DataConfig
from jaxsim.data import DATASETS, Dataset, open_dataset
from jaxsim.effects import EFFECTS, all_rays
from jaxsim.effects.chain import SensorModel
from jaxsim.effects.page import describe, effects_table
from tests.effects.streets import road_and_walls

ROOT = Path(__file__).parents[1]
BLOCKS = re.findall(r"^```python\n# (.*?)\n(.*?)^```", (ROOT / "CONTRIBUTING.md").read_text(), re.DOTALL | re.MULTILINE)


def module_of(path, monkeypatch):
    """The module that the example for a file would be, imported under its name."""
    [text] = [text for said, text in BLOCKS if said == path]
    assert not (ROOT / path).exists(), f"{path} is a real file now; CONTRIBUTING.md needs another example"
    module = ModuleType(path.removesuffix(".py").replace("/", "."))
    monkeypatch.setitem(sys.modules, module.__name__, module)
    exec(compile(text, path, "exec"), module.__dict__)
    return module


def add_row(table, said, names, monkeypatch):
    """Adds the row that the example has for a table."""
    [row] = [text for title, text in BLOCKS if title == said]
    for key, value in eval("{" + row + "}", dict(names)).items():
        assert key not in table
        monkeypatch.setitem(table, key, value)


def test_an_effect_is_added_by_a_file_and_a_row(monkeypatch):
    vignetting = module_of("jaxsim/effects/catalogue/vignetting.py", monkeypatch)
    add_row(EFFECTS, "a row of EFFECTS", {"vignetting": vignetting}, monkeypatch)
    scan = road_and_walls()
    rays = jax.jit(all_rays)(scan)
    model = SensorModel((("vignetting", {"share": 0.5}), ("beam_gain", {"gain": 0.1})))
    assert [name for name, _ in model.effects] == ["beam_gain", "vignetting"]
    after = model.apply(rays, scan)
    more = np.asarray(after.log_intensity - rays.log_intensity)[0, :, 0]
    np.testing.assert_allclose(more, 0.1 + 2 * np.log(np.cos(scan.grid.elevation_rad)), atol=1e-5)
    assert "vignetting" in effects_table()
    assert "cosine-fourth" in describe(EFFECTS["vignetting"])


def test_the_new_effect_s_sensor_json_reads_back(monkeypatch, tmp_path):
    vignetting = module_of("jaxsim/effects/catalogue/vignetting.py", monkeypatch)
    add_row(EFFECTS, "a row of EFFECTS", {"vignetting": vignetting}, monkeypatch)
    model = SensorModel((("vignetting", {"share": 0.5}),))
    model.save(tmp_path / "sensor.json")
    assert SensorModel.load(tmp_path / "sensor.json") == model
    with pytest.raises(ValueError, match="vignetting: share is 2"):
        SensorModel((("vignetting", {"share": 2.0}),))


def test_a_data_set_is_added_by_a_class_and_a_row(monkeypatch, tmp_path):
    scans = module_of("jaxsim/data/scans.py", monkeypatch)
    add_row(DATASETS, "a row of DATASETS", vars(jaxsim.data) | vars(scans), monkeypatch)
    monkeypatch.setattr(jaxsim.config.data, "DataKind", Literal["scans"])
    kinds = partial(get_type_hints, include_extras=True)
    monkeypatch.setattr(jaxsim.config.ranges, "_hints", kinds)  # without what was kept of the kinds before
    points = np.array([[10.0, 1.0, -1.0, 0.5], [20.0, -2.0, 0.0, 0.25]], np.float32)
    points.tofile(tmp_path / "000007.bin")
    dataset = open_dataset(DataConfig(kind="scans", root=tmp_path))
    assert isinstance(dataset, Dataset)
    assert len(dataset) == 1
    frame = dataset[0]
    assert not frame.camera.has_image
    assert (frame.name, dataset.name_of(0)) == ("000007", "000007")
    np.testing.assert_array_equal(frame.cloud.xyz_m, points[:, :3])
    np.testing.assert_array_equal(frame.cloud.intensity, points[:, 3])
    with pytest.raises(ValueError, match=r"name their folder with --data\.root"):
        open_dataset("scans")


def test_a_command_is_added_by_a_dataclass_and_a_row(monkeypatch, capsys):
    module_of("jaxsim/cli/beams.py", monkeypatch)
    add_row(COMMANDS, "a row of COMMANDS", {"Command": Command}, monkeypatch)
    main(["beams", "--sensor", "hdl64e"])
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 64
    assert lines[0].endswith("degrees")


def test_the_page_answers_each_question_in_five_lines():
    text = (ROOT / "CONTRIBUTING.md").read_text()
    for question in ("Where is the likelihood", "Where are the thresholds", "Where does an effect's parameter",
                     "How do I add an effect", "How do I add a data set", "How do I add a setting",
                     "How do I add a command"):  # fmt: skip
        [answer] = re.findall(rf"^## {question}[^\n]*\n\n(.*?)\n\n", text, re.DOTALL | re.MULTILINE)
        assert [line[:2] for line in answer.splitlines()] == ["1.", "2.", "3.", "4.", "5."], question


def test_the_page_has_the_rooms_in_the_order_that_is_enforced():
    """All rooms, and all inside discover, stand on the page as import-linter's first two contracts have them."""
    text = (ROOT / "CONTRIBUTING.md").read_text()
    said = [
        [re.findall(r"\w+", layer) for layer in order.split("<")] for order in re.findall(r"`(\w[^`]*? < [^`]*)`", text)
    ]
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    enforced = [[re.findall(r"\w+", layer) for layer in reversed(contract["layers"])] for contract in contracts[:2]]
    assert [*said[0], ["__main__"]] == enforced[0]
    assert said[1] == enforced[1]
