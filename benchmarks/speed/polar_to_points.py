"""A range image to points, 64 x 1024 and 128 x 2048, against ouster-sdk's look-up table.

`python benchmarks/speed/polar_to_points.py`, from the repository's root; needs the extra `bench`. The table is the
sensor's ideal geometry on both sides: evenly spread beams, no offsets, so that the points are the same.
The table's rays are computed beforehand and not timed, as are jaxsim's kept rays; its other two lines show
what computing them in every call costs, and delivering intensity, mask and row beside the points.
"""

import os

os.environ.setdefault("JAX_PLATFORMS", "cpu")  # the peers have no other

import jax
import numpy as np
from ouster.sdk import core
from timing import interleave

from jaxsim.frame import PolarGrid, PolarImage
from jaxsim.geometry import directions, polar_to_points

SIZES = {(64, 1024): core.LidarMode._1024x10, (128, 2048): core.LidarMode._2048x10}


def look_up_tables(rows: int, mode: core.LidarMode):
    info = core.SensorInfo.from_default(mode)
    beams = np.linspace(22.5, -22.5, rows)
    info.format.pixels_per_column = rows
    info.beam_altitude_angles, info.beam_azimuth_angles = beams, np.zeros(rows)
    info.format.pixel_shift_by_row = [0] * rows
    info.lidar_origin_to_beam_origin_mm = 0.0
    info.beam_to_lidar_transform = info.lidar_to_sensor_transform = np.eye(4)
    return core.XYZLut(info, False), core.XYZLutFloat(info, False), beams


def compare(rows: int, columns: int, mode: core.LidarMode) -> None:
    table, table_float, beams = look_up_tables(rows, mode)
    range_mm = np.random.default_rng(0).integers(1000, 80_000, (rows, columns)).astype(np.uint32)
    azimuth = -2 * np.pi / columns * np.arange(columns)
    grid = PolarGrid(azimuth.astype(np.float32), np.deg2rad(beams).astype(np.float32), np.zeros(rows, np.float32))
    metres = (range_mm * 1e-3).astype(np.float32)
    image = PolarImage(metres, np.zeros_like(metres), np.ones(metres.shape, bool))
    grid, image = jax.device_put((grid, image))

    rays = jax.block_until_ready(directions(grid))
    points_alone = jax.jit(lambda image, grid, rays: polar_to_points(image, grid, rays=rays).xyz_m)

    ours = np.asarray(polar_to_points(image, grid).xyz_m).reshape(rows, columns, 3)
    for name, lut in (("XYZLut", table), ("XYZLutFloat", table_float)):
        theirs = lut(range_mm)
        print(f"largest difference to {name} ({theirs.dtype}): {np.abs(ours - theirs).max() * 1e3:.3f} mm")
    interleave(
        f"polar to points, {rows} x {columns}",
        {
            "jaxsim, kept rays": lambda: jax.block_until_ready(points_alone(image, grid, rays)),
            "jaxsim, any grid": lambda: jax.block_until_ready(points_alone(image, grid, None)),
            "jaxsim, whole Cloud": lambda: jax.block_until_ready(polar_to_points(image, grid, rays=rays)),
            "ouster XYZLut": lambda: table(range_mm),
            "ouster XYZLutFloat": lambda: table_float(range_mm),
        },
        rounds=201,
    )


if __name__ == "__main__":
    for size, lidar_mode in SIZES.items():
        compare(*size, lidar_mode)
