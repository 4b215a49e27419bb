"""Does denoising help? Non-local means and LIDIA against truth that is known, and on scans of one place.

    python benchmarks/speed/denoising.py WEIGHTS KITTI_RAW OUT [--frames 4] [--epochs 5] [--gains 1 3]
        [--parts methods picture itself streets scans]

WEIGHTS: folder of files that `jaxsim convert lidia` wrote (every .npz in it is a network); KITTI_RAW as
`--data.root` takes it. Writes OUT/denoising.json, OUT/denoising.jpg and the adapted networks. `--parts` runs some parts
alone; the rows of others stay in OUT/denoising.json.

    methods    every method on both
    picture    a part of the first frame by the methods of SHOWN
    itself     the small network, adapted to each frame itself and judged on it, beside the same network as it was
    streets    adapted to noisy and noise-free frames of other streets
    scans      adapted to pairs of KITTI's earlier scans, judged on the last two

Embedded world: PSNR of intensity (0..1) to what the sensor would report without noise, over measured cells. `gain` is
the contrast that the network sees; `stored` and `image` are the statistics of its batch norms. KITTI: consecutive scans
a, b and the cells whose range stays within 5 cm between them. `spread` is the root mean square of d(a) - d(b), over
sqrt 2. `error` is what is left of a scan's own distance to the truth: with independent noise, mean (d(a) - b)^2 =
mean (d(a) - truth)^2 + variance of b, and the variance is half of mean (a - b)^2. `stripes` is the root mean square,
over lines, of a line's mean less that of both its neighbours, over columns where all three came back: the lasers'
gains, which belong to the sensor.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from tqdm import tqdm

from benchmarks.studies.lidia_adaptation import Adaptation, adapt, adapt_to_itself
from jaxsim.compilation import enable_compilation_cache
from jaxsim.data import KittiRaw
from jaxsim.data.synthetic import SyntheticWorld
from jaxsim.files import replacing
from jaxsim.geometry import full_grid, points_to_polar
from jaxsim.geometry.rasters import close_gaps
from jaxsim.prepare.denoise import denoise, non_local_means
from jaxsim.prepare.denoise.lidia import Lidia, open_lidia, save_lidia
from jaxsim.report.pictures import beside, intensity_panel, save_picture, strip

Method = Callable[[np.ndarray, np.ndarray], np.ndarray]
HALF_VIEW_RAD, LINES, STEADY_M = np.deg2rad(33.3), slice(2, 46), 0.05
STREETS = (range(1920, 1960, 4), range(0, 64, 4))
"""Frames of the embedded world to judge on and to learn from, one a street."""
PARTS = ("methods", "picture", "itself", "streets", "scans")
SHOWN = (
    ("raw", "LIDIA blind, image, gain 1", "without noise"),
    ("non-local means", "non-local means, strength 0.03", "LIDIA 25, stored, gain 1"),
)
"""The picture: `without noise` is the truth."""
CROP = slice(70, 132)
"""Its columns."""


def world_frames(numbers: range) -> tuple[np.ndarray, ...]:
    """Truth, measured intensity and validity of the window that the camera sees."""
    world = SyntheticWorld(columns=2048)
    ahead = np.abs(np.asarray(world.grid.azimuth_rad)) < HALF_VIEW_RAD
    parts = []
    for i in tqdm(numbers, desc="embedded world", unit="frame"):
        truth = world.truth(i)
        measured = world.measure(i, truth)
        arrays = (truth.image.intensity, measured.intensity, measured.valid)
        parts.append([np.asarray(a)[LINES][:, ahead] for a in arrays])
    return tuple(np.stack(column) for column in zip(*parts, strict=True))


def kitti_scans(root: Path) -> tuple[np.ndarray, ...]:
    """Range, intensity and validity of all scans of a drive, same window."""
    drive = KittiRaw(root)
    grid = full_grid(drive.spec, 2048)
    ahead = np.abs(np.asarray(grid.azimuth_rad)) < HALF_VIEW_RAD
    images = [points_to_polar(drive[i].cloud, grid)[0] for i in range(len(drive))]
    return tuple(
        np.stack([np.asarray(getattr(image, name))[LINES][:, ahead] for image in images])
        for name in ("range_m", "intensity", "valid")
    )


def psnr(guess: np.ndarray, truth: np.ndarray, valid: np.ndarray) -> float:
    return float(-10 * np.log10(((guess - truth)[valid] ** 2).mean()))


def stripes(intensity: np.ndarray, valid: np.ndarray) -> float:
    """Root mean square over lines of a line's mean less its neighbours'."""
    whole = valid[:, :-2] & valid[:, 1:-1] & valid[:, 2:]
    off = intensity[:, 1:-1] - 0.5 * (intensity[:, :-2] + intensity[:, 2:])
    count = whole.sum((0, 2))
    means = np.where(whole, off, 0).sum((0, 2))[count > 50] / count[count > 50]
    return float(np.sqrt((means**2).mean()))


def steady(range_m: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """Cells of scans k and k + 1 that both saw the same surface."""
    return valid[:-1] & valid[1:] & (np.abs(np.diff(range_m, axis=0)) < STEADY_M)


def methods_of(weights: Path, gains: Sequence[float]) -> dict[str, Method]:
    methods: dict[str, Method] = {
        "raw": lambda x, v: np.where(v, x, 0),
        "non-local means": lambda x, v: denoise(x, v, "non_local_means"),
        "non-local means, strength 0.03": lambda x, v: np.where(v, non_local_means(close_gaps(x, v), strength=0.03), 0),
    }
    for path in sorted(weights.glob("*.npz")):
        for gain in gains:
            methods |= both_ways(name_of(path), open_lidia(path), gain=gain)
    return methods


def name_of(path: Path) -> str:
    """model_state_small_sigma_25_bw.npz is LIDIA small 25."""
    stem = path.stem.removeprefix("model_state_").removesuffix("_bw")
    return f"LIDIA {stem.replace('sigma_', '').replace('_', ' ')}"


def both_ways(name: str, network: Lidia, *, gain: float = 1.0) -> dict[str, Method]:
    """The network with stored statistics and with each image's own."""
    return {f"{name}, {kind}, gain {gain:g}": partial(network, statistics=kind, gain=gain)  # type: ignore[misc]
            for kind in ("stored", "image")}  # fmt: skip


def run(method: Method, images: np.ndarray, valid: np.ndarray) -> np.ndarray:
    return np.stack([method(x, v) for x, v in zip(images, valid, strict=True)])


def world_row(clean: np.ndarray, truth: np.ndarray, valid: np.ndarray) -> dict[str, float]:
    each = [psnr(*x) for x in zip(clean, truth, valid, strict=True)]
    return {"world_psnr_db": float(np.mean(each)), "world_stripes": stripes(clean, valid), "world_frames": len(each)}


def drive_row(clean: np.ndarray, scans: np.ndarray, came: np.ndarray, same: np.ndarray) -> dict[str, float]:
    noise = 0.5 * ((scans[:-1] - scans[1:])[same] ** 2).mean()
    square = 0.5 * (((clean[:-1] - scans[1:])[same] ** 2).mean() + ((clean[1:] - scans[:-1])[same] ** 2).mean())
    return {
        "kitti_spread": float(np.sqrt(0.5 * ((clean[:-1] - clean[1:])[same] ** 2).mean())),
        "kitti_error": float(np.sqrt(max(square - noise, 0))),
        "kitti_stripes": stripes(clean, came),
    }


def picture(methods: dict[str, Method], truth: np.ndarray, noisy: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """Part of a frame by every method of SHOWN, with the PSNR of the whole frame."""
    rows = []
    for names in SHOWN:
        panels = []
        for name in names:
            if name == "without noise":
                clean, title = truth, f"{name} (grey: no return)"
            else:
                clean = methods[name](noisy, valid)
                title = name.removesuffix(", gain 1").replace("non-local means, strength", "non-local, strength")
                title += f": {psnr(clean, truth, valid):.1f} dB"
            panel = intensity_panel(clean[:, CROP], valid[:, CROP]).repeat(6, 0).repeat(4, 1)
            panels.append(strip([(title, panel)], width=panel.shape[1]))
        rows.append(beside(panels))
    return np.concatenate(rows)


def main(
    weights: Path, kitti: Path, out: Path, *, frames: int, epochs: int, gains: Sequence[float], parts: Sequence[str]
) -> None:
    out.mkdir(parents=True, exist_ok=True)
    methods, file = methods_of(weights, gains), out / "denoising.json"
    smaller = sorted(weights.glob("*small*.npz"))
    lacking = [name for names in SHOWN for name in names if name not in methods and name != "without noise"]
    if "picture" in parts and lacking:
        raise SystemExit(f"error: the picture shows {', '.join(lacking)}; {weights} has no such network")
    if not smaller and {"itself", "streets", "scans"} & {*parts}:
        raise SystemExit(f"error: what is adapted is a small network; {weights} has no *small*.npz")
    results: dict[str, dict[str, float]] = json.loads(file.read_text()) if file.is_file() else {}

    def note(name: str, row: dict[str, float]) -> None:
        results[name] = row
        print(f"{name:<60}" + "  ".join(f"{key} {value:.4f}" for key, value in row.items()), flush=True)
        with replacing(file) as temporary:
            temporary.write_text(json.dumps(results, indent=2))

    truth, noisy, valid = world_frames(STREETS[0][:frames])
    if {"methods", "streets", "scans"} & {*parts}:
        range_m, scans, came = kitti_scans(kitti)
        same = steady(range_m, came)

    if "methods" in parts:
        for name, method in methods.items():
            row = world_row(run(method, noisy, valid), truth, valid)
            note(name, row | drive_row(run(method, scans, came), scans, came, same))
    if "picture" in parts:
        save_picture(out / "denoising.jpg", picture(methods, truth[0], noisy[0], valid[0]))

    # Adapted: to the image itself; to pairs of noisy and noise-free images of other streets; to pairs of scans.
    settings = Adaptation(noise=0.03, epochs=epochs, lr=1e-3, stride=44, transpose=False)
    if "itself" in parts:
        cleaned: dict[str, list[np.ndarray]] = {}
        for k, (image, mask) in enumerate(zip(noisy, valid, strict=True), 1):
            small = open_lidia(smaller[0])
            taught = adapt_to_itself(small, image[None], mask[None], settings=settings)
            tried = {"raw": methods["raw"], **both_ways(name_of(smaller[0]), small)}
            for name, method in {**tried, **both_ways(f"{name_of(smaller[0])} adapted to each frame", taught)}.items():
                cleaned.setdefault(name, []).append(method(image, mask))
                note(f"{name} (itself)", world_row(np.stack(cleaned[name]), truth[:k], valid[:k]))
    if "streets" in parts:
        clean, measured, seen = world_frames(STREETS[1])
        taught = adapt(open_lidia(smaller[0]), np.where(seen, clean, 0), seen, settings=settings, noisy=measured)
        save_lidia(out / "lidia_adapted_world.npz", taught.values)
        for name, method in both_ways(f"{name_of(smaller[0])} adapted to other streets", taught).items():
            row = world_row(run(method, noisy, valid), truth, valid)
            note(name, row | drive_row(run(method, scans, came), scans, came, same))
    if "scans" in parts:
        # Scans k and k + 1 of the drive's first part, both ways: the noise of the one says nothing of the other's.
        first, second, both = scans[:-3], scans[1:-2], same[:-2]
        pairs = [np.concatenate(two) for two in ((first, second), (second, first), (both, both))]
        taught = adapt(open_lidia(smaller[0]), pairs[0], pairs[2], settings=settings, noisy=pairs[1])
        save_lidia(out / "lidia_adapted_kitti.npz", taught.values)
        tried = {"raw": methods["raw"], **both_ways(name_of(smaller[0]), open_lidia(smaller[0]))}
        tried |= both_ways(f"{name_of(smaller[0])} adapted to earlier scans", taught)
        for name, method in tried.items():
            row = drive_row(run(method, scans[-2:], came[-2:]), scans[-2:], came[-2:], same[-1:])
            note(f"{name} (last two scans)", row)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name in ("weights", "kitti", "out"):
        parser.add_argument(name, type=Path)
    parser.add_argument("--frames", type=int, default=4)
    parser.add_argument("--epochs", type=int, default=5)
    parser.add_argument("--gains", type=float, nargs="+", default=[1.0, 3.0])
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=PARTS)
    arguments = parser.parse_args()
    enable_compilation_cache()
    main(**vars(arguments))
