"""Whether images are like those that a run learned from: of their aspect ratio and size and, without projection, of its
camera's field of view."""

from __future__ import annotations

import numpy as np

from jaxsim.frame import Camera
from jaxsim.runs.kinds import Run

ASPECT = 0.02
"""By how much, as a share of the run's, the aspect ratio of images may differ: KITTI's own (1224 x 370 .. 1242 x 376)
differ by 0.004, and have to pass."""
SIZE = 0.03
"""By how much, as a share of the run's, their width may differ: that of KITTI's own differs by 0.015."""
VIEW = 0.05
"""By how much, as a share of the run's, the field of view may differ. It counts only without projection, where pixels
stand for rays; the limit is a convention."""


def check_image(size: tuple[int, int], run: Run) -> None:
    """Raises ValueError where images of `size` (rows, columns) have not the aspect ratio and size of the run's."""
    (h, w), (rows, columns) = size, run.image_size
    wanted = f"this run learned from images of {columns} x {rows}"
    if abs((w / h) / (columns / rows) - 1) > ASPECT:
        raise ValueError(
            f"simulate: the images are {w} x {h}, an aspect ratio of {w / h:.2f}; {wanted}, {columns / rows:.2f}: "
            f"render at {columns} x {rows}, or cut them to it"
        )
    if abs(w / columns - 1) > SIZE:
        what = "too coarse" if w < columns else "too fine"
        raise ValueError(
            f"simulate: images of {w} x {h} are {what}; {wanted}, and its crop is measured in pixels: render at that "
            "size, or scale image, depth and labels (the latter two without interpolation) and the camera to it"
        )


def check_field_of_view(camera: Camera, run: Run) -> None:
    """Raises ValueError where the run's crop of a camera's image is not as wide as that of the run's own camera:
    without projection only the same view fits."""
    half = run.experiment.prepare.image_crop[1] / 2
    of_run = 2 * np.rad2deg(np.arctan(half / np.asarray(run.camera.intrinsics)[..., 0, 0].max()))
    its = 2 * np.rad2deg(np.arctan(half / np.asarray(camera.intrinsics)[..., 0, 0].max()))
    if abs(its / of_run - 1) > VIEW:
        raise ValueError(
            f"simulate: the camera sees {its:.1f} degrees, the run's {of_run:.1f}; without projection its pixels would "
            "not be the run's rays: render with that field of view, or project (--projection lidar)"
        )
