"""`jaxsim simulate`: a data set's camera frames to polar frames, clouds and pictures."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import tyro
from tyro.conf import UseAppendAction

from jaxsim.cli.source import SAME, Source
from jaxsim.cloud import points_of
from jaxsim.cluster import spread, with_absolute_paths
from jaxsim.config.ranges import Checked, Count, Whole
from jaxsim.data import Dataset, open_dataset
from jaxsim.data.polar_frames import open_polar_frames
from jaxsim.effects.chain import SensorModel
from jaxsim.effects.own import known_effects
from jaxsim.files import file_of
from jaxsim.frame import Cloud, Painted, PolarImage
from jaxsim.geometry import polar_to_points
from jaxsim.report import compared_clouds, draw_cloud, save_picture, simulated_picture, write_clouds
from jaxsim.simulate.folder import Batch, FrameMaker, Made, Speed, simulate_folder
from jaxsim.simulate.sensor import LearnedSensor, Projection, load


@dataclass(frozen=True)
class Simulate(Checked):
    """Simulates the learned sensor of a run over a data set's camera frames.

    Writes polar frames (polar/grid.json and NAME.npz), clouds (clouds/NAME.bin ...), pictures and clouds.html, a page
    that turns the drawn frames beside what was measured, to OUT. What is already there is not made again, so that a
    killed command resumes.
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
    batch: Count = 8
    """Frames simulated at once."""
    previews: Whole = 4
    """Frames to draw."""
    effects: Path | None = None
    """Effects (sensor.json) that the learned sensor lacks; `jaxsim discover` writes one."""
    effects_from: UseAppendAction[tuple[Path, ...]] = ()
    """A Python file with an effect of your own that --effects names; may be given several times. Its code is run: give
    only files that you have read."""
    draws: bool = False
    """Draw each cell from the distribution that the network gives (one of --generator.form unet), so that clouds have
    the sensor's scatter, instead of taking what is most likely. Cells are drawn each for itself."""
    seed: Whole = 0
    """Of what the effects and draws leave to chance; a frame depends on it and on its place in the data set."""
    cluster: str | None = None
    """Address of a Dask scheduler, tcp://HOST:8786: simulate on its workers, a batch at a time, instead of here. They
    need jaxsim, the run, the data set and OUT under the same paths (docs/many-devices.md)."""

    @property
    def writes_to(self) -> Path:
        """The folder that one process has while the command runs."""
        return self.out

    @property
    def page(self) -> Path:
        """Where the clouds are turned."""
        return self.out / "clouds.html"

    def __call__(self) -> None:
        # Sensor and frames.
        known_effects(self.effects_from)
        maker = self.maker(load(self.run))
        of_run = maker.learned.run.experiment.data
        source = self.data.config(of_run)
        positions = self.data.choose(maker.dataset, of_run, frames=self.frames)
        unlike = [f"LiDAR in the {source.lidar}"] * (source.kind == "vkitti2" and source.lidar != "kitti")
        unlike += ["not projected"] * (self.projection == "none")

        # Frames, written to OUT.
        speed = simulate_folder(
            maker,
            positions,
            data=", ".join([source.kind, *unlike]),
            previews=self.previews,
            spread=partial(self.on_cluster, self.cluster) if self.cluster else None,
        )
        if speed.simulated or not self.page.exists():  # to draw it reads, or renders, frames again
            self.write_page(maker.dataset, positions[: self.previews])
        print(f"{speed.simulated} frames simulated, {speed.already} were there: {self.out}")
        if speed.simulated:
            print(speed_words(speed, workers=bool(self.cluster)))
        if self.page.exists():
            print(f"{self.page} turns the frames that were drawn")

    def maker(self, learned: LearnedSensor) -> FrameMaker:
        """What simulates the data set's frames. Raises ValueError for flags that name what is not there."""
        rows = len(learned.window[0].elevation_rad)
        return FrameMaker(
            learned,
            open_dataset(self.data.config(learned.run.experiment.data)),
            self.out,
            effects_model=SensorModel.load(self.effects, rows=rows) if self.effects else None,
            seed=self.seed,
            draws=self.draws,
            projection=self.projection,
            formats=self.formats,
            batch=self.batch,
            draw=self.draw,
        )

    def on_cluster(self, address: str, batches: Sequence[Batch]) -> Iterator[Made]:
        """What became of each batch, made on the workers of a cluster."""
        job = with_absolute_paths(Elsewhere(self, Path.cwd()))
        return (done.result for done in spread(address, job, batches, by="simulate"))

    def draw(self, name: str, cloud: Cloud, *, image: PolarImage, painted: Painted) -> None:
        """Writes one frame's pictures."""
        points = points_of(cloud)
        view = draw_cloud(points, title=f"{name}: {len(points)} points")
        save_picture(file_of(self.out / "previews", name, "_cloud.png", by="simulate"), view)
        picture = simulated_picture(image, painted, title=name)
        save_picture(file_of(self.out / "previews", name, ".png", by="simulate"), picture)

    def write_page(self, dataset: Dataset, positions: Sequence[int]) -> None:
        """Writes the page, which turns these frames beside their measured clouds."""
        if not positions:
            return
        frames = open_polar_frames(self.out / "polar")
        scenes = []
        for position in positions:
            frame = dataset[position]
            simulated = points_of(polar_to_points(frames.read(frame.name)[0], frames.grid))
            measured = np.zeros((0, 4), np.float32) if frame.cloud is None else points_of(frame.cloud)
            scenes.append(compared_clouds(frame.name, simulated, measured))
        beside = any(len(scene.sides) > 1 for scene in scenes)
        both = "Left of the slider the simulated cloud, in the camera's view; right of it the measured one."
        write_clouds(
            self.page,
            scenes,
            title="jaxsim simulate",
            sentence=f"The sensor of {self.run.name}, simulated{' beside what was measured' if beside else ''}.",
            words=both if beside else "The simulated cloud, in the camera's view.",
        )


@dataclass(frozen=True)
class Elsewhere:
    """The command on a worker of a cluster."""

    command: Simulate
    folder: Path
    """The current one of who gave the command, from which its run may name files."""

    def open(self) -> FrameMaker:
        known_effects(self.command.effects_from)
        learned = load(self.command.run)
        return self.command.maker(LearnedSensor(with_absolute_paths(learned.run, self.folder), learned.params))


def speed_words(speed: Speed, *, workers: bool = False) -> str:
    """Tells how fast the simulation is, and how long the command took with all else that it does; of `workers` that
    share it only how fast they are together."""
    total = f"{speed.total_s:.1f} s in all, with loading, compiling and writing"
    if workers:
        return f"{speed.simulated / speed.total_s:.2f} frames/s; {total}"
    rate = speed.frames_per_s
    if rate is None:
        return f"{total}; the simulation's own speed shows from the second batch on (a smaller --batch, more --frames)"
    return f"simulation alone {rate:.2f} frames/s (after the first batch); {total}"
