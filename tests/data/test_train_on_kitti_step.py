"""The paper's experiment, as a user starts it, with small networks on two sequences in the data set's own format."""

import json

import pytest

from tests.programs import ROOT, said

ALONE = ["--loss.perceptual=0", "--prepare.denoise=none"]
"""Without weights of other networks."""
SMALL = [
    "--generator.filters=4", "--generator.blocks=1", "--generator.downsamples=2", "--generator.enhancer-blocks=1",
    "--discriminator.filters=4", "--discriminator.max-filters=8", "--optim.batch=1", "--optim.epochs=3",
    "--run.log-every=1", "--run.picture-every=100",
]  # fmt: skip


@pytest.mark.slow
def test_the_papers_experiment_trains_by_epochs_and_scores_what_it_held_back(step_tree, tmp_path):
    sequences = ("--data.root", step_tree, "--data.scenes", "0000", "0001")
    output = said(tmp_path, ROOT / "train.py", "kitti_step_combined", *ALONE, *SMALL, *sequences)
    assert "perceptual loss: off" in output
    assert "3 steps done" in output
    lines = (tmp_path / "runs" / "kitti_step_combined" / "metrics.jsonl").read_text().splitlines()
    steps = [json.loads(line) for line in lines]
    assert [line["step"] for line in steps if "loss/generator" in line] == [1, 2, 3]
    assert any("validation/mae" in line for line in steps)
