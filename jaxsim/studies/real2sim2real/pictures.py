"""Pictures of Real2Sim2Real, from above: one frame as every kind of cloud, and what each detector finds in one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import UInt8

from jaxsim.detect.results import Found
from jaxsim.detect.scenes import Scene
from jaxsim.report.boxes import draw_above
from jaxsim.report.pictures import beside
from jaxsim.studies.real2sim2real.settings import Loop

Rgb = UInt8[np.ndarray, "h w 3"]
PANEL = 620
"""Height of a cloud from above, pixels."""


def draw_kinds(loop: Loop, scenes: Mapping[str, Sequence[Scene]]) -> dict[str, Rgb]:
    """One frame of the renderer as each kind of cloud, labelled; nothing where no frame is in all of them."""
    kinds, span = loop.config.kinds, loop.config.detector.voxels.range_m
    shared = set.intersection(*({scene.name for scene in scenes[kind]} for kind in kinds))
    if not shared:
        return {}
    name = max((scene for scene in scenes[kinds[0]] if scene.name in shared), key=count_objects).name
    panels = []
    for kind in kinds:
        scene = next(s for s in scenes[kind] if s.name == name)
        title = f"{kind}: {len(scene.points)} points"
        nothing = Found(np.zeros((0, 7), np.float32), np.zeros(0, np.float32))
        panels.append(_panel(scene, span, nothing, title=title))
    return {"clouds": _grid(panels)}


def draw_found(loop: Loop, real: Scene, found: Mapping[str, Found]) -> dict[str, Rgb]:
    """A real frame, and what the detector of each kind of cloud finds in it."""
    span = loop.config.detector.voxels.range_m
    return {"found": _grid([_panel(real, span, found[kind], title=f"trained on {kind}") for kind in loop.trained])}


def _panel(scene: Scene, span: tuple[float, ...], found: Found, *, title: str) -> Rgb:
    labelled = scene.boxes[scene.target]
    return draw_above(
        scene.points, span, found=found.boxes, score=found.score, labelled=labelled, title=title, height=PANEL
    )


def _grid(panels: Sequence[Rgb], *, across: int = 3) -> UInt8[np.ndarray, "rows columns 3"]:
    """Panels of one size in rows."""
    rows = [beside(panels[k : k + across]) for k in range(0, len(panels), across)]
    width = max(row.shape[1] for row in rows)
    return np.concatenate([np.pad(row, ((0, 4), (0, width - row.shape[1]), (0, 0))) for row in rows])


def count_objects(scene: Scene) -> int:
    """Labels of a scene that count: of the class, at some difficulty."""
    return int((scene.target & (scene.difficulty >= 0)).sum())
