"""What completed depth does to the intensity network: trained on each method's, judged on the same cells.

    python benchmarks/studies/depth_inputs.py OUT [--methods given ip_basic_fast penet]
        [--penet weights.npz] [--steps 450] [--train 0-959:8] [--judge 1920-2079:4] [--seed 2] [-- FLAGS OF train.py]

For every method `train.py ablation` learns from the same frames of the embedded world with the same settings; what is
painted onto the LiDAR's grid as depth alone differs (`given` is the renderer's). Judged on frames of other streets by
the measured intensity, on the cells that all methods paint and whose beam came back: once with depth of the method that
it was trained on, as on a drive, once with the renderer's, as in simulation. Also how the painted range lies to the
measured one: `painted` is the share of the returned cells that get a depth, `within 2 %` the share of those that are so
near. What is there is not made again. Writes OUT/depth_inputs.json and .jpg, and the runs to OUT.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from denoised_targets import predictions, train

from jaxsim.compilation import enable_compilation_cache
from jaxsim.config import PrepareConfig
from jaxsim.data import open_dataset, select
from jaxsim.files import replacing
from jaxsim.frame import LOST_BELOW, Pair
from jaxsim.metrics import paired_scores, paired_sums
from jaxsim.pairs.prepared import prepared
from jaxsim.report.pictures import intensity_panel, save_picture, strip
from jaxsim.report.results import markdown_table
from jaxsim.train.experiments import load_experiment

NEAR = 0.02


def score(images: Sequence[np.ndarray], pairs: Sequence[Pair], cells: Sequence[np.ndarray]) -> dict[str, float]:
    """mae, rmse, psnr, ssim, drop_iou to the measurement on these cells."""
    parts = [
        paired_sums(image, image < LOST_BELOW, pair.measured.intensity, returned=pair.measured.valid, m=seen)
        for image, pair, seen in zip(images, pairs, cells, strict=True)
    ]
    sums = {key: sum(np.asarray(part[key], np.float64) for part in parts) for key in parts[0]}
    return {name: value.value for name, value in paired_scores(sums).items()}


def painted(pairs: Sequence[Pair]) -> dict[str, float]:
    """How the painted range lies to the measured one."""
    returned = np.stack([pair.measured.valid for pair in pairs])
    seen = np.stack([np.asarray(pair.painted.valid) for pair in pairs]) & returned
    measured = np.stack([np.asarray(pair.measured.range_m) for pair in pairs])[seen]
    range_m = np.stack([np.asarray(pair.painted.range_m) for pair in pairs])[seen]
    near = np.abs(range_m - measured) < NEAR * measured
    return {"painted": float(seen.sum() / returned.sum()), "near": float(near.mean())}


def main(
    out: Path, methods: Sequence[str], penet: Path | None, *, steps: int, train_on: str, judge: str, seed: int,
    more: Sequence[str],
) -> None:  # fmt: skip
    out.mkdir(parents=True, exist_ok=True)
    experiment = load_experiment("ablation")[0]
    data = replace(experiment.data, train=train_on, validation=judge, cache=out / "cache")  # type: ignore
    plain: PrepareConfig = experiment.prepare  # type: ignore
    world = open_dataset(data)
    made, flags = {}, {}
    for name in methods:
        prepare = replace(plain, depth=name, depth_weights=penet if name == "penet" else None)
        flags[name] = ["--prepare.depth", name]
        if prepare.depth_weights is not None:
            flags[name] += ["--prepare.depth-weights", str(prepare.depth_weights.resolve())]
        made[name] = list(prepared(world, [*select(judge, world)], data, prepare=prepare))
    cells = [np.logical_and.reduce([np.asarray(p.painted.valid) for p in same]) for same in zip(*made.values())]  # noqa: B905
    given = list(prepared(world, [*select(judge, world)], data, prepare=plain))

    results: dict[str, dict] = {}
    panels: list[tuple[str, np.ndarray]] = []
    for name in methods:
        run = train(f"{name}_{seed}", out, data, [*flags[name], *more], steps=steps, seed=seed)
        own, rendered = predictions(run, made[name]), predictions(run, given)
        results[name] = {
            **painted(made[name]), "own": score(own, given, cells), "given": score(rendered, given, cells),
        }  # fmt: skip
        print(f"{name}: {results[name]}", flush=True)
        panels.append((f"trained on {name}", intensity_panel(own[0], cells[0])))
        with replacing(out / "depth_inputs.json") as path:
            path.write_text(json.dumps(results, indent=2))
        last = ("measured", intensity_panel(given[0].measured.intensity, given[0].measured.valid))
        save_picture(out / "depth_inputs.jpg", strip([*panels, last], width=756))
    print(table(results))


def table(results: dict[str, dict]) -> str:
    heads = ["depth", "painted", "within 2 %", "own depth: MAE", "PSNR", "renderer's: MAE", "PSNR"]
    rows = []
    for name, row in results.items():
        cells = [f"`{name}`", f"{row['painted']:.3f}", f"{row['near']:.3f}"]
        for part in ("own", "given"):
            cells += [f"{row[part]['mae']:.4f}", f"{row[part]['psnr']:.2f} dB"]
        rows.append(cells)
    return markdown_table(heads, rows)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--methods", nargs="+", default=["given", "ip_basic_fast", "penet"])
    parser.add_argument("--penet", type=Path)
    parser.add_argument("--steps", type=int, default=450)
    parser.add_argument("--train", dest="train_on", default="0-959:8")
    parser.add_argument("--judge", default="1920-2079:4")
    parser.add_argument("--seed", type=int, default=2)
    cut = sys.argv.index("--") if "--" in sys.argv else len(sys.argv)
    arguments = parser.parse_args(sys.argv[1:cut])
    enable_compilation_cache()
    main(**vars(arguments), more=sys.argv[cut + 1 :])
