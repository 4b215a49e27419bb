"""How far draws of a learned sensor scatter, beside the sensor itself: what `jaxsim simulate --draws` adds.

    python -m benchmarks.studies.draws ROOT RUN OUT --frames DRIVES [--still drive_0060] [--seeds 4] [--picture 0]

RUN is a trained run of KITTI's raw drives whose network gives a distribution, ROOT holds `2011_09_26/`. DRIVES are such
as neither the network nor its grain (RUN/grain.json, of the validation frames) was learned from. Measured scatter of
one and the same cell is that of a drive in which the car stands still (--still; its images are not needed), of
neighbours that of the frames themselves.

Each cell is drawn for itself, with its grain, and with its grain where surfaces stay: one key for all draws of a frame
draws what they share, and another key each time what is a cell's own.

Writes OUT/draws.md, .json, and draws.png, a frame measured, as it is most likely, and drawn in both ways.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from functools import partial
from itertools import pairwise
from pathlib import Path

import jax
import numpy as np
from jaxtyping import Bool, Float

import jaxsim
from jaxsim.data import open_dataset, select
from jaxsim.data.clouds import read_scan
from jaxsim.files import files_in
from jaxsim.frame import Pair, PolarImage
from jaxsim.geometry import scan_on_window
from jaxsim.pairs.prepared import prepared
from jaxsim.report.pictures import intensity_panel, save_picture, strip
from jaxsim.report.results import markdown_table, write_results
from jaxsim.simulate.grain import Grain, draw_ranks, read_grain
from jaxsim.simulate.learned_sensor import LearnedSensor
from jaxsim.simulate.predict import Prediction, drawn, make_predict

SAME_M = 0.05
"""Cells whose ranges differ by less are one surface."""
SINGLE, GRAINED, STAYS = "each cell", "with grain", "surfaces stay"
KINDS = ("measured", "most likely", SINGLE, GRAINED, STAYS)
Raster = Float[np.ndarray, "rows columns"]
Mask = Bool[np.ndarray, "rows columns"]


def again(images: Sequence[PolarImage]) -> tuple[list[float], float]:
    """Differences of a cell's intensity from one image to the next, where both came back from one surface; and the
    share of the cells that drop in one that drop in the next, too."""
    differences: list[float] = []
    drops = repeated = 0
    for a, b in pairwise(images):
        both = np.asarray(a.valid & b.valid) & (np.abs(np.asarray(a.range_m) - np.asarray(b.range_m)) < SAME_M)
        differences += np.abs(np.asarray(a.intensity) - np.asarray(b.intensity))[both].tolist()
        lost = ~np.asarray(a.valid)
        drops += int(lost.sum())
        repeated += int((lost & ~np.asarray(b.valid)).sum())
    return differences, repeated / max(drops, 1)


def beside(intensity: Raster, range_m: Raster, valid: Mask) -> Float[np.ndarray, " n"]:
    """Differences of neighbours in a row that came back from one surface."""
    both = valid[:, 1:] & valid[:, :-1] & (np.abs(np.diff(range_m, axis=1)) < SAME_M)
    return np.abs(np.diff(intensity, axis=1))[both]


def still_scans(sensor: LearnedSensor, root: Path, drive: str) -> list[PolarImage]:
    """The scans of a drive on the run's window. Raises ValueError where there are none."""
    folder = root / f"2011_09_26/2011_09_26_{drive}_sync/velodyne_points/data"
    files = files_in(folder, ".bin")
    if len(files) < 2:
        raise ValueError(f"draws: {len(files)} scans in {folder}; name a drive in which the car stands: --still")
    grid, place = sensor.window
    return [scan_on_window(read_scan(f, "file_order"), grid, place, lines=sensor.run.spec.rows) for f in files]


def scatter(sensor: LearnedSensor, grain: Grain, pairs: Sequence[Pair], *, seeds: int) -> dict[str, list[float]]:
    """By what is looked at: neighbours' differences, differences of a cell between two draws, intensities, drops."""
    predict = make_predict(sensor.generate, sensor.run.experiment.prepare)
    draw = jax.jit(partial(drawn_as, grain), static_argnames="kind")
    found: dict[str, list[float]] = {}

    def add(name: str, values: np.ndarray | list[float]) -> None:
        found.setdefault(name, []).extend(np.asarray(values, float).ravel().tolist())

    for k, pair in enumerate(pairs):
        says = predict(sensor.params, pair)
        seen, range_m = np.asarray(pair.painted.valid), np.asarray(pair.painted.range_m)
        measured = np.asarray(pair.measured.intensity)
        came_back = np.asarray(pair.measured.valid) & (measured > 0) & seen
        keys = [jax.random.fold_in(jax.random.key(seed), k) for seed in range(seeds)]
        kinds = {"measured": [(measured, came_back)], "most likely": [_of(says.reported, seen)]}
        for kind in (SINGLE, GRAINED, STAYS):
            stays = jax.random.fold_in(jax.random.key(seeds), k) if kind == STAYS else None
            kinds[kind] = [_of(draw(says, pair, key, kind=kind, stays=stays), seen) for key in keys]
            differences, repeated = again([PolarImage(range_m, *image) for image in kinds[kind]])
            add(f"{kind}: again", differences)
            add(f"{kind}: drops again", [repeated])
        for name, images in kinds.items():
            for intensity, valid in images:
                add(f"{name}: neighbours", beside(intensity, range_m, valid))
                add(f"{name}: intensities", intensity[valid])
                add(f"{name}: drops", [1 - valid[seen].mean()])
                add(f"{name}: ends", (valid[:, 1:] != valid[:, :-1])[seen[:, 1:] & seen[:, :-1]])
    return found


def drawn_as(
    grain: Grain, says: Prediction, pair: Pair, key: jax.Array, *, kind: str, stays: jax.Array | None = None
) -> jax.Array:
    """One draw of a frame."""
    ranks = None if kind == SINGLE else draw_ranks(grain, pair.painted, key, stays=stays)
    return drawn(says, key, ranks)


def _of(reported: object, seen: Mask) -> tuple[Raster, Mask]:
    intensity = np.asarray(reported)
    return intensity, (intensity > 0) & seen


def picture(sensor: LearnedSensor, grain: Grain, pair: Pair) -> np.ndarray:
    """A frame measured, as it is most likely, and drawn in both ways."""
    says = make_predict(sensor.generate, sensor.run.experiment.prepare)(sensor.params, pair)
    seen, measured = np.asarray(pair.painted.valid), np.asarray(pair.measured.intensity)
    panels = [("measured", intensity_panel(measured, np.asarray(pair.measured.valid) & (measured > 0) & seen))]
    panels.append(("most likely (jaxsim simulate)", intensity_panel(*_of(says.reported, seen))))
    for kind, flags in ((SINGLE, "--draws --no-grain"), (GRAINED, "--draws")):
        image = _of(drawn_as(grain, says, pair, jax.random.key(0), kind=kind), seen)
        panels.append((f"drawn (jaxsim simulate {flags})", intensity_panel(*image)))
    return strip(panels)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("root", type=Path)
    parser.add_argument("run", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--frames", required=True)
    parser.add_argument("--still", default="drive_0060")
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--picture", type=int, default=0)
    given = parser.parse_args()
    sensor, grain = jaxsim.load(given.run), read_grain(given.run)
    experiment = sensor.run.experiment
    dataset = open_dataset(experiment.data)
    pairs = prepared(dataset, select(given.frames, dataset), experiment.data, prepare=experiment.prepare)
    if known := {*grain.scenes} & {*pairs.scenes}:
        raise ValueError(f"draws: the grain was learned from {', '.join(sorted(known))}; judge other drives: --frames")
    found = scatter(sensor, grain, pairs, seeds=given.seeds)
    still, still_drops = again([_dark_lost(image) for image in still_scans(sensor, given.root, given.still)])
    found |= {"measured: again": still, "measured: drops again": [still_drops]}
    looked_at = (
        ("the same cell once more, difference of intensity, mean", "again", np.mean),
        ("neighbours on one surface, difference of intensity, mean", "neighbours", np.mean),
        ("all intensities, standard deviation", "intensities", np.std),
        ("share of cells that drop", "drops", np.mean),
        ("a cell that drops drops once more", "drops again", np.mean),
        ("of two neighbours in a row one drops", "ends", np.mean),
    )
    rows = [[name, *(_cell(found, f"{kind}: {key}", of) for kind in KINDS)] for name, key, of in looked_at]
    heads = ["measured", "most likely", f"drawn ({given.seeds} times), {SINGLE}", GRAINED, f"{GRAINED}, {STAYS}"]
    text = markdown_table(["", *heads], rows)
    plain = {name: {"mean": float(np.mean(v)), "median": float(np.median(v)), "n": len(v)} for name, v in found.items()}
    save_picture(given.out / "draws.png", picture(sensor, grain, pairs[given.picture]))
    print(text)
    print(write_results(given.out, "draws", plain, text=text))


def _dark_lost(image: PolarImage) -> PolarImage:
    """Returns of intensity 0 as drops, as the network counts them."""
    return image.replace(valid=np.asarray(image.valid) & (np.asarray(image.intensity) > 0))  # type: ignore[attr-defined]


def _cell(found: dict[str, list[float]], name: str, of: object) -> str:
    return f"{of(found[name]):.3f}" if name in found else "-"  # type: ignore[operator]


if __name__ == "__main__":
    main()
