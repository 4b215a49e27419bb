"""Every network trained, one after the other, and named by its inputs."""

import sys

import pytest

from jaxsim.studies.ablation import MODALITIES, besides, modality, train_all


def test_every_network_is_trained_in_its_own_process_and_a_failure_ends_the_command(tmp_path):
    script = tmp_path / "train.py"
    script.write_text(
        "import sys, pathlib\n"
        f"log = pathlib.Path({str(tmp_path / 'log')!r})\n"
        "log.open('a').write(' '.join(sys.argv[1:]) + '\\n')\n"
        "sys.exit(3 if '--run.name edges' in ' '.join(sys.argv) and '--stop' in sys.argv else 0)\n"
    )
    trainer = (sys.executable, str(script))
    runs = train_all("ablation", tmp_path / "out", ["--optim.steps", "5"], more=("row",), trainer=trainer)
    assert [run.name for run in runs] == list(MODALITIES)
    lines = (tmp_path / "log").read_text().splitlines()
    assert lines[0] == (
        "ablation --optim.steps 5 --prepare.inputs rgb depth semantic edges row --run.name combined "
        f"--run.out {tmp_path / 'out'}"
    )
    with pytest.raises(SystemExit, match="training edges ended with status 3"):
        train_all("ablation", tmp_path / "out", ["--stop"], trainer=trainer)


def test_networks_have_the_papers_names_whatever_the_order_of_their_inputs():
    assert modality(("edges", "semantic", "rgb", "depth")) == "combined"
    assert modality(("rgb", "depth", "row")) == "rgb+depth"
    assert modality(("incidence", "row")) == "none"
    assert besides(("row", "rgb", "incidence")) == ("row", "incidence")
