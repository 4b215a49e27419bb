"""What scenes are built of: convex solids of three kinds, and how each looks.

A polyhedron is the set n.p <= w of up to FACES planes. A round is the unit ball, or the unit cylinder about its
third axis, seen through an affine map q = A p + b; a cylinder may have a bore, which makes it a ring. A crown is a
ball of leaves: light enters it and is stopped after a random path.

A `Model` is an object in its own frame: x forward, y left, z up, origin on the ground beneath its middle. A `Plan` puts
objects in their places; `gather_solids` makes of them the arrays that rays are cast at.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
from flax import struct
from jaxtyping import Float, Int

from jaxsim.data.synthetic.street import Street
from jaxsim.frame import Array

FACES = 12
CAPACITY = (384, 1024, 640)
"""Polyhedra, rounds and crowns that a scene has room for: fixed, so that everything compiles once."""
POLYHEDRA, ROUNDS, CROWNS = CAPACITY
GROUND = sum(CAPACITY)
"""Number of the ground among the solids; SKY is the next."""
SKY = GROUND + 1
LEAF_M = 0.22
"""Size of a clump of leaves."""

Vector = Sequence[float | int] | np.ndarray
"""Three numbers."""
FROM_M, TO_M = -70.0, 150.0
"""Stretch of the street that is built up."""


# An upright box's planes, the first six. A plane without a normal has everything inside of it: all have FACES.
_SIDES = np.zeros((FACES, 4))
_SIDES[:3, :3], _SIDES[3:6, :3] = -np.eye(3), np.eye(3)
_SIDES[6:, 3] = 1.0


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
        faces = 6 + len(cuts)
        if faces > FACES:
            raise ValueError(f"a polyhedron has at most {FACES} faces, got {faces}; use two solids")
        planes = _SIDES.copy()
        planes[:3, 3], planes[3:6, 3] = np.negative(low), high
        if len(cuts):
            bevels = np.array(cuts, np.float64)
            planes[6:faces] = bevels / np.sqrt((bevels[:, :3] ** 2).sum(axis=1, keepdims=True))
        self.polyhedra.append((planes, look))
        self.bounds[0].append((low, high))

    def ball(self, centre: Vector, radii: Vector, look: Look) -> None:
        """Adds an ellipsoid along the axes."""
        self._round(np.diag(radii), centre, look, roundness=1.0)

    def limb(self, start: Vector, end: Vector, look: Look, *, radius: float) -> None:
        """A long ball from one point to the other."""
        self._round(_axes(start, end, radius), np.add(start, end) / 2, look, roundness=1.0)

    def cylinder(self, start: Vector, end: Vector, look: Look, *, radius: float, bore: float = 0.0) -> None:
        """Adds a cylinder between two points, hollow where it has a `bore`."""
        self._round(_axes(start, end, radius), np.add(start, end) / 2, look, roundness=0.0, bore=bore)

    def crown(self, centre: Vector, radii: Vector, look: Look, *, path_m: float) -> None:
        """Adds a tree's crown, of leaves between which rays go on for `path_m` in the mean."""
        axes = np.diag(radii)
        self.crowns.append((_conic(axes, centre), path_m, look))
        self.bounds[2].append(_extent(axes, centre, 1.0))

    def _round(
        self, axes: Float[np.ndarray, "3 3"], centre: Vector, look: Look, *, roundness: float, bore: float = 0.0
    ) -> None:
        self.rounds.append((_conic(axes, centre), roundness, bore, look))
        self.bounds[1].append(_extent(axes, centre, roundness))


def _axes(start: Vector, end: Vector, radius: float) -> Float[np.ndarray, "3 3"]:
    """Columns: the half axes of a ball or cylinder whose third axis runs from start to end."""
    # In plain numbers: a street has a thousand of these, and NumPy takes longer to begin than to work one out.
    half = [float(to - at) / 2 for at, to in zip(start, end, strict=True)]
    x, y, z = half
    length = math.hypot(x, y, z)
    # Any direction across will do, but for one along the axis itself.
    aside = (y, -x, 0.0) if abs(z) < 0.9 * length else (0.0, z, -y)
    share = radius / math.hypot(*aside)
    sideways = [share * component for component in aside]
    u, v, w = sideways
    across = ((y * w - z * v) / length, (z * u - x * w) / length, (x * v - y * u) / length)
    return np.array([sideways, across, half]).T


def _conic(axes: Float[np.ndarray, "3 3"], centre: Vector) -> Float[np.ndarray, "3 4"]:
    # Takes the half axes, which stand at right angles, to unit vectors, and the centre to 0.
    conic = np.empty((3, 4))
    conic[:, :3] = (axes / (axes * axes).sum(axis=0)).T
    conic[:, 3] = -(conic[:, :3] @ np.asarray(centre, np.float64))
    return conic


def _extent(axes: Float[np.ndarray, "3 3"], centre: Vector, roundness: float) -> tuple[Vector, Vector]:
    square = axes * axes
    # Of a ball the root of squares of its half axes, of a cylinder the rim of its disc and its length.
    reach = np.sqrt(square.sum(axis=1)) if roundness else np.sqrt(square[:, 0] + square[:, 1]) + abs(axes[:, 2])
    return tuple(centre - reach), tuple(centre + reach)


@dataclass(frozen=True)
class Thing:
    """An object of a street: its shape, and where along the street it is at time 0."""

    model: Model
    x_m: float
    aside_m: float
    """Distance to the left of the road's middle."""
    turn_rad: float = 0.0
    """Heading against the street's."""
    z_m: float = 0.0
    speed_mps: float = 0.0
    """Along x, backwards if negative."""
    kind: str = ""
    """KITTI's name of a labelled object; empty for what has no box."""
    size_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Length, width, height of the box."""


@dataclass
class Plan:
    """A street while it is being laid out."""

    rng: np.random.Generator
    street: Street
    things: list[Thing] = field(default_factory=list)

    def place(self, spot: tuple[float, float], model: Model, *, turn: float = 0.0, **rest) -> None:
        """Puts a model at (x, aside); `turn` is its heading against the street's."""
        x, off = spot
        z = 0.0 if abs(off) < float(self.street.half_width_m) else float(self.street.kerb_m)
        self.things.append(Thing(**{"model": model, "x_m": x, "aside_m": off, "turn_rad": turn, "z_m": z, **rest}))

    def clear_of_sides(self, x: float, towards: int, margin: float) -> bool:
        """No side street on that side within `margin` of x."""
        side = self.street
        near = np.abs(x - side.side_x_m) < np.maximum(side.side_half_m, 0.0) + margin
        return not bool(np.any(near & (side.side_half_m > 0) & (side.side_towards * towards > 0)))


@dataclass(frozen=True)
class Parts:
    """All solids of all things, each in its thing's frame; `owner` is the thing's number."""

    planes: Float[np.ndarray, "polyhedra faces 4"]
    conics: Float[np.ndarray, "conics 3 4"]
    shape: Float[np.ndarray, "conics 2"]
    """Rounds: roundness and bore. Crowns: mean free path, 0."""
    look: Float[np.ndarray, "solids columns"]
    corners: Float[np.ndarray, "solids 8 3"]
    owner: Int[np.ndarray, " solids"]
    counts: tuple[int, int, int]


def gather_solids(things: Sequence[Thing]) -> Parts:
    """Lays the solids of all things side by side: polyhedra, rounds, crowns.

    Raises ValueError for more solids than a scene has room for.
    """
    models = list(enumerate(t.model for t in things))
    polyhedra = [(*p, low_high, i) for i, m in models for p, low_high in zip(m.polyhedra, m.bounds[0], strict=True)]
    rounds = [(*r, low_high, i) for i, m in models for r, low_high in zip(m.rounds, m.bounds[1], strict=True)]
    crowns = [(*c, low_high, i) for i, m in models for c, low_high in zip(m.crowns, m.bounds[2], strict=True)]
    counts = (len(polyhedra), len(rounds), len(crowns))
    if any(n > room for n, room in zip(counts, CAPACITY, strict=True)):
        raise ValueError(f"a scene has room for {CAPACITY} polyhedra, rounds and crowns, got {counts}")
    conics = [r[0] for r in rounds] + [c[0] for c in crowns]
    shape = [(r[1], r[2]) for r in rounds] + [(c[1], 0.0) for c in crowns]
    everything = [*polyhedra, *rounds, *crowns]
    # All eight corners of a box: low or high on each axis.
    choose = np.array([[i >> 2 & 1, i >> 1 & 1, i & 1] for i in range(8)])
    bounds = np.array([s[-2] for s in everything], np.float64).reshape(-1, 2, 3)
    return Parts(
        np.array([p[0] for p in polyhedra]).reshape(-1, FACES, 4),
        np.array(conics).reshape(-1, 3, 4),
        np.array(shape).reshape(-1, 2),
        np.array([_look_row(s[-3]) for s in everything]).reshape(-1, 24),
        np.take_along_axis(bounds, choose[None, :, :], axis=1),
        np.array([s[-1] for s in everything], np.int64),
        counts,
    )


def _look_row(look: Look) -> Float[np.ndarray, " columns"]:
    # Patterns are drawn in the frame of the thing; axis_z_m waits in the place of its height.
    numbers = [0.0, 0.0, look.axis_z_m, 1.0, 0.0, *look.half_m, *look.rgb, look.nir, *look.rgb2, look.nir2]
    numbers += [look.pattern, look.seed, look.semantic, 0, look.gloss, look.absorbing, *look.extra]
    return np.array(numbers, np.float64)


def along_street(
    curvature: float, x_m: Float[np.ndarray, " n"], aside_m: Float[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, " n"]]:
    """Places (x, y) in `world` at x along the street and to the left of its middle, and the street's heading there."""
    slope = curvature * x_m
    size = np.hypot(1.0, slope)
    place = np.stack([x_m - aside_m * slope / size, 0.5 * slope * x_m + aside_m / size], axis=-1)
    return place, np.arctan(slope)


def poses_at(
    things: Sequence[Thing], curvature: float, time_s: float
) -> tuple[Float[np.ndarray, "things 3"], Float[np.ndarray, " things"]]:
    """Positions and headings in `world` at a time."""
    numbers = np.array([(t.x_m, t.aside_m, t.turn_rad, t.z_m, t.speed_mps) for t in things], np.float64)
    x, off, turn, z, speed = numbers.reshape(-1, 5).T
    spot, heading = along_street(curvature, x + speed * time_s, off)
    return np.concatenate([spot, z[:, None]], axis=1), heading + turn


def in_world(
    parts: Parts,
    position_m: Float[np.ndarray, "things 3"],
    heading_rad: Float[np.ndarray, " things"],
    *,
    instance: Int[np.ndarray, " things"],
) -> tuple[Solids, Float[np.ndarray, "solids 8 3"]]:
    """Solids in `world`, padded to capacity, and the corners of the boxes that bound them, not padded."""
    cos, sin = np.cos(heading_rad)[parts.owner], np.sin(heading_rad)[parts.owner]
    at = position_m[parts.owner]
    zero, one = np.zeros_like(cos), np.ones_like(cos)
    turn = np.stack([cos, -sin, zero, sin, cos, zero, zero, zero, one], axis=-1).reshape(-1, 3, 3)
    n_planes, n_rounds, _ = parts.counts

    # With p = R q + t, n.q <= w becomes (R n).p <= w + (R n).t, and A q + b becomes A R^T p + (b - A R^T t).
    normal = parts.planes[..., :3] @ turn[:n_planes].swapaxes(1, 2)
    offset = parts.planes[..., 3] + np.einsum("pfi,pi->pf", normal, at[:n_planes])
    matrix = parts.conics[..., :3] @ turn[n_planes:].swapaxes(1, 2)
    shift = parts.conics[..., 3] - np.einsum("cij,cj->ci", matrix, at[n_planes:])
    look = parts.look.copy()
    look[:, LOOK["centre"]] += at
    look[:, LOOK["heading"]] = np.stack([cos, sin], axis=-1)
    look[:, LOOK["instance"]] = instance[parts.owner][:, None]

    def pad(values: np.ndarray, room: int) -> np.ndarray:
        out = np.zeros((room, *values.shape[1:]), np.float32)
        out[: len(values)] = values
        return out

    room_planes, room_rounds, room_crowns = CAPACITY
    conics = np.concatenate([matrix, shift[..., None]], axis=-1)
    # Each kind is padded by itself, so that a solid's number tells its kind.
    kinds = np.split(np.arange(len(look)), np.cumsum(parts.counts)[:2])
    solids = Solids(
        planes=pad(np.concatenate([normal, offset[..., None]], axis=-1), room_planes),
        conics=np.concatenate([pad(conics[:n_rounds], room_rounds), pad(conics[n_rounds:], room_crowns)]),
        roundness=pad(parts.shape[:n_rounds, 0], room_rounds),
        bore=pad(parts.shape[:n_rounds, 1], room_rounds),
        path_m=pad(parts.shape[n_rounds:, 0], room_crowns),
        look=np.concatenate([pad(look[k], room) for k, room in zip(kinds, CAPACITY, strict=True)]),
    )
    corners = parts.corners @ turn.swapaxes(1, 2) + at[:, None, :]
    return solids, corners
