"""Rotated overlap of N x M boxes from above, and suppression, against shapely with an STRtree.

    python benchmarks/speed/rotated_iou.py

shapely's tree tells which pairs can meet at all and clips only those, in float64; jaxsim computes every pair in float32
and needs no tree.
"""

from __future__ import annotations

import jax
import numpy as np
import shapely
from timing import interleave

from jaxsim.geometry.boxes import iou_bev, nms_bev


def street(rng: np.random.Generator, count: int) -> np.ndarray:
    """Cars in a field of 70 x 80 m, in lanes and askew."""
    middle = rng.uniform((0, -40, -1), (70, 40, 0), (count, 3))
    size = rng.normal((3.9, 1.6, 1.56), (0.4, 0.1, 0.1), (count, 3))
    heading = rng.choice([0, np.pi / 2], (count, 1)) + rng.normal(0, 0.2, (count, 1))
    return np.concatenate([middle, size, heading], axis=1).astype(np.float32)


def outlines(boxes: np.ndarray) -> np.ndarray:
    boxes = boxes.astype(np.float64)
    local = np.array([[0.5, 0.5], [-0.5, 0.5], [-0.5, -0.5], [0.5, -0.5]])[None] * boxes[:, None, 3:5]
    cos, sin = np.cos(boxes[:, 6, None]), np.sin(boxes[:, 6, None])
    x = cos * local[..., 0] - sin * local[..., 1] + boxes[:, 0, None]
    y = sin * local[..., 0] + cos * local[..., 1] + boxes[:, 1, None]
    return shapely.polygons(np.stack([x, y], axis=-1))


def by_tree(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    first, second = outlines(a), outlines(b)
    i, j = shapely.STRtree(second).query(first)
    shared = shapely.area(shapely.intersection(first[i], second[j]))
    area_a, area_b = (x[:, 3].astype(np.float64) * x[:, 4] for x in (a, b))
    overlap = np.zeros((len(a), len(b)))
    overlap[i, j] = shared / (area_a[i] + area_b[j] - shared)
    return overlap


def suppressed(boxes: np.ndarray, score: np.ndarray, threshold: float, keep: int) -> list[int]:
    """Greedy; the tree tells the rivals of each box kept, and only those that are left are clipped."""
    shapes, area = outlines(boxes), boxes[:, 3].astype(np.float64) * boxes[:, 4]
    tree = shapely.STRtree(shapes)
    alive, kept = np.ones(len(boxes), bool), []
    for k in np.argsort(-score, kind="stable"):
        if alive[k]:
            kept.append(int(k))
            rivals = tree.query(shapes[k])
            rivals = rivals[alive[rivals]]
            shared = shapely.area(shapely.intersection(shapes[k], shapes[rivals]))
            alive[rivals[shared > threshold * (area[k] + area[rivals] - shared)]] = False
            if len(kept) == keep:
                break
    return kept


def main() -> None:
    rng = np.random.default_rng(0)
    for n, m in ((512, 32), (1000, 1000)):
        a, b = street(rng, n), street(rng, m)
        print(f"largest difference {np.abs(np.asarray(iou_bev(a, b)) - by_tree(a, b)).max():.1e}")
        on_device = jax.device_put((a, b))
        interleave(
            f"overlap of {n} x {m} boxes",
            {
                "jaxsim": lambda d=on_device: jax.block_until_ready(iou_bev(*d)),
                "shapely": lambda a=a, b=b: by_tree(a, b),
            },
        )
    for n, threshold, keep in ((2048, 0.7, 100), (9000, 0.8, 512)):
        boxes, score = street(rng, n), rng.random(n, np.float32)
        index, kept = nms_bev(boxes, score, threshold, keep=keep)
        if np.asarray(index)[np.asarray(kept)].tolist() != suppressed(boxes, score, threshold, keep):
            print("a pair at the threshold is kept by one and dropped by the other")
        on_device = jax.device_put((boxes, score))
        interleave(
            f"suppression of {n} boxes at {threshold}, {keep} kept",
            {
                "jaxsim": lambda d=on_device, t=threshold, k=keep: jax.block_until_ready(nms_bev(*d, t, keep=k)),
                "shapely": lambda b=boxes, s=score, t=threshold, k=keep: suppressed(b, s, t, k),
            },
            rounds=7,
        )


if __name__ == "__main__":
    main()
