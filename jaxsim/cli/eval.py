"""`jaxsim eval`: scores. Its first word says of what: a run (a folder), or one of MODES."""

from __future__ import annotations

from jaxsim.cli.commands import Command, call

RUN = Command("eval_run:Evaluation", "a trained run beside baselines", "jaxsim eval runs/demo")
MODES = {
    "generation": Command(
        "eval_generation:Generation",
        "two folders of frames or clouds",
        "jaxsim eval generation --simulated simulated/polar --measured measured --out scores",
    ),
    "detection": Command(
        "eval_detection:Detection",
        "a detector's KITTI result files",
        "jaxsim eval detection --detections detected/results --labels tree/training/label_2",
    ),
    "ablation": Command(
        "eval_ablation:run",
        "networks of different inputs in one table",
        "jaxsim eval ablation --train ablation --out runs/ablation",
    ),
}
"""What can be scored beside a run, by the word that asks for it."""


def main(words: list[str]) -> None:
    """Runs the mode that the first word names; any other word is the folder of a run."""
    if words and words[0] in MODES:
        call(MODES[words[0]], words[1:], name=f"jaxsim eval {words[0]}")
    else:
        call(RUN, words, name="jaxsim eval")
