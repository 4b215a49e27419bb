"""`jaxsim real2sim2real`: the paper's loop, from real drives to detectors of simulated clouds, stage by stage."""

from __future__ import annotations

import inspect
from collections.abc import Sequence

import tyro

from jaxsim.cli.discover import Discover
from jaxsim.cli.export import Export
from jaxsim.cli.source import Source
from jaxsim.config import LoopConfig
from jaxsim.files import working_in
from jaxsim.simulate.trees import export_trees
from jaxsim.studies.real2sim2real import WITH_EFFECTS, Loop, settle_loop
from jaxsim.studies.real2sim2real.stages import Stages, check_sources
from jaxsim.train.experiments import load_loop

DEFAULT = "real2sim2real"


def run(argv: Sequence[str]) -> None:
    """The paper's loop: learn the sensor from real drives, simulate with it, train detectors, score on real clouds.

    Trains the intensity network on real pairs; asks `discover` what it lacks; makes clouds of the renderer's frames in
    several kinds (without intensity, 32 lines, simulated intensity with lost rays, the same with the effects found);
    trains a detector on each and one on real clouds; scores all on real, and the real one on all. Tables beside the
    paper's, pictures and one page go to OUT. Any setting is a flag. The same command resumes a killed one.

    `--config` names one of configs/ (real2sim2real, the embedded world; real2sim2real_kitti), a file like them, or the
    loop.json of an earlier one.
    """
    name, flags = _config_of(argv)
    config, words = load_loop(name)
    intro = f"    jaxsim real2sim2real --config {name}\n\n{inspect.getdoc(run)}\n\n{name}: {words}"
    asked = tyro.cli(
        LoopConfig, args=flags, default=config, description=intro, prog=f"jaxsim real2sim2real --config {name}"
    )
    check_sources(asked)
    with working_in(asked.out, doing="at work in"):
        Stages(settle_loop(asked), discover=discover_lacking, export=export_kinds).all()


def _config_of(argv: Sequence[str]) -> tuple[str, list[str]]:
    """The name after --config, and the other flags."""
    flags = [part for word in argv for part in (word.split("=", 1) if word.startswith("--config=") else [word])]
    if "--config" not in flags:
        return DEFAULT, flags
    at = flags.index("--config")
    if at + 1 == len(flags):
        raise ValueError("real2sim2real: --config wants a name: real2sim2real, real2sim2real_kitti, or a loop.json")
    return flags[at + 1], flags[:at] + flags[at + 2 :]


def discover_lacking(loop: Loop) -> None:
    """Writes what `discover` finds the loop's sensor to lack."""
    Discover(out=loop.effects.parent, run=loop.sensor)()


def export_kinds(loop: Loop) -> None:
    """Writes the trees of all kinds; the renderer's frames are read once for all."""
    source = loop.config.synthetic
    exports = [
        Export(
            out=loop.tree(kind),
            data=Source.of(source),
            frames=f"{source.train},{source.validation}",
            validation=source.validation,
            recipe=loop.recipe(kind),
            run=loop.sensor if loop.recipe(kind).source == "simulated" else None,
            effects=loop.effects if kind in WITH_EFFECTS else None,
            occlusion=loop.config.occlusion if source.kind == "vkitti2" else "levels",
        )
        for kind in loop.config.kinds
    ]
    dataset = exports[0].dataset()
    export_trees([export.plan(dataset) for export in exports], dataset)
