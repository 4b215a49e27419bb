"""`jaxsim simulate`: a data set's camera frames to polar frames, clouds and pictures."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import jax
import numpy as np
import tyro
from tqdm import tqdm

from jaxsim.cli.source import SAME, Source
from jaxsim.cloud import points_of, save_cloud
from jaxsim.data import open_dataset
from jaxsim.data.polar_frames import read_grid, write_frame, write_grid
from jaxsim.data.select import frames_to_judge
from jaxsim.effects.chain import SensorModel
from jaxsim.frame import Frame, Painted, PolarGrid, PolarImage
from jaxsim.geometry import polar_to_points
from jaxsim.report import draw_cloud, save_picture, simulated_picture
from jaxsim.simulate.beside_drive import about_of, rasters, simulate_batch, take
from jaxsim.simulate.effects import check_motion, with_effects
from jaxsim.simulate.folder import claim_effects, claim_frames
from jaxsim.simulate.sensor import Projection, load


@dataclass(frozen=True)
class Simulate:
    """Simulates the learned sensor of a run over a data set's camera frames.

    Writes polar frames (polar/grid.json and NAME.npz), clouds (clouds/NAME.bin ...) and pictures to OUT. What
    is already there is not made again, so that a killed command resumes.
    """

    run: Annotated[Path, tyro.conf.Positional]
    """Folder of the learned sensor's run."""
    out: Path
    """Folder to write to."""
    data: Source = SAME
    """Data set whose images, depth and labels to use."""
    projection: Projection = "lidar"
    """What the network sees: the camera's rasters carried to the LiDAR's grid, as in training; or with `none` only
    scaled down to its size, as the paper does on Virtual KITTI."""
    frames: str = ""
    """Frames to simulate: `0-99`. Empty: the run's validation frames, or all of another data set."""
    formats: tuple[Literal["bin", "pcd", "ply", "npz"], ...] = ("bin", "pcd", "ply")
    """Formats of the clouds."""
    batch: int = 8
    """Frames simulated at once."""
    previews: int = 4
    """Frames to draw."""
    effects: Path | None = None
    """Effects (sensor.json) that the learned sensor lacks; `jaxsim discover` writes one."""
    seed: int = 0
    """Of what the effects leave to chance; a frame depends on it and on its place in the data set."""

    def __call__(self) -> None:
        # Sensor and frames.
        learned = load(self.run)
        own = learned.run.experiment.data
        source = self.data.config(own)
        dataset = open_dataset(source)
        positions = frames_to_judge(self.frames, dataset, validation="" if self.data.foreign else own.validation)
        grid, _ = learned.window
        model = SensorModel.load(self.effects, rows=len(grid.elevation_rad)) if self.effects else None
        opening = dataset[positions[0]] if model else None
        if model and opening:
            check_motion(model, time_s=opening.time_s, speed_mps=opening.speed_mps, heading_rad=opening.heading_rad)
        claim_effects(self.out, model)
        unlike = [f"LiDAR in the {source.lidar}"] * (source.kind == "vkitti2" and source.lidar != "kitti")
        unlike += ["not projected"] * (self.projection == "none")
        made_of = ", ".join([source.kind, *unlike])
        claim_frames(self.out, sensor=learned.fingerprint, data=made_of, seed=self.seed if model else None)
        first_s = opening.time_s if opening else None
        todo = [p for p in positions if not all(path.is_file() for path in self.files(dataset.name_of(p)))]

        # Batches: the last is filled up, so that one compiled program serves all.
        begun, batches_s = time.monotonic(), []
        drawn = len(positions) - len(todo)
        bar = tqdm(total=len(positions), initial=drawn, unit="frame", desc="simulating")
        for first in range(0, len(todo), self.batch):
            places = todo[first : first + self.batch]
            frames = [dataset[p] for p in places]
            images, painted, seconds = simulate_batch(learned, frames, self.batch, projection=self.projection)
            batches_s.append(seconds)
            self.announce(grid, frames)
            for k, (place, frame) in enumerate(zip(places, frames, strict=True)):
                image, under = take((images, painted), k)
                if model:
                    key = jax.random.fold_in(jax.random.key(self.seed), place)
                    time_s = None if frame.time_s is None else frame.time_s - (first_s or 0.0)
                    motion = {"time_s": time_s, "speed_mps": frame.speed_mps, "heading_rad": frame.heading_rad}
                    image = with_effects(model, image, under, grid, key=key, **motion)
                self.write(frame.name, image, under, grid=grid, draw=drawn < self.previews)
                drawn += 1
            bar.update(len(frames))
        bar.close()
        print(f"{len(todo)} frames simulated, {len(positions) - len(todo)} were there: {self.out}")
        if todo:
            print(speed(batches_s, self.batch, total_s=time.monotonic() - begun))

    def files(self, name: str) -> list[Path]:
        """All files of a frame that must be there; the polar frame is written last."""
        return [
            *(self.out / "clouds" / f"{name}.{f}" for f in self.formats),
            self.out / "polar" / f"{name}.npz",
        ]

    def announce(self, grid: PolarGrid, frames: Sequence[Frame]) -> None:
        """Adds frames to grid.json. Raises ValueError where the folder is of another grid."""
        folder, known = self.out / "polar", {}
        if (folder / "grid.json").is_file():
            old, known = read_grid(folder)
            if not same_rays(old, grid):
                raise ValueError(
                    f"simulate: {folder} holds frames of another grid ("
                    f"{len(old.elevation_rad)} x {len(old.azimuth_rad)} cells; these have {len(grid.elevation_rad)} x "
                    f"{len(grid.azimuth_rad)}); give another --out"
                )
        write_grid(folder, grid, frames=known | {frame.name: about_of(frame) for frame in frames})

    def write(self, name: str, image: PolarImage, painted: Painted, *, grid: PolarGrid, draw: bool) -> None:
        """Writes one frame's files."""
        cloud = polar_to_points(image, grid)
        *clouds, _ = self.files(name)
        for path in clouds:
            save_cloud(path, cloud)
        if draw:
            points = points_of(cloud)
            view = draw_cloud(points, title=f"{name}: {len(points)} points")
            save_picture(self.out / "previews" / f"{name}_cloud.png", view)
            save_picture(self.out / "previews" / f"{name}.png", simulated_picture(image, painted, title=name))
        write_frame(self.out / "polar", name, image, **rasters(painted, grid))


def same_rays(a: PolarGrid, b: PolarGrid) -> bool:
    """Whether two grids have the same angles, to 1e-5 rad."""
    pairs = (a.azimuth_rad, b.azimuth_rad), (a.elevation_rad, b.elevation_rad)
    return all(x.shape == y.shape and np.allclose(x, y, rtol=0, atol=1e-5) for x, y in pairs)


def speed(batches_s: Sequence[float], size: int, *, total_s: float) -> str:
    """Tells how fast the simulation is, and how long the command took with all else that it does.

    The first batch is left out, for it waits for the compiler. The last counts as full: it was computed so.
    """
    total = f"{total_s:.1f} s in all, with loading, compiling and writing"
    if len(batches_s) < 2:
        return f"{total}; the simulation's own speed shows from the second batch on (a smaller --batch, more --frames)"
    rate = size * (len(batches_s) - 1) / sum(batches_s[1:])
    return f"simulation alone {rate:.2f} frames/s (after the first batch); {total}"
