"""A scene: one triangle mesh whose faces know their material and their object, and the caster of rays into it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import trimesh
from trimesh.ray.ray_pyembree import RayMeshIntersector

from benchmarks.blind.raycast.materials import NAMES

REACH_M = 150.0


class Hits(NamedTuple):
    """One entry a ray; range inf, material -1 and thing 0 where it meets nothing within reach."""

    range_m: np.ndarray
    cos: np.ndarray
    normal: np.ndarray
    material: np.ndarray
    thing: np.ndarray
    point: np.ndarray


class Scene:
    """Boxes, cylinders and spheres, z up, m. Fill it with the methods below, then `cast`."""

    def __init__(self) -> None:
        self._meshes: list[trimesh.Trimesh] = []
        self._material: list[np.ndarray] = []
        self._thing: list[np.ndarray] = []
        self._things = 0
        self._caster: RayMeshIntersector | None = None

    def new_thing(self) -> int:
        """The number of a further object."""
        self._things += 1
        return self._things

    def box(
        self, material: str, centre: Sequence[float], size: Sequence[float], *, yaw: float = 0, thing: int = 0
    ) -> None:
        """A box by its centre and edge lengths, turned about the vertical."""
        turn = trimesh.transformations.rotation_matrix(yaw, [0, 0, 1])
        turn[:3, 3] = centre
        self._add(trimesh.creation.box(extents=size, transform=turn), material, thing)

    def cylinder(self, material: str, foot: Sequence[float], radius: float, height: float, *, thing: int = 0) -> None:
        """A standing cylinder by the middle of its foot."""
        middle = np.eye(4)
        middle[:3, 3] = np.add(foot, [0, 0, height / 2])
        self._add(trimesh.creation.cylinder(radius, height, sections=18, transform=middle), material, thing)

    def boulder(self, material: str, centre, radii, *, rough: float, rng: np.random.Generator, thing: int = 0) -> None:
        """An ellipsoid whose corners are moved by a share `rough` of its radii: heads, crowns of trees, bushes."""
        ball = trimesh.creation.icosphere(subdivisions=2)
        ball.vertices = ball.vertices * np.asarray(radii) * (1 + rough * rng.normal(0, 1, (len(ball.vertices), 1)))
        ball.vertices += np.asarray(centre)
        self._add(ball, material, thing)

    def slab(self, material: str, corners: Sequence[Sequence[float]]) -> None:
        """A flat quadrangle by its corners in order."""
        self._add(trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], process=False), material, 0)

    def _add(self, mesh: trimesh.Trimesh, material: str, thing: int) -> None:
        self._meshes.append(mesh)
        self._material.append(np.full(len(mesh.faces), NAMES.index(material)))
        self._thing.append(np.full(len(mesh.faces), thing))
        self._caster = None

    def cast(self, origin: np.ndarray, direction: np.ndarray) -> Hits:
        """The nearest face along rays (n, 3), unit directions; ranges in double precision from the face's plane."""
        if self._caster is None:
            self._mesh = trimesh.util.concatenate(self._meshes)
            self._of_face = np.concatenate(self._material), np.concatenate(self._thing)
            self._caster = RayMeshIntersector(self._mesh, scale_to_box=False)
        face = self._caster.intersects_first(origin, direction)
        found = face >= 0
        corner = self._mesh.triangles[face, 0]
        normal = self._mesh.face_normals[face]
        lean = (normal * direction).sum(1)
        with np.errstate(divide="ignore", invalid="ignore"):
            range_m = ((corner - origin) * normal).sum(1) / lean
        found &= np.isfinite(range_m) & (range_m > 0.1) & (range_m < REACH_M)
        range_m = np.where(found, range_m, np.inf)
        material, thing = (np.where(found, of[face], empty) for of, empty in zip(self._of_face, (-1, 0), strict=True))
        point = origin + np.where(found, range_m, 0.0)[:, None] * direction
        facing = np.where(lean > 0, -1.0, 1.0)[:, None] * normal
        return Hits(range_m, np.abs(lean), facing, material, thing, point)
