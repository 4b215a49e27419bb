"""Draws whose cells scatter together as measured ones do.

What a network does not know of a car's paint it does not know of all the cells of that car. Draws of each cell for
itself would speckle the car like noise that no sensor has. So a cell's rank in its distribution is that of a standard
normal number of a random field (a Gaussian copula; Sklar 1959), a sum of independent fields with a share of the
variance each. Whatever the shares, every cell is standard normal, so that its own distribution stays as it was told.

A field runs along each row and then down the rows as an autoregression of first order does: a cell keeps
exp(-1 / length - bend / edge) of the cell before it, and the rest is new. `bend` is by how many metres a range leaves
the surface of the cells beside it: on a plane next to nothing, so that the field goes on, at an edge much, so that it
begins anew. Nor does it go on where a class or an object ends. Rows of a full turn begin at their first column.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, astuple, dataclass
from pathlib import Path

import jax
import jax.numpy as jnp
from flax import struct
from jaxtyping import Bool, Float, Int

from jaxsim.config.ranges import Checked, NotNegative, Positive, Share
from jaxsim.files import as_argument, parse_settings, placed, read_json, write_text
from jaxsim.frame import Array, Painted

FILE = "grain.json"
"""In a run's folder."""
BROKEN_M = 1e3
"""Bend between cells of which one has no range: nothing that heeds edges goes on there."""
FIELD_CLASSES = 256
"""Classes that have a number of their own where all cells of a class are one; Cityscapes numbers 34."""
INSIDE = 1e-6
"""Ranks stay so far from 0 and 1, which single precision would round them to."""
OFF = 1e-3
"""By how much shares may miss a sum of 1: digits of a file."""
_Cells = Float[Array, "rows columns"]


@dataclass(frozen=True)
class Field(Checked):
    """One of the fields whose sum ranks are of. Of no length it is each cell for itself."""

    share: Share
    """Of the variance."""
    columns: NotNegative | None = 0.0
    """Cells along a row over which it falls to 1/e; none: all cells of a class are one."""
    rows: NotNegative | None = 0.0
    """Cells down the rows over which it falls to 1/e; none as for `columns`."""
    edge_m: Positive | None = None
    """Bend of the range over which it falls to 1/e; none: it does not heed edges."""

    @property
    def single(self) -> bool:
        """Whether cells have nothing to do with each other."""
        return self.columns == 0 and self.rows == 0

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.columns is None) != (self.rows is None):
            raise ValueError(f"columns are {self.columns} and rows {self.rows}; all cells of a class are one in both")


@dataclass(frozen=True)
class Grain(Checked):
    """How the cells of a draw scatter together: fields of the intensities, and of the drops."""

    intensity: tuple[Field, ...]
    drop: tuple[Field, ...]
    scenes: tuple[str, ...] = ()
    """Where it was learned: drives that the network had not seen."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("intensity", "drop"):
            total = sum(field.share for field in getattr(self, name))
            if abs(total - 1) > OFF:
                raise ValueError(f"the shares of {name} sum to {total:.4g}; they must sum to 1")

    @property
    def fingerprint(self) -> str:
        """Eight hexadecimal digits for its fields."""
        numbers = [value for field in (*self.intensity, *self.drop) for value in astuple(field)]
        plain = json.dumps([None if value is None else float(value) for value in numbers])
        return hashlib.sha256(plain.encode()).hexdigest()[:8]


@struct.dataclass
class Ranks:
    """Where one draw lies in the distributions of its cells: ranks, each of them evenly distributed over 0..1."""

    intensity: Float[Array, "*b rows columns"]
    """Which quantile a ray reports that comes back."""
    drop: Float[Array, "*b rows columns"]
    """A ray drops where it is less than the probability of that."""


@struct.dataclass
class Breaks:
    """What breaks fields: how the range bends from cell to cell, and where classes change."""

    across_m: _Cells
    """Bend between a cell and the one before it in its row; of the first column BROKEN_M."""
    down_m: _Cells
    """Between a cell and the one above; of the first row BROKEN_M."""
    new_across: Bool[Array, "rows columns"]
    """The cell is not of the label of the one before it."""
    new_down: Bool[Array, "rows columns"]
    kind: Int[Array, "rows columns"]
    """Class of the cell."""


@jax.jit
def breaks_of(
    range_m: _Cells,
    valid: Bool[Array, "rows columns"],
    *,
    kind: Int[Array, "rows columns"],
    thing: Int[Array, "rows columns"],
) -> Breaks:
    """Where the surfaces of a range image end. `kind` is each cell's class and `thing` its object, 0 where they are
    not known; `valid` is where the range is known."""
    across_m, new_across = _border(range_m, valid, label=(kind, thing))
    down_m, new_down = _border(range_m.T, valid.T, label=(kind.T, thing.T))
    return Breaks(across_m, down_m.T, new_across, new_down.T, jnp.clip(kind, 0, FIELD_CLASSES - 1))


def _border(
    range_m: _Cells, valid: Bool[Array, "rows columns"], *, label: tuple[Array, Array]
) -> tuple[_Cells, Bool[Array, "rows columns"]]:
    """Bend between each cell and the one before it in its row, and where the label changes between them."""
    one = jnp.ones((), range_m.dtype)
    # Of a plane the inverse range is a sine of the ray's angle, whose second difference is nothing beside an edge's.
    inverse = jnp.where(valid, 1 / jnp.where(valid, range_m, one), 0 * one)
    both = valid[:, 1:] & valid[:, :-1]
    step = inverse[:, 1:] - inverse[:, :-1]
    twice = both[:, 1:] & both[:, :-1]
    bend = jnp.where(twice, jnp.abs(step[:, 1:] - step[:, :-1]), jnp.inf)
    pad = lambda x, before, after: jnp.pad(x, ((0, 0), (before, after)), constant_values=jnp.inf)  # noqa: E731
    # A pair of cells has a second difference with the cell before it and one with the cell behind it. If an edge lies
    # on one side only, the other difference is small: both are of one surface. A pair without either neighbour has
    # nothing but its own step.
    least = jnp.minimum(pad(bend, 1, 0), pad(bend, 0, 1))
    least = jnp.where(jnp.isfinite(least), least, jnp.abs(step))
    # A difference of inverse ranges times both ranges is one of ranges.
    metres = jnp.where(both, jnp.minimum(least * range_m[:, 1:] * range_m[:, :-1], BROKEN_M), BROKEN_M)
    changes = (label[0][:, 1:] != label[0][:, :-1]) | (label[1][:, 1:] != label[1][:, :-1])
    return (
        jnp.pad(metres, ((0, 0), (1, 0)), constant_values=BROKEN_M),
        jnp.pad(changes, ((0, 0), (1, 0)), constant_values=True),
    )


@jax.jit
def draw_field(
    on: Breaks, key: Array, *, columns: Float[Array, ""], rows: Float[Array, ""], edge_m: Float[Array, ""]
) -> _Cells:
    """One draw of a field of these lengths, cells; every cell of it is standard normal."""
    # An exponential correlation: one cell on it falls by 1 / length, and by the bend of the surface over `edge_m`; at
    # another class it is 0.
    kept_across = jnp.where(on.new_across, 0.0, jnp.exp(-1 / columns - on.across_m / edge_m))
    kept_down = jnp.where(on.new_down, 0.0, jnp.exp(-1 / rows - on.down_m / edge_m))
    # The second pass meets rows that have nothing to do with each other yet, as it asks.
    return _kept(_kept(jax.random.normal(key, on.kind.shape), kept_across, axis=1), kept_down, axis=0)


def _kept(new: _Cells, keep: _Cells, *, axis: int) -> _Cells:
    """z[i] = keep[i] z[i - 1] + sqrt(1 - keep[i]^2) new[i], which is standard normal where `new` is and its cells along
    `axis` have nothing to do with each other."""

    # Two steps of the recursion are one of the same form, so that all are made in log n steps.
    def join(first: tuple[Array, Array], second: tuple[Array, Array]) -> tuple[Array, Array]:
        return first[0] * second[0], second[0] * first[1] + second[1]

    return jax.lax.associative_scan(join, (keep, jnp.sqrt(1 - keep * keep) * new), axis=axis)[1]


def drawn_of(field: Field, on: Breaks, key: Array) -> _Cells:
    """One draw of a field; every cell of it is standard normal."""
    if field.single:
        return jax.random.normal(key, on.kind.shape)
    # One number a class: whatever lies between its cells, they are one.
    if field.columns is None or field.rows is None:
        return jax.random.normal(key, (FIELD_CLASSES,))[on.kind]
    lengths = {"columns": field.columns, "rows": field.rows, "edge_m": field.edge_m or jnp.inf}
    return draw_field(on, key, **{name: jnp.float32(length) for name, length in lengths.items()})


def draw_ranks(grain: Grain, painted: Painted, key: Array, *, stays: Array | None = None) -> Ranks:
    """Ranks of one draw of a view, or of one each of a batch of views, whose keys have its dims.

    With a key for what `stays`, `key` draws what is each cell's for itself alone: another key gives another scan of the
    same surfaces.
    """
    if key.ndim:
        one = lambda view, of, stays: draw_ranks(grain, view, of, stays=stays)  # noqa: E731
        return jax.vmap(one)(painted, key, stays)
    on = breaks_of(painted.range_m, painted.valid, kind=painted.semantic, thing=painted.instance)
    # Both give one key to intensities and one to drops; without a key for what stays, they are the same keys.
    of = {"key": jax.random.split(key), "stays": jax.random.split(key if stays is None else stays)}
    return Ranks(
        ranks_of_fields(grain.intensity, on, of["key"][0], stays=of["stays"][0]),
        ranks_of_fields(grain.drop, on, of["key"][1], stays=of["stays"][1]),
    )


def ranks_of_fields(fields: Sequence[Field], on: Breaks, key: Array, *, stays: Array | None = None) -> _Cells:
    """Ranks 0..1 of one draw, each of them evenly distributed; `stays` as in `draw_ranks`."""
    of_surface = key if stays is None else stays
    total = jnp.zeros(on.kind.shape)
    for k, field in enumerate(fields):
        # A cell for itself is noise of the moment; what is longer belongs to the surfaces.
        field_key = jax.random.fold_in(key if field.single else of_surface, k)
        # Shares are of the variance.
        total = total + jnp.sqrt(jnp.float32(field.share)) * drawn_of(field, on, field_key)
    # Of a file's digits the shares may sum to a little more or less than 1.
    total = total / jnp.sqrt(jnp.float32(sum(field.share for field in fields)))
    return jnp.clip(jax.scipy.stats.norm.cdf(total), INSIDE, 1 - INSIDE)


def save_grain(folder: Path, grain: Grain) -> Path:
    """Writes a run's grain.json."""
    write_text(folder / FILE, json.dumps(asdict(grain), indent=1) + "\n")
    return folder / FILE


def read_grain(folder: Path) -> Grain:
    """The grain of a run's folder. Raises ValueError where it has none, or the file is not what `save_grain` writes."""
    path = folder / FILE
    if not path.is_file():
        raise ValueError(
            f"grain: {folder} has no {FILE}, which says how cells scatter together; learn it from measured frames "
            f"(jaxsim grain {as_argument(folder)}), or draw each cell for itself (--no-grain)"
        )
    content = read_json(path, by="grain")
    with placed(f"grain: {path} is no run's grain", then="remove it, and learn it anew: jaxsim grain RUN"):
        return parse_settings(Grain, content)
