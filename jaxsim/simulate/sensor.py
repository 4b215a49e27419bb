"""The learned sensor: from what a renderer knows to what the LiDAR reports."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int, UInt8

from jaxsim.config import PrepareConfig
from jaxsim.frame import Array, Camera, CameraFrame, Cloud, Painted, PolarGrid, PolarImage
from jaxsim.geometry import incidence, polar_to_points
from jaxsim.pix2pix import ema_generator, make_generate, state_shapes
from jaxsim.prepare import check_view, crop_image, input_channels, paint, window_of
from jaxsim.simulate.predict import Generate, predict_intensity
from jaxsim.simulate.run import Checkpoints, Run, load_run

Window = tuple[PolarGrid, Float[Array, " rows"]]


def simulate_frame(
    params: Any,
    view: CameraFrame,
    grid: PolarGrid,
    row: Float[Array, " rows"],
    *,
    generate: Generate,
    prepare: PrepareConfig,
) -> tuple[PolarImage, Painted]:
    """What the LiDAR reports of a camera's view, and what was painted on its grid on the way.

    The paper's steps: carry the camera's rasters to the polar grid through depth and calibration, predict the
    intensity there, drop the rays of zero intensity. `row` is each beam's place in the sensor, 0 top, 1 bottom.
    """
    painted = paint(view, grid, occlusion_m=prepare.occlusion_m)
    angle, _ = incidence(painted.range_m, painted.valid, grid)
    rows = jnp.broadcast_to(row[:, None], angle.shape)
    intensity = predict_intensity(generate, params, painted, angle, rows, prepare=prepare)
    return PolarImage(painted.range_m, intensity, painted.valid & (intensity > 0)), painted


class LearnedSensor:
    """A trained run, ready to simulate; `jaxsim.load` makes one."""

    def __init__(self, run: Run, params: Any):
        self.run, self.params = run, params
        prepare = run.experiment.prepare
        self.generate = make_generate(run.experiment, input_channels(prepare))
        self._simulate = jax.jit(partial(simulate_frame, generate=self.generate, prepare=prepare))

    @cached_property
    def fingerprint(self) -> str:
        """SHA-256 of its weights, beams, camera and preparation: of all that decides what it simulates."""
        run = self.run
        settings = (run.experiment.prepare, run.experiment.generator, run.spec, run.intrinsics, run.cam_from_velo)
        digest = hashlib.sha256(repr(settings).encode())
        for leaf in jax.tree.leaves(self.params):
            digest.update(np.ascontiguousarray(leaf).tobytes())
        return digest.hexdigest()

    @cached_property
    def window(self) -> Window:
        """The polar window of the camera that the run was trained with, and each beam's place in the sensor."""
        run = self.run
        return window_of(run.camera, run.image_size, run.spec, run.experiment.prepare)

    def simulate_view(self, view: CameraFrame, window: Window | None = None) -> tuple[PolarImage, Painted]:
        """Simulates one cropped view with depth, or a batch of views, on a polar window (default: `window`).

        Raises ValueError where the view lacks depth, or labels that the run was trained on.
        """
        check_view(view, self.run.experiment.prepare)
        *batch, _, _, _ = view.rgb.shape
        camera = jax.tree.map(lambda leaf: np.broadcast_to(leaf, (*batch, *leaf.shape[-2:])), view.camera)
        return self._simulate(self.params, replace(view, camera=camera), *(window or self.window))

    def simulate(
        self,
        *,
        rgb: UInt8[Array, "*b h w 3"],
        depth_m: Float[Array, "*b h w"],
        semantic: Int[Array, "*b h w"] | None = None,
        instance: Int[Array, "*b h w"] | None = None,
        camera: Camera | None = None,
    ) -> Cloud:
        """A point cloud from a depth map, labels and an image.

        `depth_m` is planar depth in metres, not finite or <= 0 where there is nothing (sky); `semantic` holds
        Cityscapes ids, `instance` numbers objects (0 none); `camera` defaults to the one the run was trained
        with. Returns the cloud in the LiDAR's frame (x forward, y left, z up), dropped rays masked.
        """
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
        window = window_of(view.camera, view.rgb.shape[-3:-1], self.run.spec, prepare) if camera else self.window
        image, _ = self.simulate_view(crop_image(view, prepare.image_crop), window)
        return polar_to_points(image, window[0])


def load(folder: Path | str) -> LearnedSensor:
    """The trained sensor of a run folder. Raises ValueError where there is no run, or it has saved nothing yet."""
    run = load_run(folder)
    channels = input_channels(run.experiment.prepare)
    like = jax.eval_shape(ema_generator, state_shapes(run.experiment, channels))
    return LearnedSensor(run, Checkpoints(Path(folder)).restore("generator", like))
