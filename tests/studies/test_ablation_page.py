"""The table beside the paper's."""

from jaxsim.metrics import Score
from jaxsim.metrics.frechet import FrechetScore
from jaxsim.studies.ablation import MODALITIES
from jaxsim.studies.ablation_page import AblationRow, ablation_table, best_networks


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
