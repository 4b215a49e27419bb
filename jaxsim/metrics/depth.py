"""Scores of dense depth, as KITTI's depth completion benchmark defines them (devkit `evaluate_depth.cpp`).

d guessed, t true depth in metres. RMSE and MAE of d - t in millimetres; iRMSE and iMAE of 1/d - 1/t in 1/km. Each is
taken over the pixels of an image, then its mean over the images.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Bool, Float

from jaxsim.metrics.paired import Score

Array = np.ndarray
UNITS = {"rmse": "mm", "mae": "mm", "irmse": "1/km", "imae": "1/km", "filled": "1"}


def depth_errors(
    guess_m: Float[Array, "h w"],
    guessed: Bool[Array, "h w"],
    truth_m: Float[Array, "h w"],
    known: Bool[Array, "h w"],
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
    metres, inverse = np.abs(d - t), np.abs(1 / d - 1 / t)
    return {
        "rmse": 1e3 * float(np.sqrt((metres**2).mean())),
        "mae": 1e3 * float(metres.mean()),
        "irmse": 1e3 * float(np.sqrt((inverse**2).mean())),
        "imae": 1e3 * float(inverse.mean()),
        "filled": float(both.sum() / known.sum()),
    }


def depth_scores(images: Sequence[Mapping[str, float]]) -> dict[str, Score]:
    """Means over images of `depth_errors`; the count is that of images. Raises ValueError where there is none."""
    if not images:
        raise ValueError("depth: no image to score")
    return {name: Score(float(np.mean([image[name] for image in images])), UNITS[name], len(images)) for name in UNITS}
