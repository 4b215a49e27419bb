"""Scores of dense depth: those of KITTI's depth completion benchmark, over the pixels that its rule or ours takes.

d guessed, t true depth in metres. RMSE and MAE of d - t in millimetres; iRMSE and iMAE of 1/d - 1/t in 1/km. Each is
taken over the pixels of an image, then its mean over the images.

`benchmark_errors` is the benchmark's rule (devkit `evaluate_depth.cpp`, `io_depth.h`): holes in the guess are filled by
`interpolate_background`, and every pixel of known truth counts. `depth_errors` leaves holes out, to compare methods on
pixels that all of them fill: its figures are not the benchmark's where there are holes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Bool, Float

from jaxsim.metrics.paired import Score

UNITS = {"rmse": "mm", "mae": "mm", "irmse": "1/km", "imae": "1/km", "filled": "1"}


def depth_errors(
    guess_m: Float[np.ndarray, "h w"],
    guessed: Bool[np.ndarray, "h w"],
    truth_m: Float[np.ndarray, "h w"],
    *,
    known: Bool[np.ndarray, "h w"],
) -> dict[str, float]:
    """rmse, mae (mm), irmse, imae (1/km) of one image over pixels that are known and guessed, and the share `filled` of
    the known ones that are guessed; compare methods on pixels that all of them fill.

    Raises ValueError where no pixel is both, or a depth there is not positive.
    """
    both = known & guessed
    if not both.any():
        raise ValueError(
            "depth: no pixel has both a guess and a truth; check that both are of the same image and crop, and that "
            "16-bit files were divided by 256"
        )
    d, t = guess_m[both].astype(np.float64), truth_m[both].astype(np.float64)
    if not (np.isfinite(d).all() and d.min() > 0 and np.isfinite(t).all() and t.min() > 0):
        raise ValueError(
            f"depth: guessed depths go from {d.min():g} to {d.max():g} m, true ones from {t.min():g} to {t.max():g} m; "
            "every valid depth must be finite and positive: mask out the others"
        )
    # Errors of inverse depth weigh what is near: they grow like the error over the square of the depth.
    metres, inverse = np.abs(d - t), np.abs(1 / d - 1 / t)
    return {
        "rmse": 1e3 * float(np.sqrt((metres**2).mean())),
        "mae": 1e3 * float(metres.mean()),
        "irmse": 1e3 * float(np.sqrt((inverse**2).mean())),
        "imae": 1e3 * float(inverse.mean()),
        "filled": float(both.sum() / known.sum()),
    }


def interpolate_background(
    depth_m: Float[np.ndarray, "h w"], valid: Bool[np.ndarray, "h w"]
) -> tuple[Float[np.ndarray, "h w"], Bool[np.ndarray, "h w"]]:
    """Depth with its holes filled as KITTI's devkit fills them (`DepthImage::interpolateBackground`), and where there
    is any then.

    A hole takes the nearer of the two valid depths beside it in its row; at a row's ends, the last one. Rows above the
    first that has any take that one's, rows below the last that one's; an empty row between others stays empty.
    """
    h, w = valid.shape
    rows = np.arange(h)
    columns = np.arange(w)
    # Column of the nearest valid depth at or before each pixel (-1: none), and at or behind it (w: none).
    before = np.maximum.accumulate(np.where(valid, columns, -1), axis=1)
    behind = np.minimum.accumulate(np.where(valid, columns, w)[:, ::-1], axis=1)[:, ::-1]
    beside = [
        np.where(inside, depth_m[rows[:, None], column.clip(0, w - 1)], np.inf)
        for column, inside in ((before, before >= 0), (behind, behind < w))
    ]
    # Rows outside the first and last that have depth copy those; an empty row in between stays empty.
    some = np.flatnonzero(valid.any(axis=1))
    if not some.size:
        return np.zeros_like(depth_m), np.zeros_like(valid)
    source = rows.clip(some[0], some[-1])
    known = np.broadcast_to(np.isin(source, some)[:, None], (h, w)).copy()
    return np.where(known, np.minimum(*beside)[source], 0).astype(depth_m.dtype), known


def benchmark_errors(
    guess_m: Float[np.ndarray, "h w"],
    guessed: Bool[np.ndarray, "h w"],
    truth_m: Float[np.ndarray, "h w"],
    *,
    known: Bool[np.ndarray, "h w"],
) -> dict[str, float]:
    """rmse, mae (mm), irmse, imae (1/km) of one image by the benchmark's rule: over all known pixels, the guess's holes
    interpolated; `filled` is the share of the known ones that needed no interpolation. The devkit reads 16-bit PNG, so
    it also has depth in steps of 1/256 m; this does not round.

    Raises ValueError where the rule leaves a known pixel without depth (the devkit would take -1 m), where no pixel is
    known, or a depth is not positive.
    """
    dense_m, filled = interpolate_background(guess_m, guessed)
    if (known & ~filled).any():
        raise ValueError(
            f"depth: {(known & ~filled).sum()} known pixels lie in rows where nothing is guessed, which the benchmark "
            "does not interpolate; complete them, or compare guessed pixels alone (depth_errors)"
        )
    errors = depth_errors(dense_m, filled, truth_m, known=known)
    return errors | {"filled": float((known & guessed).sum() / known.sum())}


def depth_scores(images: Sequence[Mapping[str, float]]) -> dict[str, Score]:
    """Means over images of `benchmark_errors` or `depth_errors`; the count is that of images.

    Raises ValueError where there is none.
    """
    if not images:
        raise ValueError("depth: no image to score")
    return {name: Score(float(np.mean([image[name] for image in images])), UNITS[name], len(images)) for name in UNITS}
