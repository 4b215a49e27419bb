"""How real and simulated clouds of other streets differ, short of a detector: points on objects, histograms, drop maps.

Clouds of other streets cannot be compared point by point. What is compared is what a detector lives on: how many points
an object has at its distance, how range, height and intensity are distributed on each class, and which share of the
directions returns anything.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float
from scipy.stats import wasserstein_distance

from jaxsim.geometry import pad_points, room_for
from jaxsim.geometry.boxes import points_in_boxes

DISTANCES_M = ((0.0, 15.0), (15.0, 30.0), (30.0, 45.0), (45.0, 80.0))
"""Bands of an object's distance in which its points are counted."""
EDGES: dict[str, Float[np.ndarray, " n"]] = {
    "range": np.linspace(0, 80, 81),
    "height": np.linspace(-3, 3, 61),
    "intensity": np.linspace(0, 1, 101),
}
"""Bins: metres from the LiDAR, metres above it, 0..1."""
ELEVATION_DEG, AZIMUTH_DEG = np.linspace(4, -16, 43), np.linspace(42, -42, 169)
"""Borders of the drop map's cells, 10/21 of a degree high and half a degree wide: what a KITTI camera sees of a
scan."""
REST = "rest"
"""Points on no object."""


@dataclass
class CloudCounts:
    """Sums over the scenes of one kind of cloud."""

    scenes: int = 0
    points: int = 0
    histograms: dict[str, dict[str, np.ndarray]] = field(default_factory=dict)
    """Class -> quantity -> counts in EDGES."""
    on_objects: dict[str, dict[tuple[float, float], list[int]]] = field(default_factory=dict)
    """Class -> band of distance -> points on each object."""
    returns: np.ndarray = field(default_factory=lambda: np.zeros((len(ELEVATION_DEG) - 1, len(AZIMUTH_DEG) - 1)))
    """Scenes with a return in each cell of elevation and azimuth."""

    def add(
        self,
        points: Float[np.ndarray, "n 4"],
        boxes: Float[np.ndarray, "g 7"],
        kinds: Sequence[str],
        *,
        range_m: Float[np.ndarray, " 6"] | None = None,
    ) -> None:
        """Counts one scene: x, y, z (m, `velo`), intensity 0..1; its objects' boxes in `velo` and classes.

        `range_m` (x, y, z from, then to) is what the points were cut to: an object whose middle lies outside it is not
        counted as one with few points.
        """
        self.scenes += 1
        self.points += len(points)
        inside = _inside(points, boxes)
        distance = np.linalg.norm(boxes[:, :2], axis=1)
        whole = np.ones(len(boxes), bool)
        if range_m is not None:
            whole = np.asarray(((boxes[:, :3] >= range_m[:3]) & (boxes[:, :3] <= range_m[3:])).all(axis=1))
        for k, kind in enumerate(kinds):
            for band in DISTANCES_M if whole[k] else ():
                if band[0] <= distance[k] < band[1]:
                    self.on_objects.setdefault(kind, {}).setdefault(band, []).append(int(inside[:, k].sum()))
        names = np.array([*kinds, REST])
        # A point in two boxes counts for the first; one in none is the last name's, REST.
        owner = np.where(inside.any(axis=1), inside.argmax(axis=1), len(kinds)) if len(kinds) else np.zeros(len(points))
        values = {"range": np.linalg.norm(points[:, :3], axis=1), "height": points[:, 2], "intensity": points[:, 3]}
        for kind in {*names.tolist()}:
            mine = names[owner.astype(int)] == kind
            table = self.histograms.setdefault(kind, {name: np.zeros(len(edges) - 1) for name, edges in EDGES.items()})
            # Beyond the edges counts for the outermost bins: nothing is lost from a distribution.
            for name, edges in EDGES.items():
                table[name] += np.histogram(np.clip(values[name][mine], edges[0], edges[-1]), edges)[0]
        elevation = np.degrees(np.arctan2(points[:, 2], np.linalg.norm(points[:, :2], axis=1)))
        azimuth = np.degrees(np.arctan2(points[:, 1], points[:, 0]))
        # NumPy wants growing edges; the map has the highest elevation and the leftmost azimuth first.
        cells, _, _ = np.histogram2d(elevation, azimuth, (ELEVATION_DEG[::-1], AZIMUTH_DEG[::-1]))
        self.returns += cells[::-1, ::-1] > 0


def _inside(points: np.ndarray, boxes: np.ndarray) -> np.ndarray:
    """(n, g); filled up to few sizes, for each size is compiled once."""
    xyz, _ = pad_points(points[:, :3], room_for(len(points), 8192))
    filled, _ = pad_points(boxes, room_for(len(boxes), 32))
    return np.asarray(points_in_boxes(xyz, filled))[: len(points), : len(boxes)]


def count_clouds(
    scenes: Iterable[tuple[Float[np.ndarray, "n 4"], Float[np.ndarray, "g 7"], Sequence[str]]],
    *,
    range_m: Float[np.ndarray, " 6"] | None = None,
) -> CloudCounts:
    """Counts scenes of (points, boxes, classes), as `CloudCounts.add`."""
    counts = CloudCounts()
    for points, boxes, kinds in scenes:
        counts.add(points, boxes, kinds, range_m=range_m)
    return counts


def objects_of(counts: CloudCounts, kind: str) -> int:
    """Objects of a class that were counted."""
    return sum(len(points) for points in counts.on_objects.get(kind, {}).values())


def classes_in(counts: Mapping[str, CloudCounts], first: str) -> tuple[str, ...]:
    """Classes of which some cloud holds an object: `first`, then the others from the most frequent on."""
    number = {
        kind: sum(objects_of(of_cloud, kind) for of_cloud in counts.values())
        for of_cloud in counts.values()
        for kind in of_cloud.on_objects
    }
    return (first, *sorted(number.keys() - {first}, key=lambda kind: (-number[kind], kind)))


def distribution_distance(real: CloudCounts, other: CloudCounts, kind: str, *, quantity: str) -> float:
    """Wasserstein distance (order 1) of a class's histograms: metres, or intensity; NaN where one side has no point."""
    sides = [counts.histograms.get(kind, {}).get(quantity) for counts in (real, other)]
    if any(side is None or not side.sum() for side in sides):
        return float("nan")
    middles = (EDGES[quantity][1:] + EDGES[quantity][:-1]) / 2
    return float(wasserstein_distance(middles, middles, *sides))


def drop_map(counts: CloudCounts) -> Float[np.ndarray, "rows columns"]:
    """Share of the scenes in which a cell of elevation and azimuth returns nothing."""
    return 1.0 - counts.returns / max(counts.scenes, 1)


def band_name(band: tuple[float, float]) -> str:
    """`points_0_15` and so on."""
    return f"points_{band[0]:g}_{band[1]:g}"


def compare_clouds(real: CloudCounts, others: Mapping[str, CloudCounts], kind: str) -> dict[str, dict[str, float]]:
    """Kind of cloud (`real` first) -> measure -> value, for one class of object.

    `points` a scene; `objects` of the class; `points_0_15` ...: median on an object of the class at that distance in
    metres; `range_m`, `height_m`, `intensity` and, for all that is on no object, `rest_intensity`: Wasserstein distance
    to real, of the class NaN where either side has no object that was counted, whatever points lie on objects that are
    cut; `empty`: share of the directions without a return, and `empty_off`: mean absolute difference of that share
    to real's.
    """
    table = {}
    for name, counts in {"real": real, **others}.items():
        row = {"points": counts.points / max(counts.scenes, 1), "objects": float(objects_of(counts, kind))}
        for band in DISTANCES_M:
            counted = counts.on_objects.get(kind, {}).get(band, [])
            row[band_name(band)] = float(np.median(counted)) if counted else float("nan")
        counted = all(objects_of(side, kind) for side in (real, counts))
        for measure, quantity in (("range_m", "range"), ("height_m", "height"), ("intensity", "intensity")):
            row[measure] = distribution_distance(real, counts, kind, quantity=quantity) if counted else float("nan")
        row |= {
            "rest_intensity": distribution_distance(real, counts, REST, quantity="intensity"),
            "empty": float(drop_map(counts).mean()),
            "empty_off": float(np.abs(drop_map(counts) - drop_map(real)).mean()),
        }
        table[name] = row
    return table
