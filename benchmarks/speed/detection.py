"""KITTI evaluation of 3769 frames with 20 detections each, all classes, difficulties and metrics, against numba.

    python benchmarks/speed/detection.py [--frames 3769] [--detections 20]

The numba version does what the official tool does, frame by frame in compiled loops on all cores: overlaps by clipping
polygons in float64, then both passes label by label, the second once a threshold. Flags and thresholds are ours in
both.
"""

from __future__ import annotations

import math
import os
from dataclasses import dataclass

# Or numba's threads go on spinning into the next peer's turn.
os.environ["OMP_WAIT_POLICY"] = "PASSIVE"

import numba
import numpy as np
import tyro
from timing import interleave

from jaxsim.metrics.detection import DIFFICULTIES, METRICS, OVERLAP_SETS, SCORED, Objects, evaluate
from jaxsim.metrics.detection.matching import detection_flags, dont_care, thresholds, truth_flags

KINDS = ("Car", "Car", "Car", "Car", "Van", "Pedestrian", "Pedestrian", "Person_sitting", "Cyclist", "DontCare")


def street(rng: np.random.Generator, frames: int, per_frame: int) -> tuple[Objects, Objects]:
    """Labels, ten a frame, and detections: most near a label, some duplicates, some of nothing."""
    names, labels = tuple(f"{k:06d}" for k in range(frames)), 10 * frames
    kind = rng.choice(KINDS, labels)
    centre = rng.uniform((-20, 1.4, 5), (20, 1.9, 60), (labels, 3))
    size = np.where((kind == "Pedestrian")[:, None], (0.9, 0.6, 1.8), (3.9, 1.6, 1.5)) * rng.normal(
        1, 0.05, (labels, 3)
    )
    yaw = rng.uniform(-np.pi, np.pi, labels)
    truth = objects(names, np.repeat(np.arange(frames), 10), kind, centre, size, yaw, rng.random(labels) * 0.6, rng)
    source = (np.arange(frames)[:, None] * 10 + rng.integers(0, 10, (frames, per_frame))).ravel()
    n = len(source)
    away = np.where(rng.random((n, 1)) < 0.3, rng.normal(0, 6, (n, 3)), rng.normal(0, 0.15, (n, 3))) * (1, 0.1, 1)
    named = np.where(rng.random(n) < 0.1, rng.choice(list(SCORED), n), kind[source])
    found = objects(
        names, np.repeat(np.arange(frames), per_frame), named, centre[source] + away,
        size[source] * rng.normal(1, 0.05, (n, 3)), yaw[source] + rng.normal(0, 0.1, n), np.zeros(n), rng,
    )  # fmt: skip
    return truth, found


def objects(names, frame, kind, centre, size, yaw, truncated, rng) -> Objects:
    n = len(frame)
    scale = 720 / np.maximum(centre[:, 2], 3)
    u, v = 620 + centre[:, 0] * scale, 187 + centre[:, 1] * scale
    bbox = np.stack([u - 1.3 * scale, v - size[:, 2] * scale, u + 1.3 * scale, v], axis=1)
    bbox += rng.normal(0, 2, (n, 4))
    occluded, score = rng.integers(0, 4, n).astype(float), rng.random(n)
    return Objects(names, frame, kind, bbox, size, centre, yaw, yaw, truncated, occluded, score)


@numba.njit
def _clip(polygon, count, nx, ny, limit):
    """Half plane nx x + ny y <= limit (Sutherland and Hodgman)."""
    out, n = np.empty((16, 2)), 0
    for i in range(count):
        p, q = polygon[i], polygon[(i + 1) % count]
        a, b = limit - nx * p[0] - ny * p[1], limit - nx * q[0] - ny * q[1]
        if a >= 0:
            out[n] = p
            n += 1
        if (a > 0 > b) or (a < 0 < b):
            out[n] = p + (q - p) * (a / (a - b))
            n += 1
    return out, n


@numba.njit
def _turned_area(a, b):
    """Of boxes (x, z, l, w, rotation_y), seen from above."""
    cos, sin = math.cos(a[4]), math.sin(a[4])
    polygon = np.empty((16, 2))
    for k in range(4):
        x, z = (0.5 if k in (0, 3) else -0.5) * a[2], (0.5 if k < 2 else -0.5) * a[3]
        polygon[k, 0], polygon[k, 1] = a[0] - b[0] + x * cos + z * sin, a[1] - b[1] - x * sin + z * cos
    count = 4
    cos, sin = math.cos(b[4]), math.sin(b[4])
    for nx, ny, limit in ((cos, -sin, b[2] / 2), (-cos, sin, b[2] / 2), (sin, cos, b[3] / 2), (-sin, -cos, b[3] / 2)):
        polygon, count = _clip(polygon, count, nx, ny, limit)
    area = 0.0
    for i in range(count):
        j = (i + 1) % count
        area += polygon[i, 0] * polygon[j, 1] - polygon[j, 0] * polygon[i, 1]
    return abs(area) / 2


@numba.njit(parallel=True)
def _overlaps(gb, g3, db, d3, gs, ds, out):
    """(metric, label, place of the detection in its frame)."""
    for f in numba.prange(len(gs) - 1):
        for g in range(gs[f], gs[f + 1]):
            for d in range(ds[f], ds[f + 1]):
                k = d - ds[f]
                w = min(gb[g, 2], db[d, 2]) - max(gb[g, 0], db[d, 0])
                h = min(gb[g, 3], db[d, 3]) - max(gb[g, 1], db[d, 1])
                det = (db[d, 2] - db[d, 0]) * (db[d, 3] - db[d, 1])
                if w > 0 and h > 0:
                    out[0, g, k] = w * h / ((gb[g, 2] - gb[g, 0]) * (gb[g, 3] - gb[g, 1]) + det - w * h)
                    out[3, g, k] = w * h / det
                a, b = g3[g], d3[d]
                if math.hypot(a[0] - b[0], a[1] - b[1]) < (math.hypot(a[2], a[3]) + math.hypot(b[2], b[3])) / 2:
                    area = _turned_area(a, b)
                    out[1, g, k] = area / (a[2] * a[3] + b[2] * b[3] - area)
                    high = min(a[5], b[5]) - max(a[5] - a[6], b[5] - b[6])
                    volume = area * max(high, 0.0)
                    out[2, g, k] = volume / (a[2] * a[3] * a[6] + b[2] * b[3] * b[6] - volume)


@numba.njit(parallel=True)
def _pass(overlap, inside, gs, ds, gf, df, dc, score, alpha_g, alpha_d, minimum, at, by_score, use_dc, found, sums):
    for f in numba.prange(len(gs) - 1):
        taken = np.zeros(ds[f + 1] - ds[f], np.bool_)
        for t in range(len(at)):
            taken[:] = False
            tp, fp, similarity = 0, 0, 0.0
            for g in range(gs[f], gs[f + 1]):
                if gf[g] == -1:
                    continue
                best, value, best_ignored = -1, 0.0, False
                for d in range(ds[f], ds[f + 1]):
                    k = d - ds[f]
                    if df[d] == -1 or taken[k] or score[d] < at[t] or overlap[g, k] <= minimum:
                        continue
                    if by_score:
                        if best < 0 or score[d] > value:
                            best, value = d, score[d]
                    elif df[d] == 0 and (best < 0 or best_ignored or overlap[g, k] > value):
                        best, value, best_ignored = d, overlap[g, k], False
                    elif df[d] == 1 and best < 0:
                        best, best_ignored = d, True
                if best >= 0:
                    taken[best - ds[f]] = True
                    if gf[g] == 0 and df[best] == 0:
                        tp += 1
                        similarity += (1 + math.cos(alpha_g[g] - alpha_d[best])) / 2
                        if by_score:
                            found[g] = score[best]
            if by_score:
                continue
            for d in range(ds[f], ds[f + 1]):
                if df[d] == 0 and score[d] >= at[t] and not taken[d - ds[f]]:
                    stuff = False
                    if use_dc:
                        for g in range(gs[f], gs[f + 1]):
                            stuff = stuff or (dc[g] and inside[g, d - ds[f]] > minimum)
                    fp += 0 if stuff else 1
            sums[f, t, 0], sums[f, t, 1], sums[f, t, 2] = tp, fp, similarity


def in_numba(truth: Objects, found: Objects) -> dict[tuple[str, str, str, str], float]:
    frames = np.arange(len(truth.names) + 1)
    gs, ds = np.searchsorted(truth.frame, frames), np.searchsorted(found.frame, frames)
    g3, d3 = (
        np.column_stack([o.centre_m[:, [0, 2]], o.size_m[:, :2], o.yaw_rad, o.centre_m[:, 1], o.size_m[:, 2]])
        for o in (truth, found)
    )
    overlap = np.zeros((4, len(truth.frame), int(np.diff(ds).max())))
    _overlaps(truth.bbox_px, g3, found.bbox_px, d3, gs, ds, overlap)
    dc, scores = dont_care(truth, "official"), {}
    for kind in SCORED:
        for difficulty, limits in DIFFICULTIES.items():
            gf, df = truth_flags(truth, kind, limits, rules="official"), detection_flags(found, kind, limits)
            for m, metric in enumerate(METRICS):
                for overlap_set, least in OVERLAP_SETS.items():
                    fixed = (overlap[m], overlap[3], gs, ds, gf, df, dc, found.score, truth.alpha_rad, found.alpha_rad)
                    tps, none = np.full(len(gf), -np.inf), np.zeros((0, 0, 3))
                    _pass(*fixed, least[kind][m], np.array([-np.inf]), True, m == 0, tps, none)
                    at = thresholds(tps[np.isfinite(tps)], int((gf == 0).sum()))
                    sums = np.zeros((len(truth.names), len(at), 3))
                    _pass(*fixed, least[kind][m], at, False, m == 0, tps, sums)
                    tp, fp, similarity = sums.sum(axis=0).T
                    for measure, good in ((metric, tp), ("aos", similarity))[: 2 if m == 0 else 1]:
                        precision = np.zeros(41)
                        precision[: len(at)] = good / np.maximum(tp + fp, 1)
                        highest = np.maximum.accumulate(precision[::-1])[::-1]
                        scores[kind, difficulty, overlap_set, measure] = 2.5 * float(highest[1:].sum())
    return scores


@dataclass(frozen=True)
class Arguments:
    frames: int = 3769
    detections: int = 20
    rounds: int = 5


def main(args: Arguments) -> None:
    truth, found = street(np.random.default_rng(0), args.frames, args.detections)
    theirs = in_numba(truth, found)
    ours = {(c.kind, c.difficulty, c.overlap_set, c.metric): c.ap_r40 for c in evaluate(truth, found)}
    print(f"largest difference of {len(ours)} AP R40: {max(abs(ours[key] - theirs[key]) for key in ours):.1e} points")
    interleave(
        f"KITTI evaluation of {args.frames} frames with {args.detections} detections",
        {"jaxsim": lambda: evaluate(truth, found), "numba": lambda: in_numba(truth, found)},
        rounds=args.rounds,
        warmup=1,
    )


if __name__ == "__main__":
    main(tyro.cli(Arguments))
