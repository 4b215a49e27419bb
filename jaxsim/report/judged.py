"""The residual cloud of a report: judge frames in 3D, before and after, and their sizes as a table."""

from __future__ import annotations

import numpy as np
from markupsafe import Markup

from jaxsim.discover.curves_and_maps import MAP_COLUMNS
from jaxsim.discover.verdict import JudgeFrame, Result
from jaxsim.frame import Cloud, PolarGrid, PolarImage
from jaxsim.geometry import polar_to_points
from jaxsim.report.charts import colour_limit
from jaxsim.report.page import NOTHING, explorer, paragraph, section, table
from jaxsim.report.scenes import Channel, Side, TurnedScene, packed
from jaxsim.report.words import CHANNELS, number


def residual_clouds(result: Result) -> tuple[Markup, Markup]:
    """The section with the viewer and its table, and the viewer's scenes; nothing where no frame was kept."""
    if not result.frames:
        return NOTHING, NOTHING
    limits = {name: _limit(result, name) for name in CHANNELS}
    channels = [
        Channel(name, f"residual of {name}", -limit, limit, sides.unit, "diverging")
        for name, sides in CHANNELS.items()
        if (limit := limits[name]) is not None
    ]
    if not channels:
        return NOTHING, NOTHING
    rows, columns = len(result.grid.elevation_rad), len(result.grid.azimuth_rad)
    scenes = [_scene(frame, result) for frame in result.frames]
    groups = min(columns, MAP_COLUMNS)
    words = (
        "Frames of judge scenes, which nothing was fitted to: measured points coloured by what is left between "
        "simulation and measurement. Grey: not compared. A lost ray lies where it was simulated."
    )
    label = "Cloud of a judge frame in 3D, coloured by residual"
    body = paragraph(words) + explorer(label, has_map=True) + _table(result)
    return section("Residuals ray by ray", body, name="turn"), packed(
        scenes, channels, rows=rows, columns=columns, groups=groups
    )


def _limit(result: Result, channel: str) -> float | None:
    return colour_limit([side[channel] for one in result.frames for side in (one.before, one.after)])


def title(frame: JudgeFrame) -> str:
    """A frame's name with its scene."""
    return f"{frame.scene}, frame {frame.name}" if frame.scene not in ("", frame.name) else f"frame {frame.name}"


def _scene(frame: JudgeFrame, result: Result) -> TurnedScene:
    picks = {"row": frame.row, "column": frame.column}
    picks |= {f"curve {k}": group for k, group in enumerate(frame.groups)}
    before = Side("before", places(frame, result.grid), frame.before, picks)
    if not result.verdict.effects and not result.verdict.learned:
        return TurnedScene(title(frame), (before,))
    return TurnedScene(title(frame), (before, Side("after", None, frame.after)))


def places(frame: JudgeFrame, grid: PolarGrid) -> np.ndarray:
    """Places of the rays (n, 3), metres in the sensor's axes."""
    shape = (len(grid.elevation_rad), len(grid.azimuth_rad))
    range_m = np.zeros(shape, np.float32)
    range_m[frame.row, frame.column] = frame.range_m
    ones = np.ones(shape, bool)
    cloud: Cloud = polar_to_points(PolarImage(range_m, np.zeros(shape, np.float32), ones), grid)
    return np.asarray(cloud.xyz_m).reshape(*shape, 3)[frame.row, frame.column]


def _table(result: Result) -> Markup:
    """Root mean square residuals of each frame, for who cannot see the cloud."""
    heads = ["frame", "rays"]
    changed = bool(result.verdict.effects or result.verdict.learned)
    for name, sides in CHANNELS.items():
        heads.append(sides.unit if sides.unit.startswith(name) else f"{name}, {sides.unit}")
    rows = []
    for frame in result.frames:
        row = [title(frame), str(len(frame.row))]
        for name in CHANNELS:
            sizes = [
                number(_size(side[name])) for side in ((frame.before, frame.after) if changed else (frame.before,))
            ]
            row.append(" → ".join(sizes))
        rows.append(row)
    return paragraph(
        f"Root mean square residual of the rays that were compared{', before → after' if changed else ''}:"
    ) + table(heads, rows, text=1)


def _size(values: np.ndarray) -> float:
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if known.size else float("nan")
