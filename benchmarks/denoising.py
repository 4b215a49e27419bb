"""Does denoising help? Non-local means and LIDIA against truth that is known, and on scans of one place.

    python benchmarks/denoising.py WEIGHTS KITTI_RAW OUT [--frames 4] [--epochs 5] [--gains 1 2 3 4]

WEIGHTS: folder of files that `jaxsim convert lidia` wrote (every .npz in it is a network); KITTI_RAW as
`--data.root` takes it. Writes OUT/denoising.json, OUT/denoising_world.jpg, OUT/denoising_kitti.jpg, and the adapted
networks.

Embedded world: PSNR of intensity (0..1) to what the sensor would report without noise, over measured cells; the
adapted networks learned from other streets. `gain` is the contrast that the network sees. KITTI: consecutive scans
a, b and the cells whose range stays within 5 cm between them. `spread` is the root mean square of d(a) - d(b), over
sqrt 2. `error` is what is left of a scan's own distance to the truth: with independent noise, mean (d(a) - b)^2 =
mean (d(a) - truth)^2 + variance of b, and the variance is half of mean (a - b)^2. `stripes` is the root mean square,
over lines, of a line's mean less that of both its neighbours, over columns where all three came back: the lasers'
gains, which belong to the sensor.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from tqdm import tqdm

from jaxsim.atomic import replacing
from jaxsim.cli import enable_compilation_cache
from jaxsim.data import KittiRaw
from jaxsim.data.synthetic import SyntheticWorld
from jaxsim.geometry import full_grid, points_to_polar
from jaxsim.prepare.denoise import close_gaps, denoise
from jaxsim.prepare.denoise.lidia import Lidia, open_lidia, to_published
from jaxsim.prepare.denoise.lidia.adapt import Adaptation, adapt, adapt_to_itself
from jaxsim.prepare.denoise.non_local_means import non_local_means
from jaxsim.report import save_picture, strip
from jaxsim.report.frames import intensity_panel
from jaxsim.weights import ABOUT

Method = Callable[[np.ndarray, np.ndarray], np.ndarray]
HALF_VIEW_RAD, LINES, STEADY_M = np.deg2rad(33.3), slice(2, 46), 0.05
STREETS = (range(1920, 1960, 4), range(0, 64, 4))
"""Frames of the embedded world to judge on and to learn from, one a street."""


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


def methods_of(weights: Path, gains: list[float]) -> dict[str, Method]:
    methods: dict[str, Method] = {
        "raw": lambda x, v: np.where(v, x, 0),
        "non-local means": lambda x, v: denoise(x, v, "non_local_means"),
        "non-local means, strength 0.03": lambda x, v: np.where(v, non_local_means(close_gaps(x, v), strength=0.03), 0),
    }
    for path in sorted(weights.glob("*.npz")):
        network, name = open_lidia(path), f"LIDIA {path.stem.removeprefix('model_state_').removesuffix('_bw')}"
        for statistics in ("stored", "image"):
            for gain in gains:
                methods[f"{name}, {statistics}, gain {gain:g}"] = partial(network, statistics=statistics, gain=gain)
    return methods


def run(method: Method, images: np.ndarray, valid: np.ndarray) -> np.ndarray:
    return np.stack([method(x, v) for x, v in zip(images, valid, strict=True)])


def save(network: Lidia, path: Path) -> None:
    content = {**to_published(network.values), ABOUT: np.array(json.dumps({"kind": "lidia", "source": path.stem}))}
    with replacing(path) as temporary:
        np.savez(temporary, **content)


def main(weights: Path, kitti: Path, out: Path, *, frames: int, epochs: int, gains: list[float]) -> None:
    out.mkdir(parents=True, exist_ok=True)
    methods, small = methods_of(weights, gains), open_lidia(next(iter(sorted(weights.glob("*small*.npz")))))
    truth, noisy, valid = world_frames(STREETS[0][:frames])
    range_m, scans, came = kitti_scans(kitti)
    same = steady(range_m, came)

    results: dict[str, dict[str, float]] = {}
    pictures: dict[str, list[tuple[str, np.ndarray]]] = {"world": [], "kitti": []}

    def judge(name: str, *, world: Method | None, drive: Method | None) -> None:
        row = results.setdefault(name, {})
        if world is not None:
            clean = run(world, noisy, valid)
            row |= {
                "world_psnr_db": float(np.mean([psnr(*x) for x in zip(clean, truth, valid, strict=True)])),
                "world_stripes": stripes(clean, valid),
            }
            pictures["world"].append((f"{name}: {row['world_psnr_db']:.1f} dB", intensity_panel(clean[0], valid[0])))
        if drive is not None:
            clean = run(drive, scans, came)
            noise = 0.5 * ((scans[:-1] - scans[1:])[same] ** 2).mean()
            square = 0.5 * (((clean[:-1] - scans[1:])[same] ** 2).mean() + ((clean[1:] - scans[:-1])[same] ** 2).mean())
            row |= {
                "kitti_spread": float(np.sqrt(0.5 * ((clean[:-1] - clean[1:])[same] ** 2).mean())),
                "kitti_error": float(np.sqrt(max(square - noise, 0))),
                "kitti_stripes": stripes(clean, came),
            }
            pictures["kitti"].append((name, intensity_panel(clean[-1], came[-1])))
        print(f"{name:<44}" + "  ".join(f"{key} {value:.4f}" for key, value in row.items()), flush=True)
        with replacing(out / "denoising.json") as temporary:
            temporary.write_text(json.dumps(results, indent=2))
        for place, panels in pictures.items():
            end = [("without noise", intensity_panel(truth[0], valid[0]))] if place == "world" else []
            save_picture(out / f"denoising_{place}.jpg", strip([*panels, *end], width=756))

    for name, method in methods.items():
        judge(name, world=method, drive=method)

    # Adapted: to the image itself; to pairs of noisy and noise-free images of other streets; to pairs of scans.
    settings = Adaptation(noise=0.03, epochs=epochs, lr=1e-3, stride=44, transpose=False)
    own = adapt_to_itself(small, noisy[:1], valid[:1], settings)
    judge("LIDIA small, adapted to itself", world=own, drive=None)
    clean, measured, seen = world_frames(STREETS[1])
    taught = adapt(small, np.where(seen, clean, 0), seen, settings, noisy=measured)
    save(taught, out / "lidia_adapted_world.npz")
    judge("LIDIA small, adapted to other streets", world=taught, drive=taught)
    # Scans k and k + 1 of the drive's first part, both ways: the noise of the one says nothing of the other's.
    first, second, both = scans[:-3], scans[1:-2], same[:-2]
    pairs = [np.concatenate(two) for two in ((first, second), (second, first), (both, both))]
    taught = adapt(small, pairs[0], pairs[2], settings, noisy=pairs[1])
    save(taught, out / "lidia_adapted_kitti.npz")
    range_m, scans, came, same = range_m[-2:], scans[-2:], came[-2:], same[-1:]
    judge("raw, last two scans", world=None, drive=methods["raw"])
    judge("LIDIA small, last two scans", world=None, drive=small)
    judge("LIDIA small, adapted to earlier scans, last two", world=None, drive=taught)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name in ("weights", "kitti", "out"):
        parser.add_argument(name, type=Path)
    parser.add_argument("--frames", type=int, default=4)
    parser.add_argument("--epochs", type=int, default=5)
    parser.add_argument("--gains", type=float, nargs="+", default=[1.0, 3.0])
    arguments = parser.parse_args()
    enable_compilation_cache()
    main(**vars(arguments))
