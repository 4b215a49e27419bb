"""Readers of files that jaxsim writes, or asks others to write: frames, runs, weights, answers, records, caches."""

from __future__ import annotations

import errno
import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from jaxsim.cloud.kitti_tree import TreeRecord
from jaxsim.config import DataConfig, DepthExperiment, DetectorExperiment, Experiment, LoopConfig, PrepareConfig
from jaxsim.data.clouds import read_cloud
from jaxsim.data.logs.range_images import read_range_images
from jaxsim.data.polar_frames import open_polar_frames, read_grid, write_frame, write_grid
from jaxsim.data.prepared_set import PreparedSet
from jaxsim.data.records import PairRecord, example_of, kept_of
from jaxsim.data.tfds_builder import About, JaxsimPairs, Shard, SplitPairs, serialized
from jaxsim.detect.scenes import Scene, View, read_scene, write_scene
from jaxsim.discover.gate import read_gate
from jaxsim.discover.law.source import read_law, write_effect
from jaxsim.effects import EFFECTS
from jaxsim.effects.chain import SensorModel
from jaxsim.effects.learned import Learned
from jaxsim.effects.own import known_effects, write_template
from jaxsim.files import claim, read_entry, write_arrays
from jaxsim.frame import Camera, Painted, Pair, PolarGrid, PolarImage
from jaxsim.geometry import preset
from jaxsim.metrics.frechet import halves, load_halves, save_halves
from jaxsim.pairs.prepared import pairs_fingerprint, pairs_folder, prepared
from jaxsim.pairs.shards import MadePair, read_note, write_shard
from jaxsim.runs.frames import RunFrames, read_frames, write_frames
from jaxsim.runs.kinds import DepthRun, DetectorRun, Run
from jaxsim.runs.metrics_log import LARGEST, MetricsLog, read_metrics
from jaxsim.runs.run import Checkpoints, load_run, start_run
from jaxsim.simulate.folder import claim_frames
from jaxsim.studies.real2sim2real.charts import checked_kinds
from jaxsim.studies.real2sim2real.scores import Scored
from jaxsim.train.experiments import load_loop, read_experiment
from jaxsim.weights import ABOUT, Converter, checked_arrays, convert, load_weights
from tests.fuzz.reader import Reader, one

_rng = np.random.default_rng(1)
R, C = 4, 8
GRID = PolarGrid(np.linspace(0.3, -0.3, C, dtype="f4"), np.linspace(0.1, -0.2, R, dtype="f4"), np.zeros(R, "f4"))
SHAPES = {"a.weight": (3, 4), "a.bias": (4,)}
CONVERTER = Converter("a network of two arrays", "it somewhere", lambda arrays: checked_arrays(arrays, SHAPES))
WEIGHTS = {name: _rng.normal(size=shape).astype("f4") for name, shape in SHAPES.items()}
TREE = {"step": np.int32(3), "w": _rng.normal(size=(16, 16)).astype("f4")}
BOUNDS = {"range_m": (0.0, 1e4), "intensity": (0.0, 1.0), "xyz_m": (-1e4, 1e4)}


def _image() -> PolarImage:
    range_m, intensity = _rng.uniform(3, 60, (R, C)).astype("f4"), _rng.uniform(0, 1, (R, C)).astype("f4")
    return PolarImage(range_m, intensity, np.ones((R, C), bool))


def _polar(folder: Path) -> None:
    about = {"time": 1.0, "speed": 9.0, "heading": 0.1, "scene": "x", "tags": ["night", "rain"]}
    write_grid(folder, GRID, frames={"a": about})
    rasters = {"semantic": np.full((R, C), 7), "rgb": np.full((R, C, 3), 90.0, "f4")}
    write_frame(folder, "a", _image(), incidence=np.full((R, C), 0.4, "f4"), **rasters)


def _read_polar(folder: Path) -> Any:
    frames = open_polar_frames(folder)
    return frames.grid, frames.about, [frames.read(name) for name in frames.names]


def _npz(name: str, **arrays: Any):
    def make(folder: Path) -> None:
        np.savez(folder / name, **arrays)

    return make


def _record(position: int) -> PairRecord:
    far, ids, all_of = np.full((R, C), 9.0, "f4"), np.zeros((R, C), "i4"), np.ones((R, C), bool)
    painted = Painted(far, far, np.full((R, C, 3), 0.5, "f4"), ids, ids, all_of, all_of)
    pair = Pair(painted, far / 30, far / 18, far / 45, _image())
    camera = Camera(np.diag([700.0, 700, 1]), np.eye(4))
    return PairRecord(f"f{position}", "x", position, pair, np.zeros((R, C), bool), GRID, camera, (12, 40))


DATA, PREPARE = DataConfig(), PrepareConfig(inputs=("rgb", "depth"), columns=C)


def _pairs(folder: Path) -> None:
    target = folder / pairs_fingerprint(DATA, PREPARE)
    target.mkdir(parents=True)
    write_arrays(target / f"{_record(0).name}.npz", kept_of(_record(0)))


class _Gone:
    """Frames that are asked for where a kept pair is not there: it would be made anew."""

    spec = preset("hdl64e")

    def __init__(self, cache: Path):
        self.cache = cache

    def __getitem__(self, position: int) -> Any:
        raise FileNotFoundError(errno.ENOENT, "no kept pair", str(self.cache))

    def name_of(self, position: int) -> str:
        return f"f{position}"


def _read_pairs(folder: Path) -> Any:
    (found,) = folder.iterdir()
    wanted = pairs_folder(DataConfig(cache=folder), PREPARE)
    assert found == wanted, "the settings of the cache have another name"
    pairs = prepared(_Gone(found), [0], DataConfig(cache=folder), prepare=PREPARE)
    return pairs.entries, pairs[0]


def _set(folder: Path) -> None:
    place = folder / "jaxsim_pairs" / "synthetic" / "1.0.0"
    shard = Shard("train", 0, 1, (0, 1))
    records = [serialized(example_of(_record(k))) for k in (0, 1)]
    made = [MadePair(records[k], f"f{k}", "x", (R, C), labelled=False, pictured=True) for k in (0, 1)]
    write_shard(shard, place, made)
    note = read_note(shard, place)
    assert note is not None
    settings = {"data": {"kind": "synthetic", "root": None}, "prepare": {}}
    split = SplitPairs((0, 1), ("f0", "f1"), ("x", "x"), ((R, C), (R, C)))
    files = {shard.file(place).name: note["bytes"]}
    about = About("0", settings, "x", preset("hdl64e"), 2, {"train": (0, 1)}, {"train": split}, files)
    JaxsimPairs(data_dir=folder, kind="synthetic", shards=[shard], about=about).write_metadata(place)


def _read_set(folder: Path) -> Any:
    opened = PreparedSet(folder)
    about = opened.about
    return about.length, about.splits, about.spec.rows, opened.pairs([0, 1], PREPARE_OF_SET)[1]


PREPARE_OF_SET = PrepareConfig()


def _scene(folder: Path) -> None:
    points = np.column_stack([_rng.uniform(-40, 40, (30, 3)), _rng.uniform(0, 1, 30)]).astype("f4")
    view = View(np.eye(3), np.eye(4), rect_from_velo=np.eye(4), size=(12, 40))
    boxes = np.array([[10, 1, -1, 4, 2, 1.5, 0.1]], "f4")
    write_scene(folder / "s.npz", Scene("a", points, boxes, np.ones(1, bool), np.zeros(1, int), view, None, None))


def _run(folder: Path, run: Any) -> None:
    start_run(folder, run)
    (folder / ".lock").unlink(missing_ok=True)


def _sensor_run() -> Run:
    eye = tuple(map(tuple, np.eye(4).tolist()))
    return Run(Experiment(), preset("hdl64e"), tuple(row[:3] for row in eye[:3]), eye, (12, 40))


def _checkpoint(folder: Path) -> None:
    Checkpoints(folder).save(3, state=TREE)


def _metrics(folder: Path) -> None:
    log = MetricsLog(folder, 0)
    for step in (1, 2, 3):
        log.write(step, {"loss/gan": 0.5, "seconds": 1.0})
    log.write(3, {"validation/mae": 0.1})


def _read_metrics(folder: Path) -> Any:
    log = MetricsLog(folder, 2)
    judged = [log.validated(step) for step in (1, 2, 3)]
    return judged, read_metrics(log.path)


def _read_statistics(folder: Path) -> Any:
    """Statistics that are not there are made anew."""
    found = load_halves(folder / "s.npz", extractor="e", data="d")
    if found is None:
        raise FileNotFoundError(errno.ENOENT, "no statistics", str(folder))
    return found


def _converted(folder: Path) -> Any:
    return convert("toy", CONVERTER, folder / "w.npz", out=folder / "out.npz").arrays


def _law() -> str:
    numbers = {"level": 0.2, "size": 0.1, "period": 5.0, "phase": 0.3}
    entry = {
        "channel": "intensity",
        "covariates": ["range"],
        "formula": "0.2 + 0.1·sin(2·π·range_m / 5 + 0.3)",
        "expression": "level + size * sin(2 * pi * range_m / period + phase)",
        "parameters": {key: {"value": v, "low": v - 0.1, "high": v + 0.1, "unit": "m"} for key, v in numbers.items()},
        "limits": {"range_m": [2.0, 80.0]},
        "nodes": 3,
        "held_out_nats": 12.5,
        "share": 0.9,
    }
    return json.dumps({"law": entry, "verdict": "none"})


def _read_law(folder: Path) -> Any:
    """The law, and whether the file that it becomes is Python."""
    law = read_law(folder / "verdict.json")
    path = write_effect(law, folder / "mine.py")
    compile(path.read_bytes(), path, "exec")
    return law


def _own_effect(folder: Path) -> None:
    write_template("own_effect", folder / "own.py")
    of = {"file": "own.py", "sha256": hashlib.sha256((folder / "own.py").read_bytes()).hexdigest()}
    entry = {"name": "own_effect", "parameters": {"share": 0.5}, "from": of, "where": {"tag": "night"}}
    one("sensor.json", json.dumps({"effects": [entry]}))(folder)


def _read_own_effect(folder: Path) -> Any:
    """A sensor with an effect of one's own, which no later reader knows."""
    before = dict(EFFECTS)
    try:
        known_effects([folder / "own.py"])
        model = SensorModel.load(folder / "sensor.json", rows=R)
        return [*EFFECTS], model.effects, model.regions
    finally:
        EFFECTS.clear()
        EFFECTS.update(before)


def _read_export(folder: Path) -> Any:
    record = TreeRecord.open(folder, {"a": 1})
    record.check_names(folder, {"000000": "x"})
    return record.frames, record.has(folder, "000000")


_SCORED = {"step": 1, "ap_r40": {"3d 0.7 easy": 61.5, "bev 0.7 hard": None}, "labels": {"easy": 7, "hard": 0}}


def _claimed(name: str, text: str, made: dict[str, Any]) -> Reader:
    """A record of settings, as commands read it before they go on in a folder."""
    return Reader(one(name, text), lambda f: claim(f / name, made, by="test", filled=True), (name,))


def _gate(folder: Path) -> None:
    baseline = {"verdict": "effects", "effects": [{"name": "beam_gain"}], "gap": {"intensity": {"before": 0.1}}}
    one("verdict.json", json.dumps(baseline))(folder)
    gate = {"thresholds": {"intensity": 0.1}, "allowed": ["random_dropout"], "baseline": "verdict.json"}
    one("gate.json", json.dumps(gate))(folder)


def _range_images(folder: Path) -> None:
    scan = np.concatenate([_rng.uniform(-40, 40, (R, C, 3)), _rng.uniform(0, 1, (R, C, 1))], axis=2)
    scan = np.concatenate([scan, np.linalg.norm(scan[..., :3], axis=2, keepdims=True), np.ones((R, C, 1))], axis=2)
    np.savez(folder / "a.npz", scan=scan.astype("f4"))


def _export(folder: Path) -> None:
    TreeRecord({"a": 1}, {"000000": {"name": "x", "left_out": ""}}).save(folder)
    one("training/velodyne/000000.bin", b"x")(folder)


def _loop_file() -> str:
    return TypeAdapter(LoopConfig).dump_json(LoopConfig()).decode()


_LEARNED = (
    Learned("intensity", "curve", ("range",), ((1.0, 2.0, 4.0),), (0.1, -0.2, 0.3), (0.01,) * 3),
    Learned("drop", "product", ("row", "azimuth"), ((0.0, 3.0), (-1.0, 1.0)), (0.0, 0.1, 0.2, 0.3), (0.0,) * 4),
    Learned("range", "wave", ("column",), ((0.25,),), (0.05, -0.02), (0.001, 0.001)),
)
_SENSOR = {
    "effects": [
        {
            "name": "beam_gain",
            "parameters": {"gain": [0.1, -0.1, 0.05, 0.0]},
            "where": {"azimuth_rad": [0.5, 1.25], "time_s": [None, 40.0]},
        },
        {"name": "range_scale", "parameters": {}, "where": {"tag": "night"}},
        {"name": "random_dropout", "parameters": {"probability": 0.1}, "where": {"scenes": ["a", "b"]}},
    ],
    "levels": {"range_noise": 0.02, "random_loss": 0.1},
    "learned": [law.to_json() for law in _LEARNED],
}
_FILES = ("config.json",)

MADE: dict[str, Reader] = {
    "polar frames": Reader(_polar, _read_polar, within=BOUNDS),
    "grid.json": Reader(_polar, read_grid, ("grid.json",), largest=1e10),
    "cloud npz": Reader(
        _npz("a.npz", xyz=_rng.uniform(-40, 40, (30, 3)).astype("f4"), intensity=_rng.uniform(0, 1, 30).astype("f4")),
        lambda f: read_cloud(f / "a.npz"),
        largest=1e3,
    ),
    "weights": Reader(
        lambda f: write_arrays(f / "w.npz", WEIGHTS | {ABOUT: np.array('{"kind": "toy", "published": false}')}),
        lambda f: load_weights(f / "w.npz", "toy", CONVERTER),
        sealed=True,
    ),
    "state dict": Reader(_npz("w.npz", **WEIGHTS), _converted, largest=1e38),
    "sensor.json": Reader(
        one("sensor.json", json.dumps(_SENSOR, indent=1)), lambda f: SensorModel.load(f / "sensor.json", rows=R)
    ),
    "verdict.json": Reader(one("verdict.json", _law()), _read_law, largest=1e12),
    "own effect": Reader(_own_effect, _read_own_effect),
    "config.json": Reader(lambda f: _run(f, _sensor_run()), load_run, _FILES, largest=1e12),
    "config.json, detector": Reader(
        lambda f: _run(f, DetectorRun(DetectorExperiment(), 9, 2)),
        lambda f: load_run(f, DetectorRun),
        _FILES,
        largest=1e12,
    ),
    "config.json, depth": Reader(
        lambda f: _run(f, DepthRun(DepthExperiment())), lambda f: load_run(f, DepthRun), _FILES, largest=1e12
    ),
    "frames.json": Reader(lambda f: write_frames(f, RunFrames(("a-0", "a-1"), ("b-0",))), read_frames),
    "experiment": Reader(
        lambda f: _run(f, _sensor_run()), lambda f: read_experiment(f / "config.json"), _FILES, largest=1e12
    ),
    "loop.json": Reader(one("loop.json", _loop_file()), lambda f: load_loop(str(f / "loop.json")), largest=1e12),
    "checkpoint": Reader(_checkpoint, lambda f: Checkpoints(f).restore("state", TREE), sealed=True),
    "metrics.jsonl": Reader(_metrics, _read_metrics, ("metrics.jsonl",), largest=LARGEST),
    "scene": Reader(_scene, lambda f: read_scene(f / "s.npz"), sealed=True),
    "pair cache": Reader(_pairs, _read_pairs, sealed=True),
    "prepared set": Reader(_set, _read_set, within=BOUNDS),
    "statistics": Reader(
        lambda f: save_halves(f / "s.npz", halves([_rng.normal(size=(9, 3))]), extractor="e", data="d"),
        _read_statistics,
        sealed=True,
    ),
    "simulation.json": Reader(
        one("simulation.json", '{"sensor": "x", "data": "y", "seed": 0, "source": {"seed": 3}}'),
        lambda f: (
            one("polar/a.npz", b"")(f),
            claim_frames(f, fingerprint="x", data="y", seed=0, source={"seed": 3}),
        )[1:],
        ("simulation.json",),
    ),
    "record of settings": _claimed("plan.json", '{"a": 1, "b": [1, 2]}', {"a": 1, "b": [1, 2]}),
    "export.json": Reader(_export, _read_export, ("export.json",)),
    "scores": Reader(
        one("s.json", json.dumps({"checkpoints": [_SCORED]})),
        lambda f: read_entry(f / "s.json", "checkpoints", list[Scored], by="test"),
        largest=1e12,
    ),
    "gate.json": Reader(_gate, lambda f: read_gate(f / "gate.json"), largest=1e12),
    "range images": Reader(_range_images, read_range_images, within={**BOUNDS, "range_m": (0.0, 1e3)}, largest=1e3),
    "clouds.json": Reader(one("clouds.json", '{"clouds": ["real", "simulated"], "classes": {}}'), checked_kinds),
    "note of a shard": Reader(
        lambda f: (_set(f), None)[1],
        lambda f: read_note(Shard("train", 0, 1, (0, 1)), f / "jaxsim_pairs/synthetic/1.0.0"),
        ("**/done/*.json",),
    ),
}
"""By what they read."""
