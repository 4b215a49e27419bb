"""`jaxsim join`."""

import pytest

from jaxsim.cli import main
from jaxsim.simulate import load
from tests.train.made_apart import runs  # noqa: F401


def test_the_command_makes_a_run_that_loads(runs, tmp_path, capsys):  # noqa: F811
    main(["join", *map(str, runs), "--out", str(tmp_path / "joined")])
    assert "the mean of 3 networks. Scores beside baselines: jaxsim eval" in capsys.readouterr().out
    assert load(tmp_path / "joined").run.experiment.generator.members == 3


def test_one_run_and_a_folder_that_is_none_are_refused(tmp_path):
    with pytest.raises(SystemExit, match="name two runs or more"):
        main(["join", str(tmp_path / "one"), "--out", str(tmp_path / "joined")])
    with pytest.raises(SystemExit, match=r"no config\.json in .*one"):
        main(["join", str(tmp_path / "one"), str(tmp_path / "two"), "--out", str(tmp_path / "joined")])
