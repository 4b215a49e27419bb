"""Shapes of Mitsuba, placed; and two kinds of mesh: rounded bodies (cars) and crumpled balls (leaves)."""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np


def box(centre_xy: tuple[float, float], size: tuple[float, float, float], bottom_m: float, yaw_rad: float = 0.0) -> Any:
    """A cube of Mitsuba, stretched to `size` (m), standing on `bottom_m`."""
    place = _place(centre_xy, bottom_m + size[2] / 2, yaw_rad).scale([s / 2 for s in size])
    return mi.load_dict({"type": "cube", "to_world": place})


def ground(centre_xy: tuple[float, float], size: tuple[float, float], height_m: float, yaw_rad: float = 0.0) -> Any:
    """A level rectangle."""
    place = _place(centre_xy, height_m, yaw_rad).scale([size[0] / 2, size[1] / 2, 1])
    return mi.load_dict({"type": "rectangle", "to_world": place})


def pane(centre: tuple[float, float, float], size: tuple[float, float], facing_rad: float) -> Any:
    """An upright rectangle, width and height (m), whose normal points to the azimuth `facing_rad`."""
    place = _place(centre[:2], centre[2], facing_rad).rotate([0, 0, 1], 90).rotate([1, 0, 0], 90)
    return mi.load_dict({"type": "rectangle", "to_world": place.scale([size[0] / 2, size[1] / 2, 1])})


def pole(start: tuple[float, float, float], end: tuple[float, float, float], radius_m: float) -> Any:
    """A cylinder without caps."""
    return mi.load_dict({"type": "cylinder", "p0": list(start), "p1": list(end), "radius": radius_m})


def disc(centre: tuple[float, float, float], radius_m: float, facing_rad: float | None) -> Any:
    """A disc that faces an azimuth, or up if that is None."""
    place = _place(centre[:2], centre[2], facing_rad or 0.0)
    if facing_rad is not None:
        place = place.rotate([0, 1, 0], 90)
    return mi.load_dict({"type": "disk", "to_world": place.scale(radius_m)})


def ball(centre: tuple[float, float, float], radius_m: float) -> Any:
    return mi.load_dict({"type": "sphere", "center": list(centre), "radius": radius_m})


def body(centre: tuple[float, float, float], size: tuple[float, float, float], yaw_rad: float) -> Any:
    """A box with rounded edges (superellipsoid of exponent 5) as a mesh of flat faces."""
    direction = _sphere(28, 48)
    rounded = direction / (np.abs(direction) ** 5).sum(-1, keepdims=True) ** 0.2
    turn = np.array([[np.cos(yaw_rad), -np.sin(yaw_rad), 0], [np.sin(yaw_rad), np.cos(yaw_rad), 0], [0, 0, 1]])
    return _mesh(rounded * (np.array(size) / 2) @ turn.T + np.array(centre))


def crown(rng: np.random.Generator, centre: tuple[float, float, float], radii: tuple[float, float, float]) -> Any:
    """A ball whose surface is pushed in and out by 15 %: leaves of a tree or a hedge."""
    direction = _sphere(24, 40)
    push = 1 + 0.15 * rng.normal(size=(*direction.shape[:2], 1))
    push[:, -1] = push[:, 0]
    push[0], push[-1] = 1.0, 1.0
    return _mesh(direction * push * np.array(radii) + np.array(centre))


def relief(height_m: np.ndarray, cell_m: float) -> Any:
    """A height field about the origin as a mesh, `cell_m` between its points."""
    n, m = height_m.shape
    x, y = np.meshgrid((np.arange(n) - n / 2) * cell_m, (np.arange(m) - m / 2) * cell_m, indexing="ij")
    return _mesh(np.stack([x, y, height_m], -1))


def _sphere(rows: int, columns: int) -> np.ndarray:
    """Unit vectors (rows + 1, columns + 1, 3) from pole to pole, all round and closed."""
    polar = np.linspace(0, np.pi, rows + 1)[:, None]
    around = np.linspace(0, 2 * np.pi, columns + 1)[None]
    return np.stack([np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar) + 0 * around], -1)


def _mesh(points: np.ndarray) -> Any:
    """A grid (n, m, 3) of points as triangles."""
    n, m = points.shape[:2]
    at = np.arange(n * m).reshape(n, m)
    a, b, c, d = at[:-1, :-1].ravel(), at[1:, :-1].ravel(), at[1:, 1:].ravel(), at[:-1, 1:].ravel()
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    mesh = mi.Mesh("mesh", n * m, len(faces))
    content = mi.traverse(mesh)
    content["vertex_positions"] = points.reshape(-1).astype(np.float32)
    content["faces"] = faces.reshape(-1).astype(np.uint32)
    content.update()
    return mesh


def _place(centre_xy: tuple[float, float], height_m: float, yaw_rad: float) -> Any:
    place = mi.ScalarTransform4f().translate([float(centre_xy[0]), float(centre_xy[1]), float(height_m)])
    return place.rotate([0, 0, 1], float(np.rad2deg(yaw_rad)))
