"""IP-Basic and PENet side by side: on common pixels, and by the rule of KITTI's depth completion benchmark.

    python benchmarks/speed/depth_completion.py OUT.jpg [--penet weights.npz] [--frames 6] [--depth RGB.png DEPTH.png
        RAW [--only-depth]]

On frames of the embedded world, one a street, whose true depth is known (up to 120 m); with --depth also on a
ground-truth image of KITTI's set (11 scans put together) and its RGB image: the pixels on the beams of one HDL-64E scan
are given, all others asked for; RAW, the folder of a raw drive's date, has the camera. --only-depth leaves the embedded
world out, and its picture. Every method is scored twice: on the pixels that all of them fill, and by the benchmark's
rule, on all pixels, its holes interpolated as the devkit does. `filled` is the share of the known pixels that a method
fills. OUT shows the first frame.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from dense_depth import accumulated
from tqdm import tqdm

from jaxsim.data import open_dataset
from jaxsim.data.kitti_files import raw_camera, read_image
from jaxsim.frame import DepthFrame
from jaxsim.metrics.depth import UNITS, benchmark_errors, depth_errors, depth_scores
from jaxsim.prepare.depth import METHODS
from jaxsim.prepare.depth.penet import open_penet
from jaxsim.prepare.depth.penet.training import depth_frame
from jaxsim.report.pictures import depth_picture, save_picture

CROP = (352, 1216)
FORMS = {
    "ip_basic, bilateral": ("ip_basic", {}),
    "ip_basic_fast, bilateral": ("ip_basic_fast", {}),
    "ip_basic_fast, extrapolated, Gaussian": ("ip_basic_fast", {"extrapolate": True, "blur": "gaussian"}),
}


def kitti_frame(rgb: Path, depth: Path, raw: Path) -> DepthFrame:
    image = read_image(rgb)
    camera = raw_camera(raw, image.shape[:2])
    depth_m, given, asked = accumulated(depth, camera)
    (h, w), intrinsics = depth_m.shape, np.array(camera.intrinsics, np.float32)
    top, left = h - CROP[0], round((w - CROP[1]) / 2)
    intrinsics[:2, 2] -= left, top
    view = np.s_[top:, left : left + CROP[1]]
    return DepthFrame(
        image[view], np.where(given, depth_m, 0)[view], given[view], depth_m[view], asked[view], intrinsics
    )


def score(title: str, frames: list[DepthFrame], penet: Path | None) -> list[tuple[str, np.ndarray, np.ndarray]]:
    """Prints the table; gives what every method made of the first frame."""
    guesses: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {}
    for name, (method, settings) in FORMS.items():
        guesses[name] = [METHODS[method](f.sparse_m, f.given, **settings) for f in frames]
    if penet is not None:
        network = open_penet(penet)
        guesses["penet"] = [network(f.rgb, f.sparse_m, f.given, f.intrinsics, rows_cut=23) for f in frames]
    print(f"\n{title}: {len(frames)} images, {np.mean([f.given.mean() for f in frames]):.3f} of the pixels given")
    heads = "".join(f"{name + ' ' + unit:>14}" for name, unit in UNITS.items())
    print(f"  {'on the pixels that all fill':<40}{heads}")
    every = [np.logical_and.reduce([known[i] for known in _masks(guesses)]) for i in range(len(frames))]
    for name, made in guesses.items():
        errors = []
        for (depth_m, known), shared, frame in zip(made, every, frames, strict=True):
            one = depth_errors(depth_m, shared, frame.truth_m, known=frame.known)
            errors.append(one | {"filled": float((known & frame.known).sum() / frame.known.sum())})
        print(row(name, errors), flush=True)
    print(f"  {'by the benchmark: all, interpolated':<40}{heads}")
    for name, made in guesses.items():
        pairs = zip(made, frames, strict=True)
        print(
            row(name, [benchmark_errors(*guess, frame.truth_m, known=frame.known) for guess, frame in pairs]),
            flush=True,
        )
    return [(name, *made[0]) for name, made in guesses.items()]


def row(name: str, errors: list[dict[str, float]]) -> str:
    return f"  {name:<40}" + "".join(f"{score.value:>14.4g}" for score in depth_scores(errors).values())


def _masks(guesses: dict[str, list[tuple[np.ndarray, np.ndarray]]]) -> list[list[np.ndarray]]:
    return [[known for _, known in made] for made in guesses.values()]


def main(out: Path, penet: Path | None, frames: int, depth: list[Path] | None, *, only_depth: bool) -> None:
    if not only_depth:
        world = open_dataset("synthetic")
        numbers = range(1920, 1920 + 4 * frames, 4)
        streets = [depth_frame(world[i], CROP) for i in tqdm(numbers, desc="embedded world", unit="frame")]
        save_picture(out, depth_picture(streets[0], score("embedded world", streets, penet)))
    if depth:
        score("KITTI, eleven scans put together", [kitti_frame(*depth)], penet)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--penet", type=Path)
    parser.add_argument("--frames", type=int, default=6)
    parser.add_argument("--depth", type=Path, nargs=3, metavar=("RGB", "DEPTH", "RAW"))
    parser.add_argument("--only-depth", action="store_true")
    main(**vars(parser.parse_args()))
