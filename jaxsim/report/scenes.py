"""Clouds that a page's viewer turns: places in 16 bits, values in 8, as JSON inside the page; and pages of them."""

from __future__ import annotations

import base64
import logging
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Float32, Int, UInt8, UInt16
from jinja2.utils import htmlsafe_json_dumps
from markupsafe import Markup

from jaxsim.files import write_text
from jaxsim.geometry.boxes import corners_of
from jaxsim.report.page import EMPTY, explorer, number, section, shows, table, whole_page
from jaxsim.report.pictures import FOUND, LABEL

_log = logging.getLogger(__name__)
MOST_BYTES = 3_500_000
"""Of all scenes of a page, as they are written: with its figures and tables it stays below four megabytes."""
NOWHERE = 2**16 - 1
"""The group of a ray that is in none."""
GROUND_SHARE = 0.05
"""Share of the points below which the ground is drawn."""
CLOUDS_PAGE = "clouds.html"
BRIGHT = 0.6
"""Intensity at which colours end: few surfaces are brighter."""


@dataclass(frozen=True)
class Channel:
    """What points are coloured by."""

    name: str
    words: str
    low: float
    high: float
    unit: str
    ramp: str = "turbo"
    """turbo, or diverging about the middle."""


SHOWN = (
    Channel("intensity", "intensity", 0.0, BRIGHT, ""),
    Channel("height", "height over the sensor", -2.5, 2.5, "m"),
    Channel("range", "distance", 0.0, 60.0, "m"),
)


@dataclass(frozen=True)
class Side:
    """A cloud, n points; of two sides the first is shown left of the slider, the second right of it."""

    name: str
    xyz: Float[np.ndarray, "n 3"] | None
    """Metres, x ahead, y to the left, z up; None for the first side's points."""
    values: Mapping[str, Float[np.ndarray, " n"]]
    """By channel; NaN where there is none."""
    picks: Mapping[str, Int[np.ndarray, " n"]] = field(default_factory=dict)
    """By what can be picked (`row`, `column`, `curve 0`), the index of each point there; -1 for none."""


@dataclass(frozen=True)
class TurnedBoxes:
    """Boxes of one kind, (x, y, z, length, width, height, yaw)."""

    boxes: Float[np.ndarray, "d 7"]
    detected: bool
    """Or labelled."""


@dataclass(frozen=True)
class TurnedScene:
    """What the viewer shows at a time."""

    name: str
    sides: tuple[Side, ...]
    boxes: tuple[TurnedBoxes, ...] = ()


def packed(
    scenes: Sequence[TurnedScene], channels: Sequence[Channel], *, rows: int = 1, columns: int = 1, groups: int = 1
) -> Markup:
    """The viewer's JSON, at most MOST_BYTES: of larger clouds every second, third ... point is kept, and where boxes
    alone are too many the first scenes are, which is told.

    `rows`, `columns` and `groups` of columns are those of the maps. Raises ValueError for no scene, no channel, and
    a scene whose boxes alone are too many.
    """
    if not scenes or not channels:
        raise ValueError(f"scenes: {len(scenes)} scenes and {len(channels)} channels; a viewer needs one of each")
    grid = {"rows": rows, "columns": columns, "groups": groups}
    told = [_channel(one) for one in channels]

    def with_every(step: int) -> Markup:
        content = {
            "grid": grid,
            "every": step,
            "channels": told,
            "scenes": [_scene(one, channels, step) for one in shown],
        }
        return htmlsafe_json_dumps(content, separators=(",", ":"))

    shown = scenes
    # With a point a side nearly all is boxes, which cannot be thinned.
    while (fixed := len(with_every(sys.maxsize))) > MOST_BYTES:
        if len(shown) == 1:
            raise ValueError(f"scenes: the boxes of {shown[0].name} alone are more than a page holds; show fewer")
        shown = shown[: len(shown) // 2]
        _log.info(f"scenes: the first {len(shown)} of {len(scenes)} fit into the page, with all their boxes")
    step = 1
    while len(text := with_every(step)) > MOST_BYTES:
        step = max(step + 1, round(step * (len(text) - fixed) / max(MOST_BYTES - fixed, 1)))
    return text


def _channel(one: Channel) -> dict[str, str]:
    return {
        "name": one.name,
        "words": one.words,
        "unit": one.unit,
        "ramp": one.ramp,
        "low": number(one.low),
        "high": number(one.high),
    }


def _scene(scene: TurnedScene, channels: Sequence[Channel], step: int) -> dict[str, Any]:
    first = scene.sides[0].xyz
    if first is None:
        raise ValueError(f"scenes: the first side of {scene.name} has no points; only the second may share them")
    ground = float(np.quantile(first[:, 2], GROUND_SHARE)) if len(first) else 0.0
    return {
        "name": scene.name,
        "ground": round(ground, 3),
        "sides": [_side(side, channels, step) for side in scene.sides],
        "boxes": [
            {"corners": np.round(corners, 2).tolist(), "tone": list(FOUND if one.detected else LABEL)}
            for one in scene.boxes
            for corners in corners_of(one.boxes)
        ],
    }


def _side(side: Side, channels: Sequence[Channel], step: int) -> dict[str, Any]:
    plain: dict[str, Any] = {
        "name": side.name,
        "values": {
            one.name: _levels(side.values[one.name], one)[::step] for one in channels if one.name in side.values
        },
    }
    if side.xyz is not None:
        cells, low, size = quantised(np.asarray(side.xyz, float))
        plain |= {"xyz": cells[::step], "low": low.tolist(), "step": size.tolist()}
        plain["picks"] = {
            name: np.where(index < 0, NOWHERE, index).astype("<u2")[::step] for name, index in side.picks.items()
        }
    return _encoded(plain)


def _encoded(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return base64.b64encode(np.ascontiguousarray(value).tobytes()).decode()
    return {name: _encoded(one) for name, one in value.items()} if isinstance(value, dict) else value


def quantised(
    xyz: Float[np.ndarray, "n 3"],
) -> tuple[UInt16[np.ndarray, "n 3"], Float[np.ndarray, " 3"], Float[np.ndarray, " 3"]]:
    """Places as 16-bit integers, the place of 0 and the step of each axis: off by half a step at most."""
    if not len(xyz):
        return np.zeros((0, 3), "<u2"), np.zeros(3), np.ones(3)
    low = xyz.min(0)
    step = np.maximum((xyz.max(0) - low) / (2**16 - 1), 1e-9)
    return np.round((xyz - low) / step).astype("<u2"), low, step


def _levels(values: Float[np.ndarray, " n"], channel: Channel) -> UInt8[np.ndarray, " n"]:
    """1 to 255 from low to high, beyond them the ends; 0 where there is no value."""
    share = (np.asarray(values, float) - channel.low) / (channel.high - channel.low)
    known = np.isfinite(share)
    return np.where(known, 1 + np.round(254 * np.clip(np.where(known, share, 0), 0, 1)), 0).astype(np.uint8)


def side_of(name: str, points: Float32[np.ndarray, "n 4"]) -> Side:
    """A cloud (x, y, z in metres, intensity 0..1) for the viewer."""
    xyz = np.asarray(points[:, :3], float)
    distance = np.linalg.norm(xyz, axis=1)
    return Side(name, xyz, {"intensity": points[:, 3].astype(float), "height": xyz[:, 2], "range": distance})


def compared_clouds(
    name: str, simulated: Float32[np.ndarray, "n 4"], measured: Float32[np.ndarray, "m 4"]
) -> TurnedScene:
    """A frame as it was simulated beside its measured cloud; alone where nothing was measured."""
    sides = (side_of("simulated", simulated), side_of("measured", measured))
    return TurnedScene(name, sides if len(measured) else sides[:1])


def cloud_with_boxes(
    name: str,
    points: Float32[np.ndarray, "n 4"],
    *,
    detected: Float[np.ndarray, "d 7"],
    labelled: Float[np.ndarray, "g 7"] | None = None,
) -> TurnedScene:
    """A cloud with what was found in it (orange) and what is labelled (green)."""
    boxes = (
        TurnedBoxes(np.asarray(detected, float), True),
        *([] if labelled is None else [TurnedBoxes(np.asarray(labelled), False)]),
    )
    return TurnedScene(name, (side_of("cloud", points),), boxes)


def turning(scenes: Sequence[TurnedScene], words: str) -> tuple[Markup, Markup]:
    """A section with the viewer and a table of what it shows, and its scenes; nothing where there is none."""
    if not scenes:
        return EMPTY, EMPTY
    kinds = [("boxes found", True), ("labelled", False)] if any(scene.boxes for scene in scenes) else []
    rows = [
        [
            shows(scene.name, scene=k),
            " | ".join(f"{side.name} {len(side.xyz)}" for side in scene.sides if side.xyz is not None),
            *(str(sum(len(one.boxes) for one in scene.boxes if one.detected is detected)) for _, detected in kinds),
        ]
        for k, scene in enumerate(scenes)
    ]
    heads = ["scene", "points", *(head for head, _ in kinds)]
    viewer = explorer(words, has_map=False)
    return section("The clouds", words, viewer, table(heads, rows, text=2)), packed(scenes, SHOWN)


def write_clouds(path: Path, scenes: Sequence[TurnedScene], *, title: str, sentence: str, words: str) -> Path:
    """Writes a page that opens from disk and turns the scenes; `words` say what they show."""
    body, packed_scenes = turning(scenes, words)
    page = whole_page(title=title, sentence=sentence, facts=(), sections=[body], scenes=packed_scenes)
    return write_text(path, page)
