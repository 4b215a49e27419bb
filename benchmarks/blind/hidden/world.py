"""Solids of a street and the ray caster.

A solid is convex (half-spaces), a standing cylinder or an ellipsoid; the ground is the plane z = 0. Letters: o ray
origin (m), d unit direction, t range (m), n outward unit normal. Rays are sorted by azimuth once; a solid meets only
the rays of the azimuth interval that its footprint covers, which makes a frame a matter of tens of milliseconds.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

ROAD, SIDEWALK, BUILDING, WALL, FENCE, POLE, LIGHT, SIGN = 7, 8, 11, 12, 13, 17, 19, 20
VEGETATION, TERRAIN, PERSON, RIDER, CAR, TRUCK, BUS, MOTORCYCLE, BICYCLE = 21, 22, 24, 25, 26, 27, 28, 32, 33


class Solid(NamedTuple):
    """kind 'convex': shape (k, 4) rows n, n·x; 'cylinder': x, y, radius, bottom, top; 'ellipsoid': centre, radii."""

    kind: str
    shape: np.ndarray
    footprint: np.ndarray  # (k, 2) m, corners of the convex outline seen from above
    semantic: int
    instance: int


@dataclass
class World:
    """Street frame: x along the street (m), y left, z up, road surface at z = 0."""

    road_half_m: float
    sidewalk_half_m: float
    crossing_m: float
    solids: list[Solid] = field(default_factory=list)


class Hits(NamedTuple):
    """One entry a ray; range inf and semantic 23 (sky) where it meets nothing within reach."""

    range_m: np.ndarray
    normal: np.ndarray
    semantic: np.ndarray
    instance: np.ndarray
    point: np.ndarray


def prism(outline_xz: np.ndarray, width_m: float, centre_xy, yaw_rad: float, semantic: int, instance: int) -> Solid:
    """Convex outline in the x-z plane (counter-clockwise seen from -y), extruded to +-width/2 along y, then yawed."""
    p = np.asarray(outline_xz, float)
    edge = np.roll(p, -1, 0) - p
    n = np.stack([edge[:, 1], np.zeros(len(p)), -edge[:, 0]], 1)
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    d = n[:, 0] * p[:, 0] + n[:, 2] * p[:, 1]
    n = np.concatenate([n, [[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]]])
    d = np.concatenate([d, [width_m / 2, width_m / 2]])
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    n = n @ turn.T
    centre = np.array([centre_xy[0], centre_xy[1], 0.0])
    lo, hi = p[:, 0].min(), p[:, 0].max()
    corners = np.array([[lo, -1.0], [hi, -1.0], [hi, 1.0], [lo, 1.0]]) * [1.0, width_m / 2]
    footprint = corners @ turn[:2, :2].T + centre[:2]
    return Solid("convex", np.concatenate([n, (d + n @ centre)[:, None]], 1), footprint, semantic, instance)


def box(centre_xy, size_xy, bottom_m: float, top_m: float, yaw_rad: float, semantic: int, instance: int) -> Solid:
    h = size_xy[0] / 2
    outline = np.array([[-h, bottom_m], [h, bottom_m], [h, top_m], [-h, top_m]])
    return prism(outline, size_xy[1], centre_xy, yaw_rad, semantic, instance)


def cylinder(centre_xy, radius_m: float, bottom_m: float, top_m: float, semantic: int, instance: int) -> Solid:
    x, y = centre_xy
    around = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * radius_m
    shape = np.array([x, y, radius_m, bottom_m, top_m])
    return Solid("cylinder", shape, around + np.array([x, y]), semantic, instance)


def ellipsoid(centre, radii, semantic: int, instance: int) -> Solid:
    around = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * np.asarray(radii[:2])
    return Solid("ellipsoid", np.concatenate([centre, radii]), around + np.asarray(centre[:2]), semantic, instance)


def _meet(solid: Solid, o: np.ndarray, d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First range (inf = missed) and normal of the rays that enter the solid from outside."""
    if solid.kind == "convex":
        n, h = solid.shape[:, :3], solid.shape[:, 3]
        slope = d @ n.T
        gap = h - o @ n.T
        with np.errstate(divide="ignore", invalid="ignore"):
            t = gap / slope
        enter = np.where(slope < 0, t, -np.inf)
        enter[(slope == 0) & (gap < 0)] = np.inf
        leave = np.where(slope > 0, t, np.inf).min(1)
        face = enter.argmax(1)
        first = enter[np.arange(len(d)), face]
        return np.where((first > 0.05) & (first < leave), first, np.inf), n[face]
    if solid.kind == "cylinder":
        x, y, radius, low, high = solid.shape
        q, e = o[:, :2] - [x, y], d[:, :2]
        a, b = (e * e).sum(1), (q * e).sum(1)
        root = b * b - a * ((q * q).sum(1) - radius**2)
        t = (-b - np.sqrt(np.maximum(root, 0))) / np.maximum(a, 1e-12)
        z = o[:, 2] + t * d[:, 2]
        good = (root > 0) & (t > 0.05) & (z >= low) & (z <= high)
        n = np.zeros_like(d)
        n[:, :2] = (q + t[:, None] * e) / radius
        return np.where(good, t, np.inf), n
    centre, radii = solid.shape[:3], solid.shape[3:]
    q, e = (o - centre) / radii, d / radii
    a, b = (e * e).sum(1), (q * e).sum(1)
    root = b * b - a * ((q * q).sum(1) - 1)
    t = (-b - np.sqrt(np.maximum(root, 0))) / a
    n = (q + t[:, None] * e) / radii
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    return np.where((root > 0) & (t > 0.05), t, np.inf), n


def _ground(world: World, o: np.ndarray, d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.where(d[:, 2] < 0, -o[:, 2] / d[:, 2], np.inf)
    x, y = (o[:, :2] + np.where(np.isfinite(t), t, 0)[:, None] * d[:, :2]).T
    side = np.abs(y)
    across = np.abs(x - world.crossing_m) < world.road_half_m
    kind = np.where(side < world.sidewalk_half_m, SIDEWALK, TERRAIN)
    return t, np.where((side < world.road_half_m) | across, ROAD, kind)


def _bump(normal: np.ndarray, d: np.ndarray, point: np.ndarray, semantic: np.ndarray) -> np.ndarray:
    """Leaves and grass are rough: smooth waves of 0.5 to 2 m tilt the normal, the same for every view of the place."""
    amount = np.where(semantic == VEGETATION, 0.6, np.where(semantic == TERRAIN, 0.1, 0.0))
    at = amount > 0
    if not at.any():
        return normal
    p = point[at]
    waves = np.array([[3.1, 5.3, 2.2], [4.7, -2.9, 3.9], [-2.3, 3.7, 6.1]])
    tilt = np.sin(p @ waves.T + [0.3, 1.1, 2.5]) + 0.5 * np.sin(2.1 * (p @ waves[::-1].T))
    out = normal.copy()
    leaf = out[at] + amount[at, None] * tilt
    facing = -(leaf * d[at]).sum(1)
    leaf -= np.maximum(0.03 - facing, 0)[:, None] * d[at]
    out[at] = leaf / np.linalg.norm(leaf, axis=1, keepdims=True)
    return out


def cast(world: World, origin: np.ndarray, direction: np.ndarray, reach_m: float = 120.0) -> Hits:
    """Nearest surface along every ray.

    Args:
        origin: (n, 3) m, street frame; all origins lie within a metre or two of each other.
        direction: (n, 3) unit vectors.
        reach_m: farther surfaces count as nothing.
    """
    azimuth = np.arctan2(direction[:, 1], direction[:, 0])
    order = np.argsort(azimuth, kind="stable")
    azimuth, o, d = azimuth[order], origin[order], direction[order]
    best, kind = _ground(world, o, d)
    best = np.where(best < reach_m, best, np.inf)
    semantic = np.where(np.isfinite(best), kind, 23)
    instance = np.zeros(len(d), int)
    normal = np.zeros_like(d)
    normal[:, 2] = 1.0
    eye = o[:, :2].mean(0)
    spread = np.linalg.norm(o[:, :2] - eye, axis=1).max()
    for solid in world.solids:
        for part in _covered(solid, eye, spread, azimuth):
            t, n = _meet(solid, o[part], d[part])
            near = (t < best[part]) & (t < reach_m)
            if near.any():
                at = np.arange(part.start, part.stop)[near]
                best[at], normal[at] = t[near], n[near]
                semantic[at], instance[at] = solid.semantic, solid.instance
    point = o + np.where(np.isfinite(best), best, 0)[:, None] * d
    normal = _bump(normal, d, point, semantic)
    back = np.empty(len(order), int)
    back[order] = np.arange(len(order))
    return Hits(best[back], normal[back], semantic[back], instance[back], point[back])


def _covered(solid: Solid, eye: np.ndarray, spread: float, azimuth: np.ndarray) -> list[slice]:
    """Slices of the sorted azimuths that the solid's outline can cover, seen from within `spread` of `eye`."""
    gap = _distance_to(solid.footprint, eye)
    if gap < spread + 0.5:
        return [slice(0, len(azimuth))]
    away = solid.footprint - eye
    toward = away.mean(0)
    middle = np.arctan2(toward[1], toward[0])
    turn = np.angle(np.exp(1j * (np.arctan2(away[:, 1], away[:, 0]) - middle)))
    slack = np.arcsin(min(1.0, spread / max(gap, 1e-6))) + 1e-3
    low, high = middle + turn.min() - slack, middle + turn.max() + slack
    if high - low >= 2 * np.pi:
        return [slice(0, len(azimuth))]
    out = []
    for shift in (-2 * np.pi, 0.0, 2 * np.pi):
        a, b = np.searchsorted(azimuth, [low + shift, high + shift])
        if b > a:
            out.append(slice(int(a), int(b)))
    return out


def _distance_to(outline: np.ndarray, eye: np.ndarray) -> float:
    """Distance from a point to a convex outline (0 inside)."""
    start, step = outline, np.roll(outline, -1, 0) - outline
    share = np.clip(((eye - start) * step).sum(1) / np.maximum((step * step).sum(1), 1e-12), 0, 1)
    edge = np.hypot(*(start + share[:, None] * step - eye).T).min()
    cross = step[:, 0] * (eye - start)[:, 1] - step[:, 1] * (eye - start)[:, 0]
    return 0.0 if (cross >= 0).all() or (cross <= 0).all() else float(edge)
