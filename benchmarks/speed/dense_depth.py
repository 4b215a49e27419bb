"""Which form of IP-Basic comes nearest to depth that it was not given, and to the ranges along the LiDAR's rays.

    python benchmarks/speed/dense_depth.py KITTI_RAW KITTI_OBJECT DEPTH.png

Three tests. DEPTH.png is a ground-truth image of KITTI's depth-completion set (11 scans put together): its pixels on
the beams of one HDL-64E scan are given, all others are asked for. The scans of KITTI_RAW without every eighth laser
line: its pixels are asked for (camera and LiDAR stand apart, so some of them lie behind what the camera sees: compare
the medians). Both are scored on the pixels that every form fills; `filled` is the share of the asked pixels that the
form fills at all. Last, what painting makes of it: range of the polar window's cells against the measured range.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from itertools import product
from pathlib import Path

import cv2
import numpy as np

from jaxsim.config import PrepareConfig
from jaxsim.data import KittiObject, KittiRaw
from jaxsim.frame import Camera, Cloud, Frame
from jaxsim.geometry import LidarSpec, preset
from jaxsim.prepare import crop_image, paint, prepare_frame, sparse_depth
from jaxsim.prepare.depth import METHODS

FORMS = list(product(METHODS, (False, True), ("bilateral", "gaussian")))
HALF_LINE_DEG = 0.04  # a line is about one pixel thick: 721 pixels a radian
Case = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Depth in metres, which pixels are given, which are asked for."""


def accumulated(path: Path, camera: Camera) -> Case:
    """The pixels of one scan out of the depth of eleven."""
    depth = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if depth is None or depth.dtype != np.uint16:
        raise SystemExit(f"{path}: no 16-bit depth image; give one of groundtruth/image_02/*.png")
    depth_m = depth.astype(np.float32) / np.float32(256)
    v, u = np.mgrid[: depth.shape[0], : depth.shape[1]]
    rays = np.stack([u, v, np.ones_like(u)], axis=-1) @ np.linalg.inv(camera.intrinsics).T
    velo_from_cam = np.linalg.inv(camera.cam_from_velo)
    xyz = (rays * depth_m[..., None]) @ velo_from_cam[:3, :3].T + velo_from_cam[:3, 3]
    spec = preset("hdl64e")
    height = xyz[..., 2, None] - np.asarray(spec.origin_m)
    off = np.arctan2(height, np.hypot(xyz[..., 0], xyz[..., 1])[..., None]) - spec.elevation_rad
    on_line = np.rad2deg(np.abs(off).min(axis=-1)) < HALF_LINE_DEG
    return depth_m, (depth > 0) & on_line, (depth > 0) & ~on_line


def without_lines(frame: Frame) -> Case:
    """A measured scan; the lines 4, 12, 20 ... are asked for."""
    row, size = np.asarray(frame.cloud.row), frame.camera.rgb.shape[:2]

    def image(keep: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        cloud = Cloud(frame.cloud.xyz_m, frame.cloud.intensity, frame.cloud.valid & keep)
        depth_m, valid = sparse_depth(cloud, frame.camera.camera, size)
        return np.asarray(depth_m), np.asarray(valid)

    given_m, given = image(row % 8 != 4)
    asked_m, asked = image(row % 8 == 4)
    return np.where(given, given_m, asked_m), given, asked & ~given


def score(title: str, cases: list[Case]) -> None:
    filled = {form: [] for form in FORMS}
    seconds = dict.fromkeys(FORMS, 0.0)
    for depth_m, given, _ in cases:
        for form in FORMS:
            method, extrapolate, blur = form
            start = time.perf_counter()
            filled[form].append(METHODS[method](depth_m, given, extrapolate=extrapolate, blur=blur))
            seconds[form] += time.perf_counter() - start
    truth = np.concatenate([depth_m[asked] for depth_m, _, asked in cases])
    known = {f: np.concatenate([k[a] for (_, k), (*_, a) in zip(filled[f], cases, strict=True)]) for f in FORMS}
    every = np.logical_and.reduce(list(known.values()))
    counts = f"{sum(given.sum() for _, given, _ in cases)} pixels given, {truth.size} asked for, {every.sum()} scored"
    print(f"\n{title}: {counts}")
    print(f"  {'method':<15}{'extrapolate':<13}{'blur':<11}{'MAE':>8}{'RMSE':>9}{'median':>9}{'filled':>9}{'ms':>7}")
    for form in FORMS:
        guess = np.concatenate([d[a] for (d, _), (*_, a) in zip(filled[form], cases, strict=True)])
        off = np.abs(guess - truth)[every]
        method, extrapolate, blur = form
        print(
            f"  {method:<15}{'yes' if extrapolate else 'no':<13}{blur:<11}{off.mean():7.3f}m"
            f"{np.sqrt((off**2).mean()):8.3f}m{np.median(off):8.3f}m{known[form].mean():9.4f}"
            f"{seconds[form] / len(cases) * 1e3:7.1f}"
        )


def score_rays(title: str, frames: list[Frame], spec: LidarSpec) -> None:
    """How far the painted range lies from the measured one, in cells of the polar window."""
    config = PrepareConfig(inputs=("rgb", "depth"), depth="ip_basic")
    counts = {form: np.zeros(3) for form in FORMS}  # measured cells, painted among them, painted without a return
    relative = {form: [] for form in FORMS}
    for frame in frames:
        pair, grid = prepare_frame(frame, spec, config)
        returned, range_m = np.asarray(pair.measured.valid), np.asarray(pair.measured.range_m)
        view = crop_image(frame.camera, config.image_crop)
        sparse_m, given = (np.asarray(a) for a in sparse_depth(frame.cloud, view.camera, config.image_crop))
        for form in FORMS:
            method, extrapolate, blur = form
            depth_m, valid = METHODS[method](sparse_m, given, extrapolate=extrapolate, blur=blur)
            painted = paint(replace(view, depth_m=depth_m, depth_valid=valid), grid, occlusion_m=config.occlusion_m)
            seen = np.asarray(painted.valid)
            both = seen & returned
            counts[form] += returned.sum(), both.sum(), (seen & ~returned).sum()
            relative[form].append(np.abs(np.asarray(painted.range_m) / np.where(both, range_m, 1) - 1)[both])
    print(f"\n{title}: range of {counts[FORMS[0]][0]:.0f} measured cells")
    print(
        f"  {'method':<15}{'extrapolate':<13}{'blur':<11}{'seen':>7}{'within 2 %':>12}{'mean off':>10}{'no return':>11}"
    )
    for form in FORMS:
        method, extrapolate, blur = form
        measured, both, more = counts[form]
        off = np.concatenate(relative[form])
        print(
            f"  {method:<15}{'yes' if extrapolate else 'no':<13}{blur:<11}{both / measured:7.3f}"
            f"{(off < 0.02).mean():12.3f}{off.mean():10.4f}{more / (both + more):11.3f}"
        )


def main(raw: Path, kitti_object: Path, depth: Path) -> None:
    for_raw, for_object = KittiRaw(raw), KittiObject(kitti_object)
    frames = [for_raw[i] for i in range(len(for_raw))]
    score(f"{depth.name}, one scan of eleven given", [accumulated(depth, frames[0].camera.camera)])
    score(f"{len(frames)} scans, seven of eight lines given", [without_lines(frame) for frame in frames])
    score_rays(f"{len(frames)} raw frames", frames, for_raw.spec)
    frames = [for_object[i] for i in range(len(for_object))]
    score_rays(f"{len(frames)} object frames", frames, for_object.spec)


if __name__ == "__main__":
    if len(sys.argv) != 4:
        raise SystemExit(__doc__)
    main(*map(Path, sys.argv[1:]))
