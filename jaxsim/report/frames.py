"""One frame as a picture: what went in, what was predicted, what was measured."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from jaxsim.frame import DepthFrame, Painted, Pair, PolarImage
from jaxsim.report.pictures import Rgb, colour_classes, colour_scalar, strip

Raster = Float[np.ndarray, "rows columns"]
Mask = Bool[np.ndarray, "rows columns"]


def intensity_panel(intensity: Raster, valid: Mask) -> Rgb:
    """Intensity 0..0.6 in colour (brighter saturates); no return is dark grey."""
    return colour_scalar(intensity, valid & (intensity > 0), low=0.0, high=0.6, gamma=0.7)


def input_panels(painted: Painted) -> list[tuple[str, Rgb]]:
    """What the camera knows, on the polar window."""
    valid = np.asarray(painted.valid)
    rgb = np.where(valid[..., None], np.asarray(painted.rgb) * 255, 40).astype(np.uint8)
    panels = [
        ("camera, carried to the LiDAR's grid", rgb),
        ("range (0-60 m)", colour_scalar(np.asarray(painted.range_m), valid, low=0.0, high=60.0, gamma=0.6)),
    ]
    semantic = np.asarray(painted.semantic)
    if (semantic > 0).any():
        panels.append(
            (
                "classes; grey: not seen, or occluded",
                colour_classes(semantic, valid & ~np.asarray(painted.occluded)),
            )
        )
    return panels


def pair_picture(pair: Pair, predicted: Raster, *, title: str) -> Rgb:
    """Input, prediction, measurement and their difference, one above the other."""
    painted, measured = pair.painted, pair.measured
    seen, returned = np.asarray(painted.valid), np.asarray(measured.valid)
    both = seen & returned
    intensity = np.asarray(measured.intensity)
    error = np.abs(predicted - intensity)
    mean = f"mean {error[both].mean():.3f}" if both.any() else "no cell"
    panels = [
        *input_panels(painted),
        (f"predicted intensity (0-0.6), {title}", intensity_panel(predicted, seen)),
        ("measured intensity", intensity_panel(intensity, returned)),
        (f"absolute difference (0-0.3), {mean}", colour_scalar(error, both, low=0.0, high=0.3)),
    ]
    return strip(panels)


def simulated_picture(image: PolarImage, painted: Painted, *, title: str) -> Rgb:
    """Input and prediction of a simulated frame."""
    intensity, valid = np.asarray(image.intensity), np.asarray(image.valid)
    return strip([*input_panels(painted), (f"simulated intensity (0-0.6), {title}", intensity_panel(intensity, valid))])


def depth_panel(depth_m: Raster, valid: Mask) -> Rgb:
    """Depth 0-60 m in colour, near ones with finer steps; none is dark grey."""
    return colour_scalar(depth_m, valid, low=0.0, high=60.0, gamma=0.6)


def depth_picture(frame: DepthFrame, guesses: Sequence[tuple[str, Raster, np.ndarray]], *, width: int = 912) -> Rgb:
    """Image, the points that are given, each method's dense depth (name, metres, where it has any) and the truth."""
    panels = [
        ("image", np.asarray(frame.rgb)),
        ("given points (0-60 m)", depth_panel(np.asarray(frame.sparse_m), np.asarray(frame.given))),
        *((name, depth_panel(depth_m, valid)) for name, depth_m, valid in guesses),
        ("truth", depth_panel(np.asarray(frame.truth_m), np.asarray(frame.known))),
    ]
    return strip(panels, width=width)
