"""Dense depth from the LiDAR points that fall into the image, behind one function.

A method takes sparse depth with its mask and gives dense depth with its mask; it never writes into its input.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from jaxsim.prepare.depth.ip_basic import Blur, fill_in_fast, fill_in_multiscale

Array = np.ndarray

METHODS = {"ip_basic": fill_in_multiscale, "ip_basic_fast": fill_in_fast}

__all__ = ["METHODS", "complete_depth", "fill_in_fast", "fill_in_multiscale"]


def complete_depth(
    sparse_depth_m: Float[Array, "h w"],
    valid: Bool[Array, "h w"],
    method: str = "ip_basic_fast",
    *,
    extrapolate: bool = False,
    blur: Blur = "bilateral",
) -> tuple[Float[Array, "h w"], Bool[Array, "h w"]]:
    """Planar depth in metres for the pixels that the points' surroundings tell, and where that is.

    `ip_basic_fast` without extrapolation came nearest to KITTI's measured ranges (docs/benchmarks.md); sensors of
    fewer lines leave gaps that only `ip_basic` closes.

    Raises ValueError when no pixel has depth or the method is unknown.
    """
    if method not in METHODS:
        raise ValueError(f"depth: no method {method!r}; known: {', '.join(METHODS)}")
    if not valid.any():
        raise ValueError(
            "depth: not one pixel has depth, so there is nothing to complete; check that the points fall "
            "into the image (calibration of another drive, or an empty scan?)"
        )
    return METHODS[method](sparse_depth_m.astype(np.float32), valid, extrapolate=extrapolate, blur=blur)
