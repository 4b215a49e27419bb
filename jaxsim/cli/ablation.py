"""`jaxsim eval ablation`: networks that differ in their inputs, trained where they are missing, in one table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from jaxsim.cli.commands import MODES
from jaxsim.cli.flags import SAME, DataSource
from jaxsim.cli.running import parse
from jaxsim.cli.train import parse_experiment
from jaxsim.config import Experiment
from jaxsim.config.ranges import Checked, Count, Whole
from jaxsim.data import open_dataset
from jaxsim.files import working_in
from jaxsim.metrics.frechet import require_images
from jaxsim.metrics.inception import open_extractor
from jaxsim.runs.frames import judges_of
from jaxsim.runs.kinds import kind_of
from jaxsim.runs.run import load_run
from jaxsim.studies.ablation import besides, compare_networks, train_all


@dataclass(frozen=True)
class Ablation(Checked):
    """The paper's first table: what each kind of input is worth. Give trained runs, or an experiment to train from.

        jaxsim eval ablation --runs runs/kitti_step_rgb runs/kitti_step_combined ...
        jaxsim eval ablation --train ablation --out runs/ablation [-- FLAGS OF jaxsim train]

    `--train` trains the experiment five times, with the inputs rgb, semantic, edges, depth, and all four (combined), to
    OUT/NAME; inputs of the experiment that the paper has not (incidence, range, row) go to all five. A run that is
    finished is not trained again and one that was killed goes on. Writes ablation.md, ablation.json, ablation.html
    (opens from disk) and the pictures (inputs and measurement | five predictions) to OUT.
    """

    runs: tuple[Path, ...] = ()
    """Folders of trained runs that differ in their inputs alone."""
    train: str = ""
    """An experiment of configs/ to train with each kind of input, instead."""
    out: Path = Path("runs/ablation")
    """Where to write, and where `--train` keeps its runs."""
    frames: str = ""
    """Frames to judge: `0-2`, or a part by name: `evaluation`. Empty: the runs' validation frames."""
    fid: str = ""
    """Also the Fréchet Inception distance: weights from `jaxsim convert` (FILE.npz), or `random`: a network of random
    weights, whose score is called frechet_random."""
    fid_features: Count = 2048
    """Features of Inception: 2048, or 768, 192, 64 for small sets (another score, under another name)."""
    pictures: Whole = 4
    """Frames to draw, evenly spread over those that are judged."""
    also: DataSource = SAME
    """Draw frames of another data set too, which no LiDAR measured: `--also.kind vkitti2`."""
    also_frames: str = "0-1"
    """Frames of it to draw."""


def ablation(args: Ablation, *, flags: Sequence[str] = ()) -> None:
    """Runs the command; `flags` are for training.

    Raises ValueError for runs that cannot be compared, and for flags that do not go together.
    """
    if bool(args.runs) == bool(args.train):
        raise ValueError("ablation: give either --runs FOLDER ... or --train EXPERIMENT")
    if flags and not args.train:
        raise ValueError(f"ablation: {' '.join(flags)}: flags after -- are for training; give --train EXPERIMENT")
    if twice := [run for k, run in enumerate(args.runs) if run.resolve() in {r.resolve() for r in args.runs[:k]}]:
        raise ValueError(f"ablation: {twice[0]} is named twice; name each run once")
    extractor = open_extractor(args.fid, args.fid_features) if args.fid else None
    folders = list(args.runs)
    if args.train:
        asked, _ = parse_experiment([args.train, *flags])
        if not isinstance(asked, Experiment):
            raise ValueError(
                f"ablation: {args.train} trains {kind_of(asked).name}; give one that trains an intensity network"
            )
        if extractor:
            # Too few frames to judge are told before five networks are trained.
            judges = judges_of(None, open_dataset(asked.data), frames=args.frames, validation=asked.data.validation)
            require_images(len(judges), extractor.width, name=extractor.score)
        folders = train_all(args.train, args.out, flags, more=besides(asked.prepare.inputs))
    unmeasured = None
    if args.also.foreign:
        seen = load_run(folders[0]).experiment.data
        unmeasured = args.also.config(seen), args.also_frames
    compare_networks(
        folders, args.out, frames=args.frames, extractor=extractor, pictures=args.pictures, unmeasured=unmeasured
    )


def run(words: Sequence[str]) -> None:
    """Runs the command on the words that follow its name; those after `--` are flags of the training."""
    end = words.index("--") if "--" in words else len(words)
    asked = parse(Ablation, words[:end], name="jaxsim eval ablation", example=MODES["eval ablation"].example)
    with working_in(asked.out):
        ablation(asked, flags=words[end + 1 :])
