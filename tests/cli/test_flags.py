"""Flags that several commands share."""

from pathlib import Path

import pytest
import tyro

from jaxsim.cli import COMMANDS
from jaxsim.cli.ablation import Ablation
from jaxsim.cli.discover import Discover
from jaxsim.cli.effects import Effects
from jaxsim.cli.eval import Evaluation
from jaxsim.cli.export import Export
from jaxsim.cli.flags import SAME, DataSource, in_new_spelling
from jaxsim.cli.prepare import Prepare
from jaxsim.cli.running import parse
from jaxsim.cli.simulate import Simulate
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


KITTI = DataSource("kitti_step", root=Path("drives"), scenes=("0001", "0018"))
KITTI_WORDS = "--data.kind kitti_step --data.root drives --data.scenes 0001 0018"
KITTI_ONCE = "--data kitti_step --root=drives --scenes 0001 0018"
VIRTUAL = DataSource("vkitti2", root=Path("v"), variations=("fog",), camera=1, lidar="camera")


def parsed(flags: type, words: str):
    return tyro.cli(flags, args=in_new_spelling(words.split(), flags))


@pytest.mark.parametrize("words", [KITTI_WORDS, KITTI_ONCE])
@pytest.mark.parametrize("flags", [Simulate, Discover, Evaluation])
def test_commands_of_a_run_take_the_data_set_under_both_names(flags: type, words: str):
    out = "" if flags is Evaluation else "--out o"
    command = parsed(flags, f"runs/a {out} {words} --frames 0-3")
    assert (command.run, command.data, command.frames) == (Path("runs/a"), KITTI, "0-3")
    assert parsed(flags, f"runs/a {out} --data same").data == SAME


@pytest.mark.parametrize("words", [KITTI_WORDS, KITTI_ONCE, "kitti_step --root drives --scenes 0001 0018"])
@pytest.mark.parametrize("flags", [Export, Prepare])
def test_commands_without_a_run_also_take_the_kind_as_their_first_word(flags: type, words: str):
    assert parsed(flags, f"{words} --out o").data == KITTI


def test_every_field_has_its_earlier_name():
    words = "--data vkitti2 --root v --variations fog --camera 1 --lidar camera"
    assert parsed(Simulate, f"runs/a --out o {words}").data == VIRTUAL
    assert parsed(Export, f"--out o {words}").data == VIRTUAL
    world = parsed(Export, "--out o --seed 3 --streets suburb --rows elevation --frames 0").data
    assert world == DataSource("synthetic", seed=3, streets="suburb", rows="elevation")


def test_a_flag_of_the_command_itself_keeps_its_meaning():
    command = parsed(Simulate, "runs/a --out o --seed 3 --data.seed 4")
    assert (command.seed, command.data.seed) == (3, 4)


def test_the_ablations_other_data_set_has_its_earlier_names():
    command = parsed(Ablation, "--also vkitti2 --also_root v --also-scenes Scene01 --also-frames 0")
    assert command.also == DataSource("vkitti2", root=Path("v"), scenes=("Scene01",))
    assert command.also_frames == "0"


@pytest.mark.parametrize(("flags", "words"), [(Simulate, "runs/a"), (Discover, ""), (Export, "")])
def test_effects_were_called_sensor(flags: type, words: str):
    for name in ("--effects", "--sensor"):
        assert parsed(flags, f"{words} --out o {name} sensor.json").effects == Path("sensor.json")


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
