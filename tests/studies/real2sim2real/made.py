"""A scored loop, clouds and scenes that were made up."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from jaxsim.metrics.cloud_checks import count_clouds
from jaxsim.metrics.detection import DIFFICULTIES, PRINTED_COLUMNS, Curve
from jaxsim.studies.real2sim2real import Loop, claim_loop
from jaxsim.studies.real2sim2real.scores import write_score
from jaxsim.train.experiments import load_loop
from tests.detect.tiny import EXPERIMENT

KINDS = ("raw_64", "simulated_64", "discovered_grid")
CAR = np.array([[10.0, 0.0, -1.0, 4.0, 2.0, 1.5, 0.0]])


MADE_AP = {"raw_64": 40.0, "simulated_64": 55.0, "real": 80.0}


COUNTS = {"real": 0.4, "raw_64": 0.0, "simulated_64": 0.3}


def curves(ap: float) -> list[Curve]:
    """All columns at one average precision; nothing is easy."""
    precision = np.concatenate([[0], np.full(40, ap / 100)])
    return [
        Curve("Car", level, overlap, metric, 0.7, precision, np.zeros(0), np.zeros(0), 0 if level == "easy" else 9, 12)
        for metric, overlap in PRINTED_COLUMNS
        for level in DIFFICULTIES
    ]


def clouds(intensity: float):
    rng = np.random.default_rng(0)
    points = np.column_stack([CAR[0, :3] + rng.uniform(-0.5, 0.5, (90, 3)), np.full(90, intensity)])
    return count_clouds([(points.astype(np.float32), CAR, ("Car",))])


def scored_loop(out: Path) -> Loop:
    """A loop of two kinds, all its detectors scored at three checkpoints, for two seeds."""
    config, _ = load_loop("real2sim2real")
    loop = claim_loop(replace(config, out=out, kinds=("raw_64", "simulated_64"), seeds=(0, 1)))
    for seed in loop.config.seeds:
        for trained, judged in loop.judgements:
            steps = range(3)
            write_score(
                loop.score(trained, judged, seed),
                [curves(MADE_AP[trained] + 2 * seed) for _ in steps],
                steps=steps,
                frames=5,
            )
    return loop


def street(*things, intensity=0.5):
    """A scene of objects (class, distance ahead, points on it), and the road."""
    rng = np.random.default_rng(1)
    boxes = np.array([[x, 0.0, -1.0, 4.0, 2.0, 1.5, 0.0] for _, x, _ in things])
    on = [box[:3] + rng.uniform(-0.5, 0.5, (n, 3)) for box, (_, _, n) in zip(boxes, things, strict=True)]
    road = np.column_stack([rng.uniform(25, 28, 50), rng.uniform(-8, 8, 50), np.full(50, -1.8)])
    xyz = np.concatenate([*on, road])
    points = np.column_stack([xyz, np.full(len(xyz), intensity)]).astype(np.float32)
    return points, boxes, tuple(kind for kind, _, _ in things)


def tiny_loop(out: Path, kinds: tuple[str, ...] = KINDS):
    """Three real and three rendered frames; a network of four filters, and the tests' detector."""
    config, _ = load_loop("real2sim2real")
    real = replace(config.detector.data, train="0,8", validation="20", cache=out.parent / "cache")
    intensity = replace(
        config.intensity,
        data=real,
        prepare=replace(config.intensity.prepare, columns=64, network_size=(64, 128)),
        generator=replace(config.intensity.generator, filters=4, blocks=1, downsamples=2, enhancer_blocks=1),
    )
    detector = replace(EXPERIMENT, data=real, scored="inside", detector=replace(EXPERIMENT.detector, score=0.0))
    synthetic = replace(real, seed=1, streets="suburb")
    return replace(config, intensity=intensity, detector=detector, synthetic=synthetic, kinds=kinds, out=out)
