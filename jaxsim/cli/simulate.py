"""`jaxsim simulate`: a data set's camera frames to polar frames, clouds and pictures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import tyro

from jaxsim.cli.elsewhere import OnWorkers, on_cluster
from jaxsim.cli.flags import SAME, DataSource, EffectFiles, IntoFolder, Scheduler
from jaxsim.config.ranges import Count, Whole
from jaxsim.data import open_dataset
from jaxsim.effects.chain import SensorModel
from jaxsim.effects.own import known_effects
from jaxsim.report.clouds import draw_simulated, write_simulated
from jaxsim.report.scenes import CLOUDS_PAGE
from jaxsim.simulate.embedded import folder_of
from jaxsim.simulate.folder import CloudFormat, FrameMaker, simulate_folder
from jaxsim.simulate.grain import read_grain
from jaxsim.simulate.learned_sensor import LearnedSensor, Projection, load


@dataclass(frozen=True)
class Simulate(OnWorkers, IntoFolder):
    """Simulates the learned sensor of a run over a data set's camera frames.

    Writes polar frames (polar/grid.json and NAME.npz), clouds (clouds/NAME.bin ...), pictures and clouds.html, a page
    that turns the drawn frames beside what was measured, to OUT. What is already there is not made again, so that a
    killed command resumes.
    """

    run: Annotated[Path, tyro.conf.Positional]
    """Folder of the learned sensor's run."""
    out: Path
    """Folder to write to."""
    data: DataSource = SAME
    """Data set whose images, depth and labels to use."""
    projection: Projection = FrameMaker.projection
    """What the network sees: the camera's rasters carried to the LiDAR's grid, as in training; or with `none` only
    scaled down to its size, as the paper does on Virtual KITTI."""
    frames: str = ""
    """Frames to simulate: `0-99`. Empty: the run's validation frames, or all of another data set."""
    formats: tuple[CloudFormat, ...] = FrameMaker.formats
    """Formats of the clouds."""
    batch: Count = FrameMaker.batch
    """Frames simulated at once."""
    previews: Whole = 4
    """Frames to draw."""
    effects: Path | None = None
    """Effects (sensor.json) that the learned sensor lacks; `jaxsim discover` writes one."""
    effects_from: EffectFiles = ()
    draws: bool = False
    """Draw from the distribution that the network gives (one of --generator.form unet), so that clouds have the
    sensor's scatter, instead of taking what is most likely."""
    grain: bool = True
    """Of draws: cells scatter together as measured ones do, by RUN/grain.json, which `jaxsim train` leaves of such a
    network and `jaxsim grain RUN` learns. With --no-grain each cell is drawn for itself, and clouds are speckled."""
    looks: Literal[1, 2, 4] | None = None
    """In how many ways a network of --generator.form unet looks at each frame; by default as many as its run says. 1
    is three times as fast as 4, and less near."""
    seed: Whole = 0
    """Of what the effects and draws leave to chance; a frame depends on it and on its place in the data set."""
    cluster: Scheduler = None

    def __call__(self) -> None:
        maker = self.maker(load)
        of_run, page = maker.learned.run.experiment.data, self.out / CLOUDS_PAGE
        positions = self.data.choose(maker.dataset, of_run, frames=self.frames, run=self.run)
        source = self.data.config(of_run)
        spread = on_cluster(self, by="simulate")
        speed = simulate_folder(maker, positions, source=source, previews=self.previews, spread=spread)
        if (drawn := positions[: self.previews]) and (speed.simulated or not page.exists()):  # to draw, it reads again
            write_simulated(self.out, maker.dataset, drawn, run=self.run.name)
        hints = [f"{page} turns the frames that were drawn"] if page.exists() else []
        print(speed.words(self.out, workers=bool(self.cluster)), *hints, sep="\n")

    def maker(self, load_run: Callable[[Path], LearnedSensor]) -> FrameMaker:
        """What simulates the data set's frames. Raises ValueError for flags that name what is not there."""
        known_effects(self.effects_from)
        learned = load_run(self.run)
        learned = learned.looking(self.looks) if self.looks else learned
        # A network of one intensity a cell has nothing to draw from, and is told so at the first frame.
        together = self.draws and self.grain and learned.run.experiment.generator.form == "unet"
        return FrameMaker(
            learned,
            open_dataset(self.data.config(learned.run.experiment.data)),
            self.out,
            effects_model=SensorModel.load(self.effects, rows=learned.rows) if self.effects else None,
            seed=self.seed,
            draws=self.draws,
            grain=read_grain(folder_of(self.run)) if together else None,
            projection=self.projection,
            formats=self.formats,
            batch=self.batch,
            draw=partial(draw_simulated, self.out),
        )
