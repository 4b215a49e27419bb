"""A page of clouds that turn: simulated beside measured ones, and clouds with boxes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float, Float32
from markupsafe import Markup

from jaxsim.files import write_text
from jaxsim.report.page import NOTHING, explorer, paragraph, section, table, whole_page
from jaxsim.report.scenes import Channel, Side, TurnedBoxes, TurnedScene, packed

BRIGHT = 0.6
"""Intensity at which colours end: few surfaces are brighter."""
CHANNELS = (
    Channel("intensity", "intensity", 0.0, BRIGHT, ""),
    Channel("height", "height over the sensor", -2.5, 2.5, "m"),
    Channel("range", "distance", 0.0, 60.0, "m"),
)


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
    found: Float[np.ndarray, "d 7"],
    labelled: Float[np.ndarray, "g 7"] | None = None,
) -> TurnedScene:
    """A cloud with what was found in it (orange) and what is labelled (green)."""
    boxes = (
        TurnedBoxes(np.asarray(found, float), True),
        *([] if labelled is None else [TurnedBoxes(np.asarray(labelled), False)]),
    )
    return TurnedScene(name, (side_of("cloud", points),), boxes)


def turning(scenes: Sequence[TurnedScene], words: str) -> tuple[Markup, Markup]:
    """A section with the viewer and a table of what it shows, and its scenes; nothing where there is none."""
    if not scenes:
        return NOTHING, NOTHING
    heads = ["scene", "points", "boxes found", "labelled"]
    rows = [
        [
            scene.name,
            " | ".join(f"{side.name} {len(side.xyz)}" for side in scene.sides if side.xyz is not None),
            *(str(sum(len(one.boxes) for one in scene.boxes if one.found is found)) for found in (True, False)),
        ]
        for scene in scenes
    ]
    body = paragraph(words) + explorer(words, has_map=False) + table(heads, rows, text=2)
    return section("The clouds", body), packed(scenes, CHANNELS)


def write_clouds(
    path: Path,
    scenes: Sequence[TurnedScene],
    *,
    title: str,
    sentence: str,
    words: str,
    facts: Sequence[tuple[str, str]] = (),
) -> Path:
    """Writes a page that opens from disk and turns the scenes; `words` say what they show."""
    body, packed_scenes = turning(scenes, words)
    page = whole_page(title=title, sentence=sentence, facts=facts, sections=[body], scenes=packed_scenes)
    return write_text(path, page)
