"""What scenes are built of: convex solids of three kinds, and how each looks.

A polyhedron is the set n.p <= w of up to FACES planes. A round is the unit ball, or the unit cylinder about its
third axis, seen through an affine map q = A p + b; a cylinder may have a bore, which makes it a ring. A crown is a
ball of leaves: light enters it and is stopped after a random path.

A `Model` is an object in its own frame: x forward, y left, z up, origin on the ground beneath its middle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
from flax import struct
from jaxtyping import Float

from jaxsim.frame import Array

FACES = 12
CAPACITY = (384, 1024, 640)
"""Polyhedra, rounds and crowns that a scene has room for: fixed, so that everything compiles once."""

Vector = Sequence[float | int] | np.ndarray
"""Three numbers."""


class Pattern(IntEnum):
    """How a surface is textured; `materials.py` has the formulas."""

    PLAIN = 0
    FACADE = 1
    CAR_BODY = 2
    CAR_CABIN = 3
    WHEEL = 4
    LEAF = 5
    SIGN = 6
    TRUCK_BOX = 7
    STREET = 8
    """The palette entry of the ground alone."""


@dataclass(frozen=True)
class Look:
    """Colour (linear RGB, 0..1), reflectance at 905 nm (0..1) and texture of one solid."""

    semantic: int
    rgb: Vector
    nir: float
    pattern: Pattern = Pattern.PLAIN
    rgb2: Vector = (0.0, 0.0, 0.0)
    """Second colour of the pattern: roof, rim, the emblem of a sign."""
    nir2: float = 0.1
    gloss: float = 0.0
    """Share of the light that is mirrored head on."""
    absorbing: float = 0.0
    """1 for paint that returns hardly anything at 905 nm."""
    half_m: Vector = (1.0, 1.0, 1.0)
    """Half length, half width and height of the object that the pattern is drawn on."""
    seed: int = 0
    extra: tuple[float, float] = (0.0, 0.0)
    """Two numbers that the pattern may use."""
    axis_z_m: float = 0.0
    """Height above the object's origin where the pattern has its own origin."""


LOOK = {
    name: slice(*ends)
    for name, ends in {
        "centre": (0, 3),
        "heading": (3, 5),
        "half": (5, 8),
        "rgb": (8, 11),
        "nir": (11, 12),
        "rgb2": (12, 15),
        "nir2": (15, 16),
        "pattern": (16, 17),
        "seed": (17, 18),
        "semantic": (18, 19),
        "instance": (19, 20),
        "gloss": (20, 21),
        "absorbing": (21, 22),
        "extra": (22, 24),
    }.items()
}
"""Columns of `Solids.look`."""


@struct.dataclass
class Solids:
    """Every solid of a scene, in `world`. Spare slots are zero; no list of candidates names them."""

    planes: Float[Array, "polyhedra faces 4"]
    conics: Float[Array, "conics 3 4"]
    """[A | b] of the rounds, then of the crowns."""
    roundness: Float[Array, " rounds"]
    """1 ball, 0 cylinder."""
    bore: Float[Array, " rounds"]
    """Radius of the hole of a ring, as a share of its own."""
    path_m: Float[Array, " crowns"]
    """Mean free path of light among the leaves."""
    look: Float[Array, "solids columns"]
    """Rows: polyhedra, rounds, crowns."""


@dataclass
class Model:
    """Solids of one object in its own frame, with the box that bounds each."""

    polyhedra: list[tuple[Float[np.ndarray, "faces 4"], Look]] = field(default_factory=list)
    rounds: list[tuple[Float[np.ndarray, "3 4"], float, float, Look]] = field(default_factory=list)
    crowns: list[tuple[Float[np.ndarray, "3 4"], float, Look]] = field(default_factory=list)
    bounds: tuple[list, list, list] = field(default_factory=lambda: ([], [], []))

    def box(self, low: Vector, high: Vector, look: Look, *, cuts: Sequence[Vector] = ()) -> None:
        """An upright box, bevelled by planes (nx, ny, nz, w); raises ValueError for more than FACES planes."""
        sides = [(*-np.eye(3)[i], -low[i]) for i in range(3)] + [(*np.eye(3)[i], high[i]) for i in range(3)]
        planes = np.array([*sides, *cuts], np.float64)
        if len(planes) > FACES:
            raise ValueError(f"a polyhedron has at most {FACES} faces, got {len(planes)}; use two solids")
        planes /= np.linalg.norm(planes[:, :3], axis=1, keepdims=True)
        # A plane without a normal, inside of which everything lies: every polyhedron has FACES.
        never = np.tile([0.0, 0.0, 0.0, 1.0], (FACES - len(planes), 1))
        self.polyhedra.append((np.concatenate([planes, never]), look))
        self.bounds[0].append((low, high))

    def ball(self, centre: Vector, radii: Vector, look: Look) -> None:
        """Adds an ellipsoid along the axes."""
        self._round(_conic(np.diag(radii), centre), look, roundness=1.0)

    def limb(self, start: Vector, end: Vector, look: Look, *, radius: float) -> None:
        """A long ball from one point to the other."""
        self._round(_conic(_axes(start, end, radius), np.add(start, end) / 2), look, roundness=1.0)

    def cylinder(self, start: Vector, end: Vector, look: Look, *, radius: float, bore: float = 0.0) -> None:
        """Adds a cylinder between two points, hollow where it has a `bore`."""
        self._round(_conic(_axes(start, end, radius), np.add(start, end) / 2), look, roundness=0.0, bore=bore)

    def crown(self, centre: Vector, radii: Vector, look: Look, *, path_m: float) -> None:
        """Adds a tree's crown, of leaves between which rays go on for `path_m` in the mean."""
        conic = _conic(np.diag(radii), centre)
        self.crowns.append((conic, path_m, look))
        self.bounds[2].append(_extent(conic, 1.0))

    def _round(self, conic: Float[np.ndarray, "3 4"], look: Look, *, roundness: float, bore: float = 0.0) -> None:
        self.rounds.append((conic, roundness, bore, look))
        self.bounds[1].append(_extent(conic, roundness))


def _axes(start: Vector, end: Vector, radius: float) -> Float[np.ndarray, "3 3"]:
    """Columns: the half axes of a ball or cylinder whose third axis runs from start to end."""
    along = np.subtract(end, start) / 2
    length = np.linalg.norm(along)
    # Any direction across will do, but for one along the axis itself.
    aside = np.cross(along, (0.0, 0.0, 1.0) if abs(along[2]) < 0.9 * length else (1.0, 0.0, 0.0))
    aside *= radius / np.linalg.norm(aside)
    return np.stack([aside, np.cross(along, aside) / length, along], axis=1)


def _conic(axes: Float[np.ndarray, "3 3"], centre: Vector) -> Float[np.ndarray, "3 4"]:
    # Takes the half axes to unit vectors, and the centre to 0.
    inverse = np.linalg.inv(axes)
    return np.concatenate([inverse, -(inverse @ np.asarray(centre, np.float64))[:, None]], axis=1)


def _extent(conic: Float[np.ndarray, "3 4"], roundness: float) -> tuple[Vector, Vector]:
    axes = np.linalg.inv(conic[:, :3])
    centre = -axes @ conic[:, 3]
    # Of a ball the root of squares of its half axes, of a cylinder the rim of its disc and its length.
    reach = np.linalg.norm(axes, axis=1) if roundness else np.linalg.norm(axes[:, :2], axis=1) + abs(axes[:, 2])
    return tuple(centre - reach), tuple(centre + reach)
