"""Discovery on real sensors: `python -m benchmarks.blind.real_discovery OUT [--root DATA] [--run RUN ...] [--help]`.

DATA (default: JAXSIM_SAMPLE_DATA) holds kitti_raw/, kitti_object/ and ouster/. Two questions with a known part of
their answers:

- Ouster: the photons that the sensor counts (SIGNAL) against its own calibrated REFLECTIVITY as if a simulator had
  made that: what does the calibration undo?
- KITTI: a trained run (`--run`, train.py kitti_raw) against the scans of its own drive and of other drives: what has
  it not learned? And are the gains of the beams, fitted to each half of the scans, the same?

Writes each case's report to OUT/CASE and prints what docs/discover-rates.md quotes.
"""

from __future__ import annotations

import argparse
import os
import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from jaxsim.compilation import enable_compilation_cache
from jaxsim.data import open_dataset, read_pcap
from jaxsim.data.polar_frames import read_grid, write_frame, write_grid
from jaxsim.discover import discover_folders
from jaxsim.discover.model.cast import blocks, with_planes
from jaxsim.discover.model.evidence import gather
from jaxsim.discover.model.fit import Problem, fit
from jaxsim.discover.model.null_model import fit_null, residuals
from jaxsim.discover.model.parameters import to_values
from jaxsim.discover.read import Comparison, read_comparison
from jaxsim.discover.verdict import Verdict
from jaxsim.effects import EFFECTS
from jaxsim.report.discovery import write_report
from jaxsim.simulate.discover_sides import write_both_sides
from jaxsim.simulate.learned_sensor import load

LINEAR = 100
"""Ouster's reflectivity is linear up to this value, and logarithmic above (retroreflectors)."""
PHOTONS = 8192.0
"""Photons that count as intensity 1; a scale is the same to all rays and is fitted."""
FEWEST_RAYS = 50
"""Compared rays of a beam, in each half, from which its gain is looked at."""


def ouster(root: Path, out: Path, nulls: int) -> None:
    """Photons against reflectivity, each recording on its own: two sensors."""
    for recording in sorted((root / "ouster").glob("*.pcap")):
        case = out / recording.stem.split("_")[0]
        (simulated,) = read_pcap(recording)
        (measured,) = read_pcap(recording, intensity="signal", full_scale=PHOTONS)
        value = np.asarray(simulated.image.intensity) * 255
        # What is off the linear scale is left out on both sides.
        counts = np.asarray(simulated.image.valid) & (value > 0.5) & (value < LINEAR + 0.5)
        about = {simulated.name: {"scene": simulated.scene}}
        for side, sweep, scale in (("simulated", simulated, 255 / LINEAR), ("measured", measured, 1.0)):
            image = replace(sweep.image, intensity=np.asarray(sweep.image.intensity) * np.float32(scale), valid=counts)
            write_frame(case / side, sweep.name, image)
            write_grid(case / side, sweep.grid, frames=about)
        print(
            f"\n## {recording.stem}\n\n{counts.sum()} returns of {simulated.image.valid.sum()}: reflectivity 1-{LINEAR}"
        )
        answer(case, nulls)


def kitti(root: Path, out: Path, runs: Sequence[Path], nulls: int) -> None:
    """Each run against frames that it was trained on and others."""
    for run in runs:
        sensor = load(run)
        inputs = ", ".join(sensor.run.experiment.prepare.inputs)
        drives = {
            kind: open_dataset(replace(sensor.run.experiment.data, kind=kind, root=root / kind))
            for kind in ("kitti_raw", "kitti_object")
        }
        held_out = sensor.run.experiment.data.validation
        chosen = {
            f"frames {held_out} of its drive": [("kitti_raw", _numbers(held_out))],
            "other drives": [("kitti_object", range(3))],
            "all": [("kitti_raw", range(6)), ("kitti_object", range(3))],
        }
        for title, parts in chosen.items():
            case = out / f"{run.name}-{title.split()[0]}"
            folders = [write_both_sides(sensor, drives[kind], list(frames), out=case / kind) for kind, frames in parts]
            _join(folders, case)
            print(f"\n## {run.name} ({inputs}): {title}\n")
            answer(case, nulls)
            compared = read_comparison(case / "simulated", case / "measured")
            print(f"row alone explains {100 * row_share(compared):.1f} % of the residuals of ln I on unseen sectors")
            for halves, text in ((_frames(compared), "frames"), (_sectors(compared), "sectors")):
                if halves is not None:
                    print(f"gains of the beams fitted to two halves of the {text}: {agreement(compared, halves)}")


def _join(folders: Sequence[tuple[Path, Path]], case: Path) -> None:
    """One pair of folders of several on one grid. All frames count as one scene: four drives are too few to be units
    of a test, so sectors of azimuth are."""
    for side, name in enumerate(("simulated", "measured")):
        about: dict[str, dict[str, str]] = {}
        for pair in folders:
            (case / name).mkdir(parents=True, exist_ok=True)
            grid, known = read_grid(pair[side])
            about |= {frame: {"scene": "KITTI"} for frame in known}
            for frame in known:
                shutil.copyfile(pair[side] / f"{frame}.npz", case / name / f"{frame}.npz")
            write_grid(case / name, grid, frames=about)


def answer(case: Path, nulls: int) -> Verdict:
    """Discovers, writes the report, and prints the verdict as docs/discover-rates.md has it."""
    result = discover_folders(simulated=case / "simulated", measured=case / "measured", nulls=nulls)
    result.effects_model.save(case / "sensor.json")
    write_report(case, result)
    verdict = result.verdict
    verdict.save(case)
    print(f"{verdict.frames} frames, {verdict.seconds:.0f} s: **{verdict.verdict}**\n")
    print("| effect | look-alikes | nats a sector | p | parameters |\n|---|---|---|---|---|")
    for effect in verdict.effects:
        parameters = ", ".join(f"{name} {_value(value)}" for name, value in effect.parameters.items())
        gain, alike = effect.gain, ", ".join(effect.look_alikes) or "-"
        nats = f"{gain.value:.0f} ({gain.low:.0f}-{gain.high:.0f})"
        print(f"| {effect.name} | {alike} | {nats} | {effect.p_value:.4f} | {parameters} |")
    places = ", ".join(f"{w.channel} on {w.covariate} ({100 * w.share:.1f} %)" for w in verdict.where)
    print(f"\nwhere: {places or 'nowhere'}")
    if verdict.unexplained:
        u = verdict.unexplained
        print(f"unexplained: {u.channel} on {u.covariate}, {u.character}: {u.formula}")
    for channel, gap in verdict.gap.items():
        print(
            f"gap, {channel}: {gap.before:.4f} -> {gap.after:.4f} ({gap.unit}; shrinks by {gap.low:.4f} to "
            f"{gap.high:.4f}), floor {gap.floor:.4f}, placebo {gap.placebo:.4f}"
        )
        if gained := gap.gained:
            print(f"  log-likelihood: {gained.value:+.1f} ({gained.low:.1f} to {gained.high:.1f}) {gained.unit}")
    if verdict.closure:
        print(f"closure: {verdict.closure.value:.2f} ({verdict.closure.low:.2f}-{verdict.closure.high:.2f})")
    rivals = ", ".join(f"{rank.name} {rank.gain:.1f}" for rank in verdict.ranking[:6])
    print(f"first step, nats a sector: {rivals}\n")
    if verdict.nulls:
        drawn = verdict.nulls
        print(
            f"{nulls} nulls, nats a sector: effects gain {max(drawn.gains):.2f} at most, free curves "
            f"{max(drawn.free):.2f}; {drawn.answered} pass the standing bar; bars {drawn.bar:.2f} and "
            f"{drawn.free_bar:.2f}\n"
        )
    return verdict


def _value(value: object) -> str:
    if isinstance(value, tuple):
        numbers = np.array([one.value for one in value])
        return f"sd {numbers.std():.3f}, {numbers.min():+.2f} to {numbers.max():+.2f} {value[0].unit}"
    return f"{value.value:.3g} ({value.low:.3g} to {value.high:.3g}) {value.unit}".rstrip()  # type: ignore


def _problem(compared: Comparison) -> tuple[Problem, np.ndarray, np.ndarray]:
    """The null model on all blocks; each block's frame and its scene."""
    given = jax.tree.map(jnp.asarray, compared.scan)
    measured = jax.tree.map(jnp.asarray, compared.measured)
    scan = with_planes(given)
    chosen = blocks(compared.scenes, *compared.scan.range_m.shape[1:])
    scene = np.unique(chosen.scene, return_inverse=True)[1]
    ev = gather(scan, measured, frame=chosen.frame, column=chosen.column, scene=scene, given_rad=given.incidence_rad)
    return fit_null(scan, ev), chosen.frame, scene


def row_share(compared: Comparison) -> float:
    """Share of the variance of ln I's residuals (standardised, clipped) that the mean of a row, taken from other
    sectors, explains."""
    problem, _, scene = _problem(compared)
    _, z, counts = residuals(problem, problem.ev.all_blocks)["intensity"]
    row = np.broadcast_to(np.asarray(problem.ev.rays.row), counts.shape)
    rows = int(row.max()) + 1
    left, whole = 0.0, 0.0
    for one in np.unique(scene):
        own = counts & (scene == one)[:, None, None]
        rest = counts & ~own
        n = np.bincount(row[rest], minlength=rows)
        mean = np.bincount(row[rest], z[rest], rows) / (n + 4)
        overall = z[rest].mean()
        left += float(((z[own] - mean[row[own]]) ** 2).sum())
        whole += float(((z[own] - overall) ** 2).sum())
    return 1 - left / whole


def agreement(compared: Comparison, half: np.ndarray) -> str:
    """Correlation of the beams' gains fitted to the blocks of each half; `half` holds 0 or 1 a block."""
    problem, _, _ = _problem(compared)
    effect = EFFECTS["beam_gain"]
    gains, rays = [], []
    counts = np.asarray(problem.ev.compared)
    row = np.broadcast_to(np.asarray(problem.ev.rays.row), counts.shape)
    for side in (0, 1):
        found = fit(effect, problem, (half == side).astype(np.float32), steps=80)
        gains.append(np.asarray(to_values(effect, found.z)["gain"]))
        rays.append(np.bincount(row[counts & (half == side)[:, None, None]], minlength=row.max() + 1))
    seen = np.min(rays, axis=0) >= FEWEST_RAYS
    r = np.corrcoef(gains[0][seen], gains[1][seen])[0, 1]
    spread = " and ".join(f"{g[seen].std():.3f}" for g in gains)
    return f"r = {r:.3f} over {seen.sum()} beams with {FEWEST_RAYS} compared rays or more (sd {spread} nats)"


def _frames(compared: Comparison) -> np.ndarray | None:
    """Earlier and later frames; None for fewer than two."""
    frames = len(compared.names)
    place = blocks(compared.scenes, *compared.scan.range_m.shape[1:]).frame
    return None if frames < 2 else (place >= frames // 2).astype(int)


def _sectors(compared: Comparison) -> np.ndarray:
    """Every other sector."""
    scene = blocks(compared.scenes, *compared.scan.range_m.shape[1:]).scene
    return np.unique(scene, return_inverse=True)[1] % 2


def _numbers(text: str) -> list[int]:
    first, last = text.split("-")
    return list(range(int(first), int(last) + 1))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--root", type=Path, default=os.environ.get("JAXSIM_SAMPLE_DATA"), help="folder of the data")
    parser.add_argument(
        "--run", type=Path, nargs="*", default=[], help="trained runs, with and without the row channel"
    )
    parser.add_argument("--only", choices=("ouster", "kitti"), help="one of the two")
    parser.add_argument("--nulls", type=int, default=0, help="set each case's bar on so many nulls drawn from it")
    args = parser.parse_args()
    if args.root is None or not args.root.is_dir():
        parser.error(f"--root {args.root} is no folder; give the one that holds kitti_raw/, kitti_object/ and ouster/")
    if args.only != "ouster" and not args.run:
        parser.error("--run is missing: train one with `python train.py kitti_raw --data.root ROOT/kitti_raw`")
    enable_compilation_cache()
    if args.only != "kitti":
        ouster(args.root, args.out, args.nulls)
    if args.only != "ouster":
        kitti(args.root, args.out, args.run, args.nulls)


if __name__ == "__main__":
    main()
