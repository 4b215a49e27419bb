"""Every network trained, one after the other, and named by its inputs."""

import sys

import pytest

from jaxsim.metrics import Score
from jaxsim.metrics.frechet import FrechetScore
from jaxsim.studies.ablation import MODALITIES, AblationRow, ablation_table, besides, best_networks, modality, train_all


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


def row(name: str, mae: float, psnr: float, distance: float) -> AblationRow:
    scores = {"mae": Score(mae, "1", 10), "psnr": Score(psnr, "dB", 10)}
    return AblationRow(name, MODALITIES[name], scores, FrechetScore("frechet_random_64", distance, None, (80, 80), 64))


def test_the_table_holds_the_papers_fid_beside_ours_and_marks_the_best():
    rows = [row("rgb", 0.3, 20.0, 5.0), row("combined", 0.2, 20.0, 7.0)]
    assert best_networks(rows) == {"mae": "combined", "psnr": "", "frechet": "rgb"}
    lines = ablation_table(rows, {"global mean": rows[0].scores}).splitlines()
    assert lines[0] == "| inputs | FID in the paper | frechet_random_64 | mae | psnr (dB) |"
    assert lines[2:] == [
        "| rgb | 89.44 | **5.00** | 0.3000 | 20.00 |",
        "| combined | 73.81 | 7.00 | **0.2000** | 20.00 |",
        "| global mean | - | - | 0.3000 | 20.00 |",
    ]
