"""One run of several that were trained apart: its network is their mean."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import jax

from jaxsim.config import Experiment
from jaxsim.config.ranges import settings_of
from jaxsim.files import as_argument, differences
from jaxsim.pix2pix import state_shapes
from jaxsim.prepare import input_channels
from jaxsim.runs.frames import shared_frames
from jaxsim.runs.kinds import Run, kind_of
from jaxsim.runs.run import Checkpoints, check_folder, load_run, start_run
from jaxsim.train.training import write_card


def join_runs(folders: Sequence[Path], out: Path) -> Run:
    """Writes a run to `out` whose network is the mean of the U-Nets in `folders`, each at its latest checkpoint.

    All of their states are joined, the optimisers' too, so that the run trains on like any other, each network from its
    own share of the batch. Where `out` holds this very run already, or one that has trained on, nothing changes.

    Raises ValueError where there are fewer than two runs, one is no U-Net's or joined itself, they differ in more than
    the seed, learned from other frames (runs of earlier versions do not say), or are at different steps.
    """
    if len(set(folders)) < 2 or len(set(folders)) < len(folders):
        raise ValueError(f"join: {' '.join(map(str, folders)) or 'nothing'} is named; name two runs or more, each once")
    runs = [load_run(folder) for folder in folders]
    for folder, run in zip(folders, runs, strict=True):
        _check(folder, run, first=runs[0])
    frames = shared_frames(folders, by="join")
    for folder, run in zip(folders, runs, strict=True):
        if any(getattr(run, name) != getattr(runs[0], name) for name in ("spec", "intrinsics", "cam_from_velo")):
            raise ValueError(f"join: {folder} has another sensor or camera than {folders[0]}; join runs of one set")
    checkpoints = [Checkpoints(folder) for folder in folders]
    steps = {str(folder): saved.latest for folder, saved in zip(folders, checkpoints, strict=True)}
    if len(set(steps.values())) > 1:
        listed = ", ".join(f"{folder} {step or 'none'}" for folder, step in steps.items())
        raise ValueError(f"join: the runs are at different steps ({listed}); train them all to the same one")
    joined, kept = _joined(runs[0], len(runs), out), Checkpoints(out)
    check_folder(out, joined.experiment)
    if kept.latest and kept.latest >= (checkpoints[0].latest or 0):
        return joined
    channels = input_channels(joined.experiment.prepare)
    alone = state_shapes(runs[0].experiment, channels)
    states = [saved.restore("state", alone) for saved in checkpoints]
    state = _of_members(states, like=state_shapes(joined.experiment, channels))

    start_run(out, joined, frames)
    write_card(
        out,
        joined,
        f"The mean of {len(folders)} networks that were trained apart, {int(state.step)} steps each.",
        facts=[folder.name for folder in folders],
        end=[f"Scores beside baselines, and pictures: `jaxsim eval {as_argument(out.parent / out.name)}`"],
    )
    kept.save(int(state.step), state=state, generator=state.ema)
    return joined


def _check(folder: Path, run: Run, *, first: Run) -> None:
    """Raises ValueError where a run is none that can be joined, or has other settings than the first."""
    generator = run.experiment.generator
    if generator.form != "unet" or generator.members > 1:
        what = f"{generator.form}'s" if generator.form != "unet" else "joined itself"
        raise ValueError(f"join: {folder} is {what}; name runs of one U-Net each (--generator.form unet)")
    plain, free = kind_of(first).plain, settings_of(Experiment, "kept", "used", "file", "drawn")
    if differs := list(differences(plain(first.experiment), plain(run.experiment), free=[*free])):
        raise ValueError(f"join: of {folder} {', '.join(differs)}; runs that are joined differ in their seed alone")


def _joined(first: Run, members: int, out: Path) -> Run:
    settings: Experiment = first.experiment
    return replace(
        first,
        experiment=replace(
            settings,
            generator=replace(settings.generator, members=members),
            # A step and an epoch of each are those of all.
            optim=replace(settings.optim, batch=members * settings.optim.batch, epochs=members * settings.optim.epochs),
            run=replace(settings.run, name=out.name, out=out.parent),
        ),
    )


def _of_members(states: Sequence[Any], *, like: Any) -> Any:
    """The state of all of them: a leaf below `members`, k is that of the k-th state, any other the first state's."""
    leaves = [dict(jax.tree.flatten_with_path(state)[0]) for state in states]

    def leaf(path: tuple[Any, ...], _: Any) -> Any:
        at = next((i for i, key in enumerate(path) if _name(key) == "members"), None)
        if at is None:
            return leaves[0][path]
        return leaves[int(_name(path[at + 1]))][path[:at] + path[at + 2 :]]

    return jax.tree.map_with_path(leaf, like)


def _name(key: Any) -> str:
    return str(getattr(key, "key", getattr(key, "name", "")))
