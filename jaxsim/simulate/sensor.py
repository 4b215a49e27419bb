"""The learned sensor: from what a renderer knows to what the LiDAR reports."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any, Literal

import jax
import numpy as np
from jaxtyping import Float, Int, UInt8

from jaxsim.cloud import place_intensity
from jaxsim.files import digest_of_values
from jaxsim.frame import Array, Camera, CameraFrame, Cloud, Painted, PolarGrid, PolarImage
from jaxsim.geometry import polar_to_points
from jaxsim.pix2pix import make_generate
from jaxsim.prepare import check_view, crop_image, input_channels, window_of
from jaxsim.runs.kinds import Run
from jaxsim.runs.run import Checkpoints, load_run
from jaxsim.simulate.embedded import is_embedded, read_embedded, shapes_of
from jaxsim.simulate.predict import camera_intensity, simulate_frame, simulate_unprojected

Projection = Literal["lidar", "none"]
"""What the network sees: the camera's rasters carried to the LiDAR's grid, or only scaled down, as in the paper."""
Window = tuple[PolarGrid, Float[Array, " rows"]]
"""A polar grid, and each beam's place in the sensor: 0 top, 1 bottom."""
ASPECT = 0.02
SIZE = 0.03
VIEW = 0.05
"""By how much aspect ratio, size and field of view may differ. KITTI's own images (1224 x 370 .. 1242 x 376) differ by
0.004 in aspect ratio and by 0.015 in size."""


class LearnedSensor:
    """A trained run, ready to simulate; `jaxsim.load` makes one."""

    def __init__(self, run: Run, params: Any):
        self.run, self.params = run, params
        prepare = run.experiment.prepare
        self.generate = make_generate(run.experiment, input_channels(prepare))
        settings = {"generate": self.generate, "prepare": prepare}
        self._simulate = {
            "lidar": jax.jit(partial(simulate_frame, **settings)),
            "none": jax.jit(partial(simulate_unprojected, **settings)),
        }
        self._intensity = jax.jit(partial(camera_intensity, **settings))

    @cached_property
    def fingerprint(self) -> str:
        """SHA-256 of its weights, beams, camera and preparation: of all that decides what it simulates."""
        run = self.run
        settings = (run.experiment.prepare, run.experiment.generator, run.spec, run.intrinsics, run.cam_from_velo)
        return digest_of_values(jax.tree.leaves(self.params), after=repr(settings))

    @cached_property
    def window(self) -> Window:
        """The polar window of the camera that the run was trained with, and each beam's place in the sensor."""
        run = self.run
        return window_of(run.camera, run.image_size, run.spec, config=run.experiment.prepare)

    def simulate_view(
        self,
        view: CameraFrame,
        window: Window | None = None,
        *,
        projection: Projection = "lidar",
        key: Array | None = None,
    ) -> tuple[PolarImage, Painted]:
        """Simulates one cropped view with depth, or a batch of views, on a polar window (default: `window`).

        With `key`, one a view, the answer is a draw from the network's distribution instead of what is most likely.
        Raises ValueError where the view lacks depth, or labels that the run was trained on, or the camera sees another
        width and is not projected, and where there is nothing to draw from.
        """
        if key is not None and projection != "lidar":
            raise ValueError(
                "simulate: draws are made on the LiDAR's grid; leave out --draws, or project (--projection lidar)"
            )
        check_view(view, self.run.experiment.prepare)
        *batch, _, _, _ = view.rgb.shape
        camera = jax.tree.map(lambda leaf: np.broadcast_to(leaf, (*batch, *leaf.shape[-2:])), view.camera)
        self._check_projection(view, projection)
        grid, row = window or self.window
        draws = {} if key is None else {"key": key}
        return self._simulate[projection](self.params, replace(view, camera=camera), grid, row=row, **draws)

    def intensity_map(self, view: CameraFrame) -> Float[Array, "*b h w"]:
        """Intensity 0..0.99 of every pixel of an image with depth, predicted without projection; 0 outside the crop.

        The paper's simulation on Virtual KITTI: pixels of intensity 0 are dropped from the pseudo-LiDAR cloud. Raises
        ValueError where the image is not like those that the run learned from, or lacks what it needs.
        """
        prepare = self.run.experiment.prepare
        size = view.rgb.shape[-3:-1]
        check_image(size, self.run)
        cropped = crop_image(view, prepare.image_crop)
        check_view(cropped, prepare)
        self._check_projection(cropped, "none")
        grid, row = self.window
        intensity = self._intensity(self.params, cropped, grid, row=row)
        return place_intensity(np.asarray(intensity), size, crop=prepare.image_crop)

    def _check_projection(self, cropped: CameraFrame, projection: str) -> None:
        if projection not in self._simulate:
            raise ValueError(f"simulate: projection is {projection!r}; it is {' or '.join(map(repr, self._simulate))}")
        if projection == "none":
            check_field_of_view(cropped.camera, self.run)

    def simulate(
        self,
        *,
        rgb: UInt8[Array, "*b h w 3"],
        depth_m: Float[Array, "*b h w"],
        semantic: Int[Array, "*b h w"] | None = None,
        instance: Int[Array, "*b h w"] | None = None,
        camera: Camera | None = None,
        projection: Projection = "lidar",
    ) -> Cloud:
        """A point cloud from a depth map, labels and an image.

        `depth_m` is planar depth in metres, not finite or <= 0 where there is nothing (sky); `semantic` holds
        Cityscapes ids, `instance` numbers objects (0 none); `camera` defaults to the one the run was trained
        with. Returns the cloud in the LiDAR's frame (x forward, y left, z up), dropped rays masked.

        Raises ValueError where the images have not the aspect ratio and resolution of those that the run learned from.
        """
        check_image(np.shape(rgb)[-3:-1], self.run)
        depth = np.asarray(depth_m, np.float32)
        valid = np.isfinite(depth) & (depth > 0)
        view = CameraFrame(
            rgb=np.asarray(rgb),
            camera=camera or self.run.camera,
            depth_m=np.where(valid, depth, np.float32(0)),
            depth_valid=valid,
            semantic=semantic,
            instance=instance,
        )
        prepare = self.run.experiment.prepare
        window = window_of(view.camera, view.rgb.shape[-3:-1], self.run.spec, config=prepare) if camera else self.window
        image, _ = self.simulate_view(crop_image(view, prepare.image_crop), window, projection=projection)
        return polar_to_points(image, window[0])


def load(folder: Path | str) -> LearnedSensor:
    """The trained sensor of a run folder, or `embedded`: the one that travels with the package.

    A run in a folder of that name comes first. Raises ValueError where there is no run, or it has saved nothing yet.
    """
    if is_embedded(folder):
        return LearnedSensor(*read_embedded())
    run = load_run(folder)
    return LearnedSensor(run, Checkpoints(Path(folder)).restore("generator", shapes_of(run)))


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
    own = 2 * np.rad2deg(np.arctan(half / np.asarray(run.camera.intrinsics)[..., 0, 0].max()))
    its = 2 * np.rad2deg(np.arctan(half / np.asarray(camera.intrinsics)[..., 0, 0].max()))
    if abs(its / own - 1) > VIEW:
        raise ValueError(
            f"simulate: the camera sees {its:.1f} degrees, the run's {own:.1f}; without projection its pixels would "
            "not be the run's rays: render with that field of view, or project (--projection lidar)"
        )
