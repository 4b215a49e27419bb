"""Commands that write folders, each with small inputs, and a digest of what it wrote."""

from __future__ import annotations

import hashlib
import json
import re
import shutil
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from jaxsim.config import Experiment
from jaxsim.data.kitti import KittiRaw
from jaxsim.data.polar_frames import write_frame, write_grid
from jaxsim.frame import PolarImage
from jaxsim.train.experiments import load_experiment
from tests.detect.tiny import EXPERIMENT as DETECTOR
from tests.detect.tiny import scene
from tests.discover.toy import toy
from tests.fuzz.recordings import small_drive, small_object
from tests.untrained import untrained_detector, untrained_run

INTENSITY = """
from dataclasses import replace
from configs.synthetic import experiment as base

experiment = replace(
    base,
    data=replace(base.data, kind="kitti_raw", root="raw", train="0-4", validation="5", rows="elevation", cache="cache"),
    prepare=replace(
        base.prepare,
        inputs=("rgb", "depth"),
        depth="ip_basic_fast",
        columns=64,
        image_crop=(12, 40),
        network_size=(64, 128),
    ),
    generator=replace(base.generator, filters=4, blocks=1, downsamples=1, enhancers=0),
    discriminator=replace(base.discriminator, filters=4, max_filters=8, scales=1, layers=1),
    optim=replace(base.optim, steps=6, batch=2),
    run=replace(base.run, name="tiny", log_every=1, save_every=2, picture_every=2),
)
"""
DEPTH = """
from jaxsim.config import DataConfig, DepthExperiment, PenetConfig, RunConfig, Stage

experiment = DepthExperiment(
    data=DataConfig(kind="synthetic", train="0", validation="1920"),
    image_crop=(64, 128),
    penet=PenetConfig(width=2, stages=(Stage("branches", 4, 1, (32, 64), ()),)),
    run=RunConfig(name="depth", log_every=1, save_every=1, picture_every=2),
)
"""
LABELLED = """
from dataclasses import replace
from configs.synthetic import experiment as base

experiment = replace(
    base,
    data=replace(base.data, train="0,8", validation="16", cache="cache"),
    prepare=replace(base.prepare, columns=64, network_size=(64, 128)),
    generator=replace(base.generator, filters=4, blocks=1, downsamples=1, enhancers=0),
    discriminator=replace(base.discriminator, filters=4, max_filters=8, scales=1, layers=1),
    optim=replace(base.optim, steps=3, batch=2),
    run=replace(base.run, name="tiny", log_every=1, save_every=2, picture_every=3),
)
"""
"""Of frames that were rendered: they have labels."""
LOOP = """
from dataclasses import replace
from jaxsim.config import LoopConfig
from labelled import experiment as intensity
from tests.detect.tiny import EXPERIMENT

real = intensity.data
loop = LoopConfig(
    intensity=intensity,
    detector=replace(
        EXPERIMENT,
        data=real,
        optim=replace(EXPERIMENT.optim, epochs=2),
        run=replace(EXPERIMENT.run, log_every=1, save_every=1),
    ),
    synthetic=replace(real, seed=1, streets="suburb", train="0,8", validation="16"),
    kinds=("simulated_grid",),  # without `discover`, which is killed by itself
)
"""
_DETECTOR_FLAGS = (
    *("--data.train=0,8", "--data.validation=0", "--data.cache=cache", "--optim.epochs=3", "--run.log-every=1"),
    *("--run.save-every=1", "--voxels.max-voxels-train=2000", "--voxels.max-voxels=2000", "--augment.sampled=0"),
    *("--detector.train-proposals.after=16", "--detector.roi.rois=8", "--detector.roi.grid=3"),
    *("--detector.backbone.widths", "4", "4", "4", "4", "--detector.backbone.out=4"),
)
_PREPARE = (
    *("prepare", "kitti_raw", "--data.root", "raw", "--data.rows", "elevation", "--train", "0-5"),
    *("--out", "out", "--prepare.depth", "ip_basic_fast", "--prepare.inputs", "rgb", "depth"),
    *("--prepare.image-crop", "12", "40", "--prepare.columns", "64", "--pairs-a-file", "1"),
)
PASSING = {".lock", ".lock.owner", "card.md", "_CHECKPOINT_METADATA", "loop.log"}
"""Files that hold a time or a process, or nothing."""


@dataclass(frozen=True)
class Command:
    """A command line, made to run in a folder of its own where its inputs lie."""

    words: tuple[str, ...]
    results: str
    """Folder of what it writes."""
    inputs: Callable[[Path], None] = lambda work: None
    kept: tuple[str, ...] = ()
    """Folders that a whole run leaves and the attacked ones find: frames that were rendered, which take longest."""
    needs: str = ""
    """A package that is not there everywhere."""


def _text(name: str, content: str) -> Callable[[Path], None]:
    return lambda work: (work / name).write_text(content) and None


def _drive(work: Path) -> None:
    """A drive of small pictures, and settings of a small network that learns from it."""
    (work / "tiny.py").write_text(INTENSITY)
    small_drive(work / "raw", 6)


def _objects(work: Path) -> None:
    small_object(work / "object", 6)


def _sensor(work: Path) -> None:
    """A drive, and a learned sensor that never learned."""
    _drive(work)
    experiment = load_experiment(str(work / "tiny.py"))[0]
    assert isinstance(experiment, Experiment)
    untrained_run(work / "sensor", experiment, view=KittiRaw(work / "raw", rows="elevation")[0].camera)


def _clouds(work: Path) -> None:
    """A detector that never learned, and clouds for it."""
    untrained_detector(work / "detector", replace(DETECTOR, run=replace(DETECTOR.run, name="detector")))
    (work / "clouds").mkdir()
    for k in range(6):
        scene(k).points.astype("<f4").tofile(work / "clouds" / f"{k:06d}.bin")


def _loop(work: Path) -> None:
    (work / "labelled.py").write_text(LABELLED)
    (work / "loop.py").write_text(LOOP)


def _toy_folders(work: Path) -> None:
    """Two folders of polar frames of a flat road, one with gains of its beams."""
    scan, measured = toy(12, gain=0.2)
    frames = {f"{k:03d}": {"scene": f"s{k}", "time": 30.0 * k} for k in range(12)}
    for side in ("simulated", "measured"):
        write_grid(work / side, scan.grid, frames=frames)
    for k, name in enumerate(frames):
        image = PolarImage(*(np.asarray(leaf)[k] for leaf in (scan.range_m, scan.intensity, scan.hit)))
        write_frame(work / "simulated", name, image, semantic=np.asarray(scan.semantic)[k])
        seen = PolarImage(*(np.asarray(leaf)[k] for leaf in (measured.range_m, measured.intensity, measured.valid)))
        write_frame(work / "measured", name, seen)


COMMANDS: dict[str, Command] = {
    "train": Command(("train", "tiny.py"), "runs", _drive),
    "train depth": Command(("train", "depth.py"), "runs", _text("depth.py", DEPTH)),
    "train detector": Command(("train", "voxel_rcnn_small", *_DETECTOR_FLAGS), "runs", kept=("cache",)),
    "prepare": Command((*_PREPARE, "--workers", "2"), "out", _drive),
    "simulate": Command(
        ("simulate", "sensor", "--frames", "0-5", "--out", "out", "--batch", "1"),
        "out",
        _sensor,
    ),
    "export": Command(
        (
            *("export", "--data.kind", "kitti_object", "--data.root", "object", "--data.rows", "elevation"),
            *("--recipe.source", "measured", "--validation", "3", "--out", "out"),
        ),
        "out",
        _objects,
    ),
    "detect": Command(("detect", "detector", "--clouds", "clouds", "--out", "out"), "out", _clouds),
    "discover": Command(
        ("discover", "--measured", "measured", "--simulated", "simulated", "--out", "out"), "out", _toy_folders
    ),
    "ablation": Command(
        ("eval", "ablation", "--train", "labelled.py", "--out", "runs"),
        "runs",
        _text("labelled.py", LABELLED),
        kept=("cache",),
    ),
    "real2sim2real": Command(("real2sim2real", "--config", "loop.py", "--out", "loop"), "loop", _loop, kept=("cache",)),
    "prepare beam": Command(
        (*_PREPARE, "--beam", "runner=DirectRunner", "direct_num_workers=2", "direct_running_mode=multi_threading"),
        "out",
        _drive,
        needs="apache_beam",
    ),
}
"""By what they do."""


def digests(folder: Path) -> dict[str, str]:
    """SHA-256 of every result. Of a checkpoint those that it keeps of its arrays: its files hold times and places."""
    found = {}
    for path in sorted(p for p in folder.rglob("*") if p.is_file() and p.name not in PASSING):
        name = str(path.relative_to(folder))
        if "checkpoints" not in path.parts or "sha256" in path.parts[-2]:
            content = path.read_bytes()
            if path.suffix == ".json" and "seconds" in path.read_text():
                content = json.dumps(_timeless(json.loads(content))).encode()
            if path.suffix == ".html":  # the row of the command's time
                content = re.sub(rb"<dt>time</dt><dd>\d+ s</dd>", b"", content)
            found[name] = hashlib.sha256(content).hexdigest()
    return found


def _timeless(value: object) -> object:
    """JSON without what it took: `seconds` are those of a machine."""
    if isinstance(value, dict):
        return {key: _timeless(one) for key, one in value.items() if "seconds" not in key}
    return [_timeless(one) for one in value] if isinstance(value, list) else value


def fresh(place: Path, *, like: Path | None = None, make: Callable[[Path], None] | None = None) -> Path:
    """A new folder in place of an old one: a copy of `like`, or what `make` makes in it."""
    shutil.rmtree(place, ignore_errors=True)
    if like:
        shutil.copytree(like, place)
    elif make:
        place.mkdir(parents=True)
        make(place)
    return place
