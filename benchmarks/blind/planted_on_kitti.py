"""Effects planted on real KITTI scans: `python -m benchmarks.blind.planted_on_kitti OUT [--root DATA] [--help]`.

DATA (by default $JAXSIM_SAMPLE_DATA) holds kitti_raw/, kitti_object/ and semantickitti/ in those sets' own layouts, or
is KITTI raw's folder of dates. Each full scan of another drive counts: the first raw frame of each drive, all object
frames, each SemanticKITTI sequence's first. A scan is put onto the HDL-64E's polar grid and cut into four quarters of
90 degrees less a guard of 5 degrees on either side; a quarter is one frame and one scene, turned so that its middle
lies ahead. Five scans make 20 scenes: less independent than 20 drives, since quarters share sensor and street.

What the scan says, with its hundredths of intensity spread evenly over their step, is the simulated frame; the
measured one is the same with an effect of benchmarks/blind/hidden (NumPy; nothing of jaxsim.effects), noise of
intensity and range, a gain and a few lost returns. There are no classes, and no errors of pose; effects that move rays
or act on classes cannot be planted. With `--simulator noisy` the simulated side has noise of its own, 6 % and 0.008 of
intensity in 256 steps, 1.5 cm, a ray in a hundred lost, and the sensor has the same. With `--simulator patches` or
`trees` it is a digital twin of the scans (twins.py).

One line a case in OUT/cases.jsonl; the same command again goes on. Prints the table that docs/discover-rates.md quotes.
"""

from __future__ import annotations

import argparse
import os
import shutil
import time
import zlib
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.blind.hidden import case_name, score
from benchmarks.blind.hidden.frames import Grid
from benchmarks.blind.hidden.replay import Scan, list_plantable, plant_on, simulated_of
from benchmarks.blind.hidden.simulator import SIMULATORS
from benchmarks.blind.rows import code_version, run_cases
from benchmarks.blind.tables import coverage, rate
from benchmarks.blind.twins import TWINS
from jaxsim.compilation import enable_compilation_cache
from jaxsim.data.kitti_files import read_velodyne
from jaxsim.data.polar_frames import write_frame, write_grid
from jaxsim.discover import discover_folders
from jaxsim.frame import INTENSITY_STEP, Cloud, PolarGrid, PolarImage
from jaxsim.geometry import fit_beams, full_grid, points_to_polar, preset, recover_rows

COLUMNS = 1024
QUARTERS = 4
GUARD_RAD = np.deg2rad(5.0)


def scan_files(root: Path) -> dict[str, Path]:
    """One scan a drive, by name. Raises ValueError where `root` holds none."""
    found = {}
    for drive in sorted([*root.glob("kitti_raw/*/*_sync"), *root.glob("*/*_sync")]):
        files = sorted((drive / "velodyne_points" / "data").glob("*.bin"))
        found |= {f"raw {drive.name}": files[0]} if files else {}
    found |= {f"object {p.stem}": p for p in sorted(root.glob("kitti_object/training/velodyne/*.bin"))}
    for sequence in sorted(root.glob("semantickitti/sequences/*")):
        files = sorted((sequence / "velodyne").glob("*.bin"))
        found |= {f"sequence {sequence.name}": files[0]} if files else {}
    if not found:
        raise ValueError(
            f"planted_on_kitti: {root} holds no kitti_raw/DATE/*_sync, DATE/*_sync, kitti_object/training/velodyne "
            "or semantickitti/sequences; pass the folder above them as --root, or set JAXSIM_SAMPLE_DATA"
        )
    return found


def whole_turns(files: Mapping[str, Path], columns: int) -> tuple[PolarGrid, dict[str, PolarImage]]:
    """HDL-64E scans on one grid of the whole turn, whose beams are fitted to the first."""
    spec, images = preset("hdl64e"), {}
    clouds = {name: read_velodyne(path) for name, path in files.items()}
    rows = {name: recover_rows(xyz, lines=spec.rows, spec=spec) for name, (xyz, _) in clouds.items()}
    first = next(iter(clouds))
    grid = full_grid(fit_beams(clouds[first][0], rows[first], lines=spec.rows, name="hdl64e of these scans"), columns)
    for name, (xyz, intensity) in clouds.items():
        cloud = Cloud(xyz, intensity, np.ones(len(xyz), bool), rows[name])
        images[name] = points_to_polar(cloud, grid)[0]
    return grid, images


def quarters(files: Mapping[str, Path]) -> tuple[PolarGrid, dict[str, Scan]]:
    """The grid of a quarter, and every scan's quarters by name."""
    grid, images = whole_turns(files, COLUMNS)
    azimuth, width = np.asarray(grid.azimuth_rad, float), COLUMNS // QUARTERS
    guard = int(np.ceil(GUARD_RAD / (azimuth[0] - azimuth[1])))
    inner = slice(guard, width - guard)
    own = azimuth[:width][inner]
    middle = own.mean()
    found = {}
    for name, image in images.items():
        rng = np.random.default_rng(list(name.encode()))
        range_m, valid = np.asarray(image.range_m, float), np.asarray(image.valid)
        spread = np.asarray(image.intensity) + INTENSITY_STEP * (rng.random(valid.shape) - 0.5)
        # A reading of 0 lies in the upper half of its step.
        intensity = np.clip(np.where(spread > 0, spread, -spread), 1e-4, 1)
        for k in range(QUARTERS):
            part = (slice(None), slice(k * width + inner.start, k * width + inner.stop))
            turn = float(np.angle(np.exp(1j * (azimuth[:width][inner].mean() - k * 2 * np.pi / QUARTERS))))
            there = valid[part]
            found[f"{name} quarter {k}"] = Scan(
                np.where(there, range_m[part], 0.0), np.where(there, intensity[part], 0.0), turn
            )
    beams = np.asarray(grid.elevation_rad, np.float32)
    return PolarGrid((own - middle).astype(np.float32), beams, np.asarray(grid.origin_m, np.float32)), found


def run_case(
    grid: PolarGrid, scenes: dict[str, Scan], job: tuple[str, float, int], *, simulator: str, folder: Path
) -> dict[str, Any]:
    """Plants an effect of a severity by a seed, lets `discover` answer, and scores."""
    effect, severity, seed = job
    plain = Grid(np.asarray(grid.azimuth_rad, float), np.asarray(grid.elevation_rad, float))
    # A twin's errors are in it; the sensor's own noise is then what it is beside an ideal simulator.
    errors, scans = SIMULATORS["ideal" if simulator in TWINS else simulator], list(scenes.values())
    measured, key = plant_on(scans, plain, effect=effect, severity=severity, seed=seed, simulator=errors)
    if simulator in TWINS:
        simulated = TWINS[simulator](scenes, plain, seed=seed)
    else:
        simulated = [simulated_of(scan, errors, seed=seed, number=k) for k, scan in enumerate(scans)]
    if folder.exists():
        shutil.rmtree(folder)
    about = {f"{k:04d}": {"scene": name, "heading": scan.heading_rad} for k, (name, scan) in enumerate(scenes.items())}
    for part in ("simulated", "measured"):
        write_grid(folder / part, grid, frames=about)
    for part, frames in (("simulated", simulated), ("measured", measured)):
        for name, frame in zip(about, frames, strict=True):
            range_m, intensity = (frame[channel].astype(np.float32) for channel in ("range", "intensity"))
            write_frame(folder / part, name, PolarImage(range_m, intensity, range_m > 0))
    began = time.monotonic()
    verdict = discover_folders(simulated=folder / "simulated", measured=folder / "measured").verdict
    verdict.save(folder / "out")
    closure = verdict.closure.value if verdict.closure else None
    for part in ("simulated", "measured"):
        shutil.rmtree(folder / part)
    return {
        "key": f"{effect} {severity:g} {seed}",
        "settings": settings_of(scenes, simulator),
        "code": code_version(),
        "seconds": round(time.monotonic() - began, 1),
        **score(key, verdict.to_json()),
        "look_alikes": [list(claim.look_alikes) for claim in verdict.effects],
        "closure": closure,
        "notes": list(verdict.notes),
        "gained": {name: [gap.gained.value, gap.gained.low] for name, gap in verdict.gap.items() if gap.gained},
    }


def settings_of(scenes: Mapping[str, Scan], simulator: str) -> dict[str, Any]:
    """What rows of one run share; rows without a simulator are those of an ideal one."""
    return {"scenes": list(scenes)} | ({} if simulator == "ideal" else {"simulator": simulator})


def summary(rows: Sequence[dict[str, Any]]) -> str:
    """The answers case by case, and the rates."""
    lines = ["| planted | severity | answer | look-alikes | judge scenes gain | closure |", "|---|---|---|---|---|---|"]
    for row in sorted(rows, key=lambda row: (row["kind"], row["truth"], row["severity"])):
        alike = ", ".join(name for names in row["look_alikes"] for name in names) or "-"
        closure = "-" if row["closure"] is None else f"{row['closure']:.2f}"
        answer = " + ".join(row["answer"]) or row["verdict"]
        planted = ", ".join(row["truth"]) or "none"
        gained = sum(value for value, _ in row["gained"].values())
        lines.append(f"| {planted} | {row['severity']:g} | {answer} | {alike} | {gained:.1f} | {closure} |")
    single = [row for row in rows if row["kind"] == "single"]
    null = [row for row in rows if row["kind"] == "none"]
    lines += ["", "| measure | value (95 % interval) |", "|---|---|"]
    lines.append(f"| right name first | {rate(row['first_right'] for row in single)} |")
    lines.append(f"| in the set | {rate(row['in_set'] for row in single)} |")
    right = [max(low for _, low in row["gained"].values()) > 0 for row in single if row["exact"]]
    lines.append(f"| rightly named: the judge scenes' likelihood gains for certain (90 %) | {rate(right)} |")
    lines.append(f"| nothing planted: an effect named | {rate(row['named'] for row in null)} |")
    found = [p for row in single for p in row["parameters"]]
    if found:
        error = [p["relative_error"] for p in found if p["relative_error"] is not None]
        lines.append(f"| 90 % intervals that cover | {coverage(found)} parameters |")
        lines.append(f"| median relative error | {100 * np.median(error):.0f} % |")
    return "\n".join(lines)


def plan(
    effects: Sequence[str], severities: Sequence[float], nulls: int, seed: int
) -> Iterator[tuple[str, float, int]]:
    for severity in severities:
        yield from ((effect, severity, seed) for effect in effects)
    yield from (("none", 1.0, seed + k) for k in range(nulls))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--root", type=Path, default=os.environ.get("JAXSIM_SAMPLE_DATA"), help="folder of the sets")
    parser.add_argument("--effects", nargs="+", default=list_plantable(), help="default: all that can be planted")
    parser.add_argument("--severity", type=float, nargs="+", default=[4.0])
    parser.add_argument("--nulls", type=int, default=10)
    parser.add_argument(
        "--simulator", choices=[*SIMULATORS, *TWINS], default="ideal", help="errors of the simulated side's own"
    )
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    if args.root is None:
        parser.error("give --root DATA, or set JAXSIM_SAMPLE_DATA")
    enable_compilation_cache()
    grid, scenes = quarters(scan_files(Path(args.root)))
    print(f"{len(scenes)} scenes of {len(grid.elevation_rad)} x {len(grid.azimuth_rad)} rays: {', '.join(scenes)}")
    cases = {}
    for job in plan(args.effects, args.severity, args.nulls, args.seed):
        effect, severity, seed = job
        key = f"{effect} {severity:g} {seed}"
        folder = args.out / "cases" / case_name(zlib.crc32(key.encode()))
        cases[key] = partial(run_case, grid, scenes, job, simulator=args.simulator, folder=folder)
    run_cases(args.out, cases, summary=summary, settings=settings_of(scenes, args.simulator))


if __name__ == "__main__":
    main()
