"""Dense depth from the LiDAR points that fall into the image, behind one function.

A method takes sparse depth with its mask and gives dense depth with its mask; it never writes into its input.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from jaxsim.frame import CameraFrame
from jaxsim.prepare.depth.ip_basic import fill_in_fast, fill_in_multiscale
from jaxsim.prepare.depth.penet import open_penet

METHODS = {"ip_basic": fill_in_multiscale, "ip_basic_fast": fill_in_fast}
"""Of the sparse depth alone; `penet` also takes the image, and weights."""


def complete_depth(
    sparse_depth_m: Float[np.ndarray, "h w"], valid: Bool[np.ndarray, "h w"], method: str = "ip_basic_fast"
) -> tuple[Float[np.ndarray, "h w"], Bool[np.ndarray, "h w"]]:
    """Planar depth in metres for the pixels that the points' surroundings tell, and where that is.

    `ip_basic_fast` without extrapolation came nearest to KITTI's measured ranges (docs/benchmarks.md); sensors of
    fewer lines leave gaps that only `ip_basic` closes.

    Raises ValueError when no pixel has depth or the method is unknown.
    """
    if method not in METHODS and method != "penet":
        raise ValueError(f"depth: no method {method!r}; known: {', '.join([*METHODS, 'penet'])}")
    if not valid.any():
        raise ValueError(
            "depth: not one pixel has depth, so there is nothing to complete; check that the points fall "
            "into the image (calibration of another drive, or an empty scan?)"
        )
    if method == "penet":
        raise ValueError("depth: penet also takes the image; call complete_view")
    return METHODS[method](sparse_depth_m.astype(np.float32), valid)


def complete_view(
    view: CameraFrame,
    sparse_depth_m: Float[np.ndarray, "h w"],
    valid: Bool[np.ndarray, "h w"],
    *,
    method: str,
    weights: Path | None = None,
    rows_cut: int = 0,
) -> CameraFrame:
    """A cropped view with dense depth, by any method; `penet` takes `weights` that `jaxsim convert penet` or a training
    wrote. `rows_cut`: rows that the crop takes off the image's top.

    Raises ValueError as `complete_depth` does; for `penet` also without weights, and where the crop's sides are no
    multiples of 32.
    """
    if method == "penet":
        network = open_penet(weights)
        depth_m, known = network(
            np.asarray(view.rgb),
            sparse_depth_m,
            valid,
            intrinsics=np.asarray(view.camera.intrinsics),
            rows_cut=rows_cut,
        )
    else:
        depth_m, known = complete_depth(sparse_depth_m, valid, method)
    return replace(view, depth_m=depth_m, depth_valid=known)
