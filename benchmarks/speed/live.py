"""Latency of an attached sensor, batch 1: a whole turn of 64 x 1024 rays, and KITTI's camera view.

    python benchmarks/speed/live.py

The rays go through the U-Net of `configs/kitti_drives` without the camera's inputs, and through the generator of
`configs/synthetic` with 16 filters; the view through the travelling sensor itself. Weights of the first two are random:
they do not change time.
"""

import tempfile
from dataclasses import replace
from pathlib import Path

import jax
import numpy as np
from timing import interleave

import jaxsim
from configs.kitti_drives import experiment as drives
from configs.synthetic import experiment as synthetic
from jaxsim.config import Experiment
from jaxsim.frame import Cloud
from jaxsim.geometry import full_grid, preset
from tests.untrained import untrained_run

SIZE = (64, 1024)
INPUTS = ("log_range", "depth", "incidence", "row")


def of_rays(experiment: Experiment, folder: Path) -> jaxsim.LearnedSensor:
    prepare = replace(experiment.prepare, inputs=INPUTS, network_size=SIZE)
    return jaxsim.load(untrained_run(folder, replace(experiment, prepare=prepare)))


def main() -> None:
    grid = full_grid(preset("hdl64e"), SIZE[1])
    place = (grid, np.linspace(0, 1, SIZE[0], dtype=np.float32))
    range_m = np.random.default_rng(0).uniform(3, 60, SIZE).astype(np.float32)
    view = jaxsim.open_dataset("synthetic")[1920].camera
    with tempfile.TemporaryDirectory() as work:
        unet = of_rays(drives, Path(work) / "unet")
        four, once = unet.attach_rays(place), unet.looking(1).attach_rays(place)
        generator = of_rays(
            replace(synthetic, generator=replace(synthetic.generator, filters=16)), Path(work) / "generator"
        ).attach_rays(place)
        camera = jaxsim.load("embedded").attach(view)

    def done(cloud: Cloud) -> Cloud:
        return jax.block_until_ready(cloud)

    interleave(
        "live, batch 1",
        {
            "64 x 1024 rays, U-Net": lambda: done(four(range_m)),
            "64 x 1024 rays, one look": lambda: done(once(range_m)),
            "64 x 1024 rays, generator": lambda: done(generator(range_m)),
            "view of 1242 x 375": lambda: done(camera(view)),
        },
    )


if __name__ == "__main__":
    main()
