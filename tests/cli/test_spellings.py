"""Flags of earlier versions."""

from pathlib import Path

import pytest
import tyro

from jaxsim.cli.ablation import Ablation
from jaxsim.cli.discover import Discover
from jaxsim.cli.eval import Evaluation
from jaxsim.cli.export import Export
from jaxsim.cli.flags import SAME, DataSource
from jaxsim.cli.prepare import Prepare
from jaxsim.cli.simulate import Simulate
from jaxsim.cli.spellings import in_new_spelling

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
