"""`jaxsim train`: its help, and what it does not know."""

import pytest

from jaxsim.cli import main


def test_help_teaches(capsys):
    with pytest.raises(SystemExit):
        main(["train", "--help"])
    text = capsys.readouterr().out
    assert "Experiments (configs/):" in text
    assert "--optim.lr" in text
    assert "kitti_raw" in text


def test_an_unknown_experiment_names_the_known_ones():
    with pytest.raises(SystemExit, match="kitti_raw"):
        main(["train", "kitty"])
    with pytest.raises(
        SystemExit, match=r"no experiment 'synthtic'; did you mean synthetic\? There are ablation, demo"
    ):
        main(["train", "synthtic"])
