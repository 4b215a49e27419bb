"""Flags that several commands share."""

from pathlib import Path

import pytest

from jaxsim.cli import COMMANDS
from jaxsim.cli.effects import Effects
from jaxsim.cli.export import Export
from jaxsim.cli.flags import SAME, DataSource
from jaxsim.cli.running import parse
from jaxsim.config import DataConfig
from jaxsim.data.synthetic.layout import STATISTICS
from jaxsim.frame import Frame
from jaxsim.geometry import preset
from jaxsim.runs.frames import RunFrames, write_frames


def test_files_of_effects_may_be_several_and_the_folder_is_the_commands_own():
    words = ["--effects-from", "a.py", "--effects-from", "b.py"]
    assert parse(Effects, words, name="effects", example="").effects_from == (Path("a.py"), Path("b.py"))
    asked = parse(Export, ["--out", "tree", "--cluster", "tcp://a:1", *words], name="export", example="")
    assert (asked.writes_to, asked.cluster, len(asked.effects_from)) == (Path("tree"), "tcp://a:1", 2)


def test_what_is_not_given_is_as_the_run_has_it():
    own = DataConfig("vkitti2", root=Path("own"), scenes=("Scene01",), lidar="camera", seed=7)
    assert SAME.config(own) == own
    assert DataSource(camera=1).config(own) == DataConfig(
        "vkitti2", root=Path("own"), scenes=("Scene01",), lidar="camera", seed=7, camera=1
    )
    foreign = DataSource("kitti_raw", root=Path("raw")).config(own)
    assert (foreign.kind, foreign.root, foreign.scenes) == ("kitti_raw", Path("raw"), ())


def test_flags_of_a_config_give_the_config_again():
    config = DataConfig("vkitti2", root=Path("v"), scenes=("Scene01",), variations=("fog",), camera=1, streets="suburb")
    assert DataSource.of(config).config() == config


@pytest.mark.parametrize("streets", STATISTICS)
def test_all_streets_of_the_embedded_world_are_named_as_in_a_config(streets):
    assert DataSource("synthetic", streets=streets).config() == DataConfig(streets=streets)


@pytest.mark.parametrize("name", ["simulate", "export", "prepare", "discover"])
def test_the_group_is_called_data_in_every_command(name: str):
    assert isinstance(COMMANDS[name].load().data, DataSource)


class Drives:
    """A data set of two frames a drive."""

    name, spec = "drives", preset("vlp16")

    def __init__(self, *drives: str):
        self.names = [f"{drive}-{k}" for drive in drives for k in range(2)]

    def __len__(self) -> int:
        return len(self.names)

    def name_of(self, index: int) -> str:
        return self.names[index]

    def __getitem__(self, index: int) -> Frame:
        raise AssertionError("no frame is read to be chosen")


def test_a_runs_validation_frames_are_known_by_their_names(tmp_path, caplog):
    """A drive that sorts first has joined: what the run called 2 and 3 is now what it learned from."""
    write_frames(tmp_path, RunFrames.at(Drives("b", "c"), [0, 1], validation=[2, 3]))
    grown, of_run = Drives("a", "b", "c"), DataConfig(validation="2-3")
    assert SAME.choose(grown, of_run, frames="", run=tmp_path) == [4, 5]
    assert "validation frames '2-3' are no longer those of the run" in caplog.text
    assert SAME.choose(grown, of_run, frames="0", run=tmp_path) == [0]
    assert DataSource("polar").choose(grown, of_run, frames="", run=tmp_path) == [*range(6)]
    assert SAME.choose(grown, of_run, frames="", run=tmp_path / "of_an_earlier_version") == [2, 3]
