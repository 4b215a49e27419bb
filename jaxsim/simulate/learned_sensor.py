"""The learned sensor: from what a renderer knows to what the LiDAR reports."""

from __future__ import annotations

import warnings
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any, Literal

import jax
import numpy as np
from jaxtyping import Float, Int, UInt8

from jaxsim.cloud import place_intensity
from jaxsim.data.records import contents_of
from jaxsim.files import digest_of_values
from jaxsim.frame import Array, Camera, CameraFrame, Cloud, Painted, PolarImage
from jaxsim.geometry import polar_to_points
from jaxsim.geometry.rasters import check_array, check_rasters
from jaxsim.pix2pix import make_generate
from jaxsim.prepare import check_view, crop_image, input_channels, polar_window
from jaxsim.runs.kinds import Run
from jaxsim.runs.run import Checkpoints, load_run
from jaxsim.simulate.checks import check_field_of_view, check_image
from jaxsim.simulate.embedded import is_embedded, read_embedded, shapes_of
from jaxsim.simulate.grain import Grain
from jaxsim.simulate.live import Live, LiveRays, attach_camera, attach_rays, with_cameras
from jaxsim.simulate.predict import (
    NetworkWindow,
    camera_intensity,
    simulate_frame,
    simulate_unprojected,
)

Projection = Literal["lidar", "none"]
"""What the network sees: the camera's rasters carried to the LiDAR's grid, or only scaled down, as in the paper."""


class LearnedSensor:
    """A trained run, ready to simulate; `jaxsim.load` makes one."""

    def __init__(self, run: Run, params: Any):
        self.run, self.params = run, params
        prepare = run.experiment.prepare
        self.generate = make_generate(run.experiment, input_channels(prepare))
        # Closed over: they are the sensor's own, and what is compiled holds for them alone.
        settings = {"generate": self.generate, "prepare": prepare}
        self._simulate = {
            # A grain says which fields are drawn, so that each has a program of its own.
            "lidar": jax.jit(partial(simulate_frame, **settings), static_argnames="grain"),
            "none": jax.jit(partial(simulate_unprojected, **settings)),
        }
        self._intensity = jax.jit(partial(camera_intensity, **settings))

    @cached_property
    def fingerprint(self) -> str:
        """SHA-256 of its weights, beams, camera and preparation: of all that decides what it simulates."""
        run, prepare = self.run, self.run.experiment.prepare
        # Where they are not, no depth is completed: renderers give theirs.
        if prepare.depth == "penet" and prepare.depth_weights and prepare.depth_weights.is_file():
            prepare = replace(prepare, depth_weights=Path(contents_of(prepare.depth_weights)))
        settings = (prepare, run.experiment.generator, run.spec, run.intrinsics, run.cam_from_velo)
        return digest_of_values(jax.tree.leaves(self.params), after=repr(settings))

    def looking(self, ways: Literal[1, 2, 4]) -> LearnedSensor:
        """The same sensor, of a network that looks at each window in so many ways (`generator.looks`).

        Raises ValueError where the network is not one that does.
        """
        experiment = self.run.experiment
        if experiment.generator.form != "unet":
            raise ValueError(
                f"simulate: a unet looks several ways, {experiment.generator.form} does not; leave looks out"
            )
        experiment = replace(experiment, generator=replace(experiment.generator, looks=ways))
        return LearnedSensor(replace(self.run, experiment=experiment), self.params)

    @property
    def rows(self) -> int:
        """Beams of the window."""
        return len(self.window[0].elevation_rad)

    @cached_property
    def window(self) -> NetworkWindow:
        """The polar window of the camera that the run was trained with, and each beam's place in the sensor."""
        run = self.run
        return polar_window(run.camera, run.image_size, run.spec, config=run.experiment.prepare)

    def simulate_view(
        self,
        view: CameraFrame,
        window: NetworkWindow | None = None,
        *,
        projection: Projection = "lidar",
        key: Array | None = None,
        grain: Grain | None = None,
    ) -> tuple[PolarImage, Painted]:
        """Simulates one cropped view with depth, or a batch of views, on a polar window (default: `window`).

        With `key`, one a view, the answer is a draw from the network's distribution instead of what is most likely;
        its cells scatter together as `grain` says (`read_grain`), or each for itself.
        Raises ValueError where a raster is not what it must be (`check_rasters`), where the view lacks depth, or labels
        that the run was trained on, or the camera sees another width and is not projected, and where there is nothing
        to draw from.
        """
        if key is not None and projection != "lidar":
            raise ValueError(
                "simulate: draws are made on the LiDAR's grid; leave out --draws, or project (--projection lidar)"
            )
        check_rasters(view, "simulate")
        check_view(view, self.run.experiment.prepare)
        self._check_projection(view, projection)
        grid, row_share = window or self.window
        # Left out rather than None, for without projection there is nothing to draw with.
        draws = {} if key is None else {"key": key, "grain": grain}
        return self._simulate[projection](self.params, with_cameras(view), grid, row_share=row_share, **draws)

    def intensity_map(self, view: CameraFrame) -> Float[Array, "*b h w"]:
        """Intensity 0..0.99 of every pixel of an image with depth, predicted without projection; 0 outside the crop.

        The paper's simulation on Virtual KITTI: pixels of intensity 0 are dropped from the pseudo-LiDAR cloud. Raises
        ValueError where the image is not like those that the run learned from, or lacks what it needs, and where a
        raster is not what it must be (`check_rasters`).
        """
        check_rasters(view, "simulate")
        prepare = self.run.experiment.prepare
        size = view.rgb.shape[-3:-1]
        check_image(size, self.run)
        cropped = crop_image(view, prepare.image_crop)
        check_view(cropped, prepare)
        self._check_projection(cropped, "none")
        grid, row_share = self.window
        intensity = self._intensity(self.params, cropped, grid, row_share=row_share)
        return place_intensity(np.asarray(intensity), size, crop=prepare.image_crop)

    def attach(self, view: CameraFrame) -> Live:
        """A function from a simulator's views to clouds, compiled for views like this one: its size, batch, camera and
        labels. It has its latency, which is logged too.

        Raises ValueError where the images are not like those that the run learned from, or lack depth or labels, and
        where a raster is not what it must be (`check_rasters`).
        """
        return attach_camera(self.run, self.params, view, generate=self.generate)

    def attach_rays(self, window: NetworkWindow | None = None) -> LiveRays:
        """The same from what a ray caster's rays meet: range, class, incidence, on a grid (default: `window`). It has
        the rays to cast.

        Raises ValueError where the run was trained on what only a camera knows.
        """
        return attach_rays(self.run, self.params, window or self.window, generate=self.generate)

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

        `depth_m` is planar depth in metres, not finite or 0 where there is nothing (sky), or beyond 1000 m; `semantic`
        holds Cityscapes ids, `instance` numbers objects (0 none); `camera` defaults to the one the run was trained
        with. Returns the cloud in the LiDAR's frame (x forward, y left, z up), dropped rays masked. Warns where no ray
        comes back.

        Raises ValueError where a raster is not what it must be (`check_rasters`), and where the images have not the
        aspect ratio and resolution of those that the run learned from.
        """
        for name, raster in (("rgb", rgb), ("depth_m", depth_m), ("semantic", semantic), ("instance", instance)):
            check_array(raster, f"simulate: {name}")
        view = CameraFrame(
            rgb=np.asarray(rgb),
            camera=camera or self.run.camera,
            depth_m=np.asarray(depth_m),
            semantic=None if semantic is None else np.asarray(semantic),
            instance=None if instance is None else np.asarray(instance),
        )
        check_rasters(view, "simulate")
        check_image(view.rgb.shape[-3:-1], self.run)
        depth = np.asarray(depth_m, np.float32)
        valid = np.isfinite(depth) & (depth > 0)
        view = replace(view, depth_m=np.where(valid, depth, np.float32(0)), depth_valid=valid)
        prepare = self.run.experiment.prepare
        # Another camera covers another part of the sensor's grid.
        window = (
            polar_window(view.camera, view.rgb.shape[-3:-1], self.run.spec, config=prepare) if camera else self.window
        )
        cropped = crop_image(view, prepare.image_crop)
        image, painted = self.simulate_view(cropped, window, projection=projection)
        _warn_of_nothing(image, painted)
        return polar_to_points(image, window[0])


def _warn_of_nothing(image: PolarImage, painted: Painted) -> None:
    """Warns where no ray of a view comes back, and says what kept them."""
    returns = np.asarray(image.valid).any((-2, -1)).ravel()
    if returns.all():
        return
    seen = np.asarray(painted.valid).any((-2, -1)).ravel()
    k = int(np.flatnonzero(~returns)[0])
    which = f"of view {k} " if returns.size > 1 else ""
    why = "no pixel with depth lies on one: look at the depth, and at the camera's place on the LiDAR (cam_from_velo)"
    if seen[k]:
        why = "the network drops all of them, or they end beyond 1000 m: look at the image and at the classes"
    warnings.warn(f"simulate: no ray {which}comes back; {why}", stacklevel=3)


def load(folder: Path | str) -> LearnedSensor:
    """The trained sensor of a run folder, or `embedded`: the one that travels with the package.

    A run in a folder of that name comes first. Raises ValueError where there is no run, or it has saved nothing yet.
    """
    if not isinstance(folder, str | Path):
        raise ValueError(
            f"run: {folder!r:.60} came; give the folder that `jaxsim train` made, or 'embedded', the packaged sensor"
        )
    if is_embedded(folder):
        return LearnedSensor(*read_embedded())
    run = load_run(folder)
    return LearnedSensor(run, Checkpoints(Path(folder)).restore("generator", shapes_of(run)))
