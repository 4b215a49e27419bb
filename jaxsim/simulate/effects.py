"""Effects of a sensor model on simulated frames."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import jax
import numpy as np

from jaxsim.effects import scan_of
from jaxsim.effects.chain import SensorModel
from jaxsim.frame import Array, Painted, PolarGrid, PolarImage
from jaxsim.simulate.paired import rasters


def with_effects(
    model: SensorModel, image: PolarImage, painted: Painted, grid: PolarGrid, *, key: Array, time_s: float = 0.0
) -> PolarImage:
    """One simulated frame (rows, columns) as a sensor with these effects reports it (host memory).

    `time_s` counts from the recording's first frame. The effects see what the polar frame's file holds, so that
    effects which `discover` found in files act here on the same rays.
    """
    scan = scan_of(grid, [jax.tree.map(np.asarray, image)], [rasters(painted, grid)])
    scan = replace(scan, time_s=np.full(1, time_s, np.float32))
    return jax.tree.map(lambda leaf: leaf[0], model.simulate(scan, key))


def settle_sensor(out: Path, model: SensorModel | None) -> None:
    """Keeps the sensor model beside the frames it made, as OUT/sensor.json.

    Raises ValueError where OUT holds frames of another model.
    """
    path, frames = out / "sensor.json", any((out / "polar").glob("*.npz"))
    kept = SensorModel.load(path) if path.is_file() else None
    if (frames or kept) and kept != model:
        was, now = ("no sensor model" if m is None else ", ".join(n for n, _ in m.effects) for m in (kept, model))
        raise ValueError(
            f"simulate: {out} holds frames made with {was or 'an empty model'}, this run has {now or 'an empty model'} "
            "or other parameters; give another --out, or the same --sensor to resume"
        )
    if model is not None and kept is None:
        model.save(path)
