"""Real scans of one sensor on both sides, where nothing is missing: `python -m benchmarks.blind.real_nulls OUT`.

DRIVES (--root) holds KITTI raw drives, DATE/DATE_drive_NUMBER_sync, of full scans. Three questions are asked of them:

    still    drive --still, whose car stands: its scans in pairs, one of each as the simulation of the other. What
             differs is the sensor's own noise, and what moves in the street.
    later    drives whose cars move: pairs of scans at most --later seconds apart, the first as the simulation of the
             second. What differs is also where the car stood.
    streets  `--unpaired`: drives dealt to two sides at random, --splits times. What differs is the streets.

Every answer but *none* is wrong, and levels of noise are those of the sensor against itself. With `--plant EFFECT ...`
an effect of benchmarks/blind/hidden is put onto the measured scans of the first two, too, and should be named.
Scans are put onto the HDL-64E's whole turn as they are, intensities in steps of 0.01. One line a case in
OUT/cases.jsonl; the same command again goes on.
"""

from __future__ import annotations

import argparse
import shutil
import time
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from benchmarks.blind.hidden.frames import Grid
from benchmarks.blind.hidden.replay import Scan, list_plantable, plant_on
from benchmarks.blind.planted_on_kitti import whole_turns
from benchmarks.blind.rows import append_row, check_settings, code_version, read_rows
from benchmarks.blind.tables import rate
from jaxsim.compilation import enable_compilation_cache
from jaxsim.data.polar_frames import write_frame, write_grid
from jaxsim.discover import Verdict, discover_folders, discover_unpaired
from jaxsim.frame import INTENSITY_STEP, PolarGrid, PolarImage

SCAN_S = 0.1
"""Seconds from one scan of KITTI's to the next."""
Files = Mapping[str, Path]
"""Scans by drive and number."""


def main() -> None:
    args = _arguments()
    enable_compilation_cache()
    files = find_scans(args.root, args.most)
    kept = args.out / "cases.jsonl"
    args.out.mkdir(parents=True, exist_ok=True)
    rows = {row["key"]: row for row in read_rows(kept)}
    settings = {"scans": sorted(files), "columns": args.columns}
    check_settings(list(rows.values()), settings)
    still = [f"still {effect}" for effect in ("none", *args.plant)] if args.still else []
    cases = {key: still_pairs(files, args.still) for key in still}
    if args.later:
        pairs = later_pairs(files, args.later, still=args.still)
        cases |= {f"later {effect}": pairs for effect in ("none", *args.plant)}
    cases |= {f"streets {seed}": two_sides(files, args.still, seed) for seed in range(args.splits)}
    grid, images = whole_turns(files, args.columns)
    for key, sides in tqdm(cases.items(), unit="case"):
        if key in rows:
            continue
        began = time.monotonic()
        kind, hidden = key.split()
        shown = [{frame: images[scan] for frame, scan in side.items()} for side in sides]
        if kind != "streets" and hidden != "none":
            shown[1] = planted(grid, shown[1], effect=hidden, severity=args.severity)
        verdict = answer(grid, shown, folder=args.out / "case", unpaired=kind == "streets")
        found = {
            "key": key,
            "settings": settings,
            "code": code_version(),
            "seconds": round(time.monotonic() - began, 1),
        }
        rows[key] = found | told(verdict)
        append_row(kept, rows[key])
    text = summary([rows[key] for key in cases])
    (args.out / "summary.md").write_text(text + "\n")
    print(text)


def find_scans(root: Path, most: int) -> dict[str, Path]:
    """At most so many scans of each drive, evenly spaced, by names that begin with the drive's.

    Raises ValueError where there are none."""
    found: dict[str, Path] = {}
    for drive in sorted(root.glob("*/*_sync")):
        scans = sorted((drive / "velodyne_points" / "data").glob("*.bin"))
        places = np.unique(np.linspace(0, len(scans) - 1, min(most, len(scans))).round().astype(int))
        found |= {f"{drive.name.split('_drive_')[-1].removesuffix('_sync')}/{scans[k].stem}": scans[k] for k in places}
    if not found:
        raise ValueError(
            f"real_nulls: {root} holds no DATE/*_sync/velodyne_points/data/*.bin; give the folder of dates"
        )
    return found


def still_pairs(files: Files, drive: str) -> tuple[dict[str, str], dict[str, str]]:
    """Every second scan of a drive and the one before it, by a name that both sides share."""
    scans = [name for name in files if name.startswith(f"{drive}/")]
    if len(scans) < 4:
        raise ValueError(f"real_nulls: drive {drive} has {len(scans)} scans; 4 or more are needed, or give --still ''")
    before, after = scans[:-1:2], scans[1::2]
    return dict(zip(before, before, strict=True)), dict(zip(before, after, strict=True))


def later_pairs(files: Files, seconds: float, *, still: str) -> tuple[dict[str, str], dict[str, str]]:
    """Scans and the next one of the same drive, at most so many seconds later, no scan twice; `still` is left out."""
    pairs: dict[str, str] = {}
    for before, after in pairwise(name for name in sorted(files) if not name.startswith(f"{still or '-'}/")):
        (drive, first), (other, second) = before.split("/"), after.split("/")
        apart_s = (int(second) - int(first)) * SCAN_S
        if drive == other and apart_s <= seconds + 1e-6 and before not in pairs.values():
            pairs[before] = after
    if not pairs:
        raise ValueError(f"real_nulls: no two scans of a moving car are {seconds:g} s apart or less; give --most more")
    return {name: name for name in pairs}, pairs


def two_sides(files: Files, still: str, seed: int) -> tuple[dict[str, str], dict[str, str]]:
    """The drives dealt to two sides, whole drives each: the same town and day, no street on both."""
    drives = sorted({name.split("/")[0] for name in files} - {still})
    order = np.random.default_rng(seed).permutation(len(drives))
    left = {drives[k] for k in order[: len(drives) // 2]}
    scans = [name for name in files if not name.startswith(f"{still}/")]
    each = [{name: name for name in scans if (name.split("/")[0] in left) == side} for side in (True, False)]
    return each[0], each[1]


def planted(
    grid: PolarGrid, frames: Mapping[str, PolarImage], *, effect: str, severity: float
) -> dict[str, PolarImage]:
    """Scans with an effect on top, and the noise that the generator's sensor adds to its own."""
    plain = Grid(np.asarray(grid.azimuth_rad, float), np.asarray(grid.elevation_rad, float))
    scans = [Scan(np.where(i.valid, i.range_m, 0), np.where(i.valid, i.intensity, 0), 0.0) for i in frames.values()]
    readings, _ = plant_on(scans, plain, effect=effect, severity=severity, seed=0)
    found = {}
    for name, reading in zip(frames, readings, strict=True):
        range_m, intensity = (reading[channel].astype(np.float32) for channel in ("range", "intensity"))
        found[name] = PolarImage(
            range_m, np.round(intensity / INTENSITY_STEP).astype(np.float32) * np.float32(INTENSITY_STEP), range_m > 0
        )
    return found


def answer(grid: PolarGrid, sides: Sequence[Mapping[str, PolarImage]], *, folder: Path, unpaired: bool) -> Verdict:
    """What `discover` says of two sides; a scan's drive is its scene."""
    shutil.rmtree(folder, ignore_errors=True)
    for part, side in zip(("simulated", "measured"), sides, strict=True):
        about = {f"{k:04d}": {"scene": frame.split("/")[0]} for k, frame in enumerate(side)}
        write_grid(folder / part, grid, frames=about)
        for name, image in zip(about, side.values(), strict=True):
            write_frame(folder / part, name, image)
    compare = discover_unpaired if unpaired else discover_folders
    return compare(simulated=folder / "simulated", measured=folder / "measured").verdict


def told(verdict: Verdict) -> dict[str, Any]:
    """What a row keeps of an answer."""
    said = verdict.to_json()
    return {
        "verdict": verdict.verdict,
        "answer": [effect.name for effect in verdict.effects],
        "unexplained": said.get("unexplained"),
        "levels": said.get("levels"),
        "repeats": said.get("repeats"),
        "notes": list(verdict.notes),
        "ranking": said.get("ranking", [])[:5],
    }


def summary(rows: Sequence[Mapping[str, Any]]) -> str:
    """The answers case by case, and how many are right."""
    lines = ["| case | answer |", "|---|---|"]
    lines += [f"| {row['key']} | {' + '.join(row['answer']) or row['verdict']} |" for row in rows]
    streets = [row for row in rows if row["key"].startswith("streets")]
    if streets:
        lines += [
            "",
            f"Different streets, one sensor: an effect named in {rate(bool(row['answer']) for row in streets)}.",
        ]
    return "\n".join(lines)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--root", type=Path, required=True, help="folder of KITTI raw's dates")
    parser.add_argument("--still", default="0060", help="drive whose car stands; '' for none")
    parser.add_argument("--later", type=float, default=0.0, help="most seconds between paired scans of moving cars")
    parser.add_argument("--plant", nargs="*", choices=list_plantable(), default=[], metavar="EFFECT")
    parser.add_argument("--severity", type=float, default=4.0, help="of what is planted")
    parser.add_argument("--splits", type=int, default=10, help="deals of the drives to two sides")
    parser.add_argument("--most", type=int, default=8, help="scans of a drive")
    parser.add_argument("--columns", type=int, default=1024)
    return parser.parse_args()


if __name__ == "__main__":
    main()
