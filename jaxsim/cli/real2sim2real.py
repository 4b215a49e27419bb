"""`jaxsim real2sim2real`: the paper's loop, from real drives to detectors of simulated clouds, stage by stage."""

from __future__ import annotations

import inspect
from collections.abc import Sequence

import tyro

from jaxsim.config import LoopConfig, SegmentationConfig
from jaxsim.files import working_in
from jaxsim.studies.real2sim2real import claim_loop
from jaxsim.studies.real2sim2real.stages import Stages, check_sources
from jaxsim.studies.segmentation import run_segmentation
from jaxsim.train.experiments import load_loop

DEFAULT = "real2sim2real"
DETECTION, SEGMENTATION = "detection", "segmentation"


def run(argv: Sequence[str]) -> None:
    """The paper's loop: learn the sensor from real drives, simulate with it, train detectors, score on real clouds.

    Trains the intensity network on real pairs; asks `discover` what it lacks; makes clouds of the renderer's frames in
    several kinds (without intensity, 32 lines, simulated intensity with lost rays, the same with the effects found);
    trains a detector on each and one on real clouds; scores all on real, and the real one on all. Tables beside the
    paper's, pictures and one page go to OUT. Any setting is a flag. The same command resumes a killed one.

    `--config` names one of configs/ (real2sim2real, the embedded world; real2sim2real_kitti), a file like them, or the
    loop.json of an earlier one. `--task segmentation` asks the same of networks that tell classes apart in labelled
    range images; it has flags of its own.
    """
    task, flags = _value_of("--task", argv, default=DETECTION, wanted="detection or segmentation")
    if task == SEGMENTATION:
        return segment(flags)
    if task != DETECTION:
        raise ValueError(f"real2sim2real: no task {task!r}; there are {DETECTION} and {SEGMENTATION}")
    wanted = "a name: real2sim2real, real2sim2real_kitti, or a loop.json"
    name, flags = _value_of("--config", flags, default=DEFAULT, wanted=wanted)
    config, words = load_loop(name)
    intro = f"    jaxsim real2sim2real --config {name}\n\n{inspect.getdoc(run)}\n\n{name}: {words}"
    asked = tyro.cli(
        LoopConfig, args=flags, default=config, description=intro, prog=f"jaxsim real2sim2real --config {name}"
    )
    check_sources(asked)
    with working_in(asked.out, doing="at work in"):
        Stages(claim_loop(asked)).all()


def segment(argv: Sequence[str]) -> None:
    """What simulated intensity is worth to the segmentation of labelled range images.

    Learns each cell's class without intensity, with that of a sensor which never saw these frames, and with measured
    intensity; judges all on measured frames of other parts; IoU of each class. The same command resumes a killed one.
    """
    example = "jaxsim real2sim2real --task segmentation"
    intro = f"    {example} --root RANGE_IMAGES --seeds 0 1 2\n\n{inspect.getdoc(segment)}"
    asked = tyro.cli(SegmentationConfig, args=list(argv), description=intro, prog=example)
    with working_in(asked.out, doing="at work in"):
        print(f"table: {run_segmentation(asked)}")


def _value_of(flag: str, argv: Sequence[str], *, default: str, wanted: str) -> tuple[str, list[str]]:
    """The word after a flag, and all other words."""
    words = [part for word in argv for part in (word.split("=", 1) if word.startswith(f"{flag}=") else [word])]
    if flag not in words:
        return default, words
    at = words.index(flag)
    if at + 1 == len(words):
        raise ValueError(f"real2sim2real: {flag} wants {wanted}")
    return words[at + 1], words[:at] + words[at + 2 :]
