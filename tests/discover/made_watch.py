"""What tests of watch are made of."""

import numpy as np

from jaxsim.data.polar_frames import write_frame, write_grid
from jaxsim.frame import PolarGrid, PolarImage

ROWS, COLUMNS, SCENES = 8, 96, 10
GRID = PolarGrid(
    (np.pi - (np.arange(COLUMNS) + 0.5) * 2 * np.pi / COLUMNS).astype("f4"),
    np.linspace(0.1, -0.3, ROWS).astype("f4"),
    np.zeros(ROWS, "f4"),
)


def drives(seed, change=lambda intensity, valid: (intensity, valid), *, unit=1.0):
    """Ten drives through streets of their own brightness, openness and width, three frames each: (scene, frame) and
    image, with ranges in a `unit` of so many metres."""
    rng = np.random.default_rng(seed)
    down = np.clip(-np.asarray(GRID.elevation_rad), 0.02, None)[:, None]
    for scene in range(SCENES):
        bright, full = rng.uniform(0.2, 0.5), rng.uniform(0.6, 0.95)
        road_m = 1.7 * np.exp(rng.normal(0, 0.01)) / np.sin(down)
        side_m = np.abs(rng.uniform(3, 30) / np.sin(np.asarray(GRID.azimuth_rad)))
        seen_m = np.minimum(np.minimum(road_m, side_m), 80)
        for k in range(3):
            intensity = bright * np.exp(rng.normal(0, 0.2, (ROWS, COLUMNS)))
            intensity, valid = change(intensity, rng.random((ROWS, COLUMNS)) < full)
            range_m = np.where(valid, seen_m / unit, 0).astype("f4")
            yield scene, k, PolarImage(range_m, np.clip(intensity, 0, 1).astype("f4"), np.asarray(valid))


def day(folder, seed, *change, **made):
    about = {}
    for scene, k, image in drives(seed, *change, **made):
        name = f"{scene:02d}-{k}"
        about[name] = {"scene": f"drive{scene}"}
        write_frame(folder, name, image)
    write_grid(folder, GRID, frames=about)
    return folder


def dying_beam(intensity, valid):
    intensity[3] *= 0.7
    return intensity, valid
