"""One data source in every command."""

from pathlib import Path

import pytest

from jaxsim.cli import COMMANDS
from jaxsim.cli.source import SAME, DataSource
from jaxsim.config import DataConfig
from jaxsim.data.synthetic.layout import STATISTICS


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
