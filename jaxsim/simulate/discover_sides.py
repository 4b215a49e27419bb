"""The two sides that `discover` compares, as folders of polar frames: simulated frames and the scans of the drive that
they are of; or Lambert's law, the plainest simulator there is, on the very ranges that were measured."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from jaxsim.data import Dataset
from jaxsim.data.polar_frames import about_frame, frame_names, open_polar_frames, write_frame, write_grid
from jaxsim.files import check_apart, read_arrays
from jaxsim.frame import LOST_BELOW, Array, Frame, PolarImage
from jaxsim.geometry import incidence, scan_on_window
from jaxsim.simulate.frames import BATCH, motion_of, rasters, simulate_batch, take
from jaxsim.simulate.learned_sensor import LearnedSensor
from jaxsim.simulate.predict import NetworkWindow

SOURCE = "jaxsim discover"
"""What frames that are written for a comparison say they are made of."""
REFLECTANCE = np.float32(0.3)
"""Of every surface, whatever its distance, and without gloss."""
SLANT_COS = np.float32(0.5)
"""Where no neighbour tells how a surface lies: it is seen at a slant of 60 degrees."""


def measured_in(window: NetworkWindow, frame: Frame, *, lines: int) -> PolarImage:
    """The frame's own scan on a run's window (host memory); `lines` are all those of the sensor.

    Raises ValueError where the cloud has no laser lines.
    """
    grid, row_share = window
    if frame.cloud is None:
        raise ValueError(f"{frame.name}: no LiDAR measured it; hold the run against a data set that has scans")
    if frame.cloud.row is None:
        raise ValueError(f"{frame.name}: the cloud has no laser lines; give it cloud.row (recover_rows)")
    return scan_on_window(frame.cloud, grid, row_share, lines=lines)


def comparable(measured: PolarImage, seen: Array) -> PolarImage:
    """What a run can be compared with: returns on cells that the camera saw. Those whose intensity rounds to 0 count
    as lost, as they do in training: the network's 0 stands for both."""
    return replace(measured, valid=measured.valid & (measured.intensity >= LOST_BELOW) & np.asarray(seen))


def refuse_others(folder: Path, names: Sequence[str]) -> None:
    """Raises ValueError where a folder that frames are to be written to holds others, of another comparison, or such of
    these names that no comparison wrote, and that would be lost."""
    if others := sorted({*frame_names(folder)} - {*names}):
        raise ValueError(
            f"discover: {folder} holds other frames ({', '.join(others[:3])} ...); give another --out, or remove it"
        )
    for name in frame_names(folder):
        if str(read_arrays(folder / f"{name}.npz", ("source",), by="discover").get("source", "")) != SOURCE:
            raise ValueError(
                f"discover: {folder / name}.npz is no frame that a comparison wrote, and would be written over; give "
                "another --out"
            )


def write_both_sides(
    learned: LearnedSensor,
    dataset: Dataset,
    positions: Sequence[int],
    *,
    out: Path,
    log: Callable[[str], None] = lambda line: None,
) -> tuple[Path, Path]:
    """Simulates frames of a data set with a run and writes them to OUT/simulated, and the scans themselves, on the
    same polar window, to OUT/measured. Returns the two folders.

    The simulated frames are what the run reports: the range of the camera's dense depth (given, or completed from the
    scan itself: `PrepareConfig.depth`), the network's intensity, and no return where that is 0. Only cells that the
    camera saw hold anything on either side. grid.json names each frame's drive, and time, speed and heading where they
    are known of all frames.

    Raises ValueError where the folders hold frames of another comparison.
    """
    names = [dataset.name_of(p) for p in positions]
    folders = out / "simulated", out / "measured"
    for folder in folders:
        refuse_others(folder, names)
    window, lines = learned.window, learned.run.spec.rows
    about: dict[str, dict[str, Any]] = {}
    for first in range(0, len(positions), BATCH):
        frames = [dataset[p] for p in positions[first : first + BATCH]]
        images, painted, _ = simulate_batch(learned, frames, min(BATCH, len(positions)))
        for k, frame in enumerate(frames):
            image, under = take((images, painted), k)
            write_frame(folders[0], frame.name, image, **rasters(under, window[0]), source=SOURCE)
            scan = measured_in(window, frame, lines=lines)
            write_frame(folders[1], frame.name, comparable(scan, under.valid), source=SOURCE)
            about[frame.name] = about_frame(frame.scene, **motion_of(frame, 0.0))
        log(f"{len(about)} of {len(positions)} frames simulated")
    # `scan_of` takes what a frame does not say for 0: it is given for all frames, or for none.
    for key in ("time", "speed", "heading"):
        lacking = [name for name, entry in about.items() if key not in entry]
        if 0 < len(lacking) < len(about):
            log(f"{len(lacking)} of {len(about)} frames do not say their {key} ({lacking[0]} ...): it is left out")
            for entry in about.values():
                entry.pop(key, None)
    for folder in folders:
        write_grid(folder, window[0], frames=about)
    return folders


def write_lambert(measured: Path, out: Path) -> Path:
    """Writes what Lambert's law says of a folder's polar frames to OUT/simulated, and returns that folder.

    Ranges, returns and labels are the measured ones; the incidence is that of the range image, and a right angle where
    that does not tell it. Raises ValueError where OUT/simulated is the measured folder, or holds other frames.
    """
    simulated = out / "simulated"
    check_apart(simulated, measured, by="discover: --lambert")
    frames = open_polar_frames(measured)
    refuse_others(simulated, frames.names)
    for name in frames.names:
        image, more = frames.read(name)
        labels = {key: more[key] for key in ("semantic", "instance") if key in more}
        angles, where = incidence(image.range_m, image.valid, frames.grid)
        angle = np.asarray(angles)
        has_normal = np.asarray(where)
        shade = np.where(has_normal, np.cos(angle), SLANT_COS)
        # Shaded as at 60 degrees, yet told as a right angle: that stands for what cannot be told in training pairs,
        # too.
        angle = np.where(has_normal, angle, np.float32(np.pi / 2))
        shaded = replace(image, intensity=REFLECTANCE * shade)
        write_frame(simulated, name, shaded, incidence=angle, source=SOURCE, **labels)
    write_grid(simulated, frames.grid, frames=frames.about)
    return simulated
