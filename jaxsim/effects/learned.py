"""Learned laws: what no effect of the catalogue describes, as numbers along a covariate of the rays or two of them.

    curve       linear between knots
    table       a number for each value (a beam, a class) or pair of values (a beam's column), none for others
    periodic    linear between knots, and from the last to the first across the end of the turn
    product     bilinear between the knots of two covariates
    wave        a cosine and a sine; the one knot of each covariate is how many periods there are in a unit of it

Outside its knots a law holds its end values: nothing is extrapolated. `discover` makes them, sensor.json holds them
(`SensorModel.learned`), and they act after all effects.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxsim.effects.edits import add_intensity, brighten, lose, misread
from jaxsim.effects.effect import CHANNELS
from jaxsim.effects.rays import FLOOR, READ, TURN, Array, Rays, Scan
from jaxsim.files import parse_settings, placed
from jaxsim.frame import PolarGrid
from jaxsim.products import einsum

LAW_KINDS = ("curve", "table", "periodic", "product", "wave")
OFFSET = "offset"
"""A change of intensities by addition, as of a readout with a black level of its own; else laws of them are gains."""
LIMITS = {"intensity": (-2.0, 2.0), OFFSET: (-1.0, 1.0), "range": (-1.0, 1.0), "drop": (0.0, 0.95)}
"""Least and most that a law may change: ln I in nats, I in its own unit, the reading in m; share of echoes lost."""
MOST_SD = 1e3
"""... and, times the most, the largest standard deviation: a knot that nothing was seen of has a large one."""
CHANGE_UNITS = {"intensity": "nats", OFFSET: "", "range": "m", "drop": ""}
CHANGE: dict[str, Callable[[Rays, Array], Rays]] = {
    "intensity": brighten,
    OFFSET: lambda rays, height: add_intensity(rays, height, FLOOR),
    "range": misread,
    "drop": lose,
}
TABLES = ("row", "column", "class", "even rows", "even columns")
BY_CELLS = ("row", "column", "even rows", "even columns")
"""Covariates that are numbers of a grid's cells: on another grid they are other directions."""
TURNING = ("azimuth", "heading", "hue angle")
"""Covariates that come back to where they began."""
NEEDS = {
    **dict.fromkeys(("speed", "speed x time"), "speed"),
    **dict.fromkeys(("rgb", "hue", "hue angle"), "rgb"),
    "frame": "time",
    "heading": "heading",
    "class": "semantic",
}
"""What frames must hold for a covariate to be known."""
_RASTERS = {"speed": "speed_mps", "rgb": "rgb", "time": "time_s", "heading": "heading_rad", "semantic": "semantic"}

Numbers = tuple[float, ...]


@dataclass(frozen=True)
class Learned:
    """A learned law; the content of an entry of sensor.json's `learned`.

    Raises ValueError for unknown names, for knots that do not rise and for numbers that do not fit them or LIMITS.
    """

    channel: str
    kind: str
    covariates: tuple[str, ...]
    """Names in READ: one, or the two of a product."""
    knots: tuple[Numbers, ...]
    """Knots of each covariate, rising, in the unit in which it is compared."""
    values: Numbers
    """The height at each knot, in CHANGE_UNITS; of a product row by row, the second covariate's knots together."""
    sd: Numbers
    """Standard deviation of each, by the jackknife over groups of scenes."""
    adds: bool = False
    """Of intensity: heights are added to what is reported, in its own unit, and are not nats of a gain."""
    cells: tuple[int, int] | None = None
    """Rows and columns of the grid that it was learned on, where it goes by their numbers; None: not known, or not by
    these."""

    @property
    def change(self) -> str:
        """What the law does, by a name of CHANGE."""
        return OFFSET if self.adds else self.channel

    def __post_init__(self) -> None:
        def refuse(what: str) -> ValueError:
            return ValueError(f"learned law of {self.channel} along {' x '.join(map(str, self.covariates))}: {what}")

        if self.channel not in CHANNELS:
            raise refuse(f"channel {self.channel!r} is not known; known are {', '.join(CHANNELS)}")
        if self.adds and self.channel != "intensity":
            raise refuse("`adds` is of intensity alone")
        if self.kind not in LAW_KINDS:
            raise refuse(f"kind {self.kind!r} is not known; known are {', '.join(LAW_KINDS)}")
        if unknown := [name for name in self.covariates if name not in READ]:
            raise refuse(f"covariate {unknown[0]!r} is not known; known are {', '.join(READ)}")
        wanted = {"product": (2,), "table": (1, 2), "wave": (1, 2)}.get(self.kind, (1,))
        if len(self.covariates) != len(self.knots) or len(self.knots) not in wanted:
            raise refuse(f"a {self.kind} has {' or '.join(map(str, wanted))} covariates, and knots of each; "
                         f"{len(self.covariates)} and {len(self.knots)} came")  # fmt: skip
        fewest = {"wave": 1, "table": 1}.get(self.kind, 2)
        for name, knots in zip(self.covariates, self.knots, strict=True):
            if len(knots) < fewest or not np.isfinite(knots).all() or not all(a < b for a, b in pairwise(knots)):
                raise refuse(f"knots of {name} must be finite numbers that rise, {fewest} or more")
            if self.kind == "table" and any(knot < 0 or knot != round(knot) for knot in knots):
                raise refuse(f"knots of {name} in a table are whole numbers from 0 on, one a beam, column or class")
        if self.kind == "wave" and any(len(knots) > 1 for knots in self.knots):
            raise refuse("a wave has one knot of each covariate: its periods in a unit of it")
        size = 2 if self.kind == "wave" else int(np.prod([len(knots) for knots in self.knots]))
        if not len(self.values) == len(self.sd) == size:
            raise refuse(f"{len(self.values)} values and {len(self.sd)} sd came; {size} of each are right")
        low, high = LIMITS[self.change]
        low = -high if self.kind == "wave" else low
        if not all(low <= value <= high for value in self.values):
            raise refuse(f"values must lie within {low:g} and {high:g} {CHANGE_UNITS[self.change]}")
        if not all(0 <= sd <= MOST_SD * high for sd in self.sd):
            raise refuse(f"sd must lie within 0 and {MOST_SD * high:g} {CHANGE_UNITS[self.change]}")

    @property
    def name(self) -> str:
        """What notes and errors call it."""
        return f"learned {self.channel} along {' x '.join(self.covariates)}"

    def height(self, rays: Rays, values: Float[Array, " k"] | None = None) -> Float[Array, "*n"]:
        """The law's height at each ray, 0 where it hits nothing; differentiable in the `values` at the knots, which may
        stand in for its own."""
        heights = jnp.asarray(self.values, jnp.float32) if values is None else values
        x = [READ[name](rays).astype(jnp.float32) for name in self.covariates]
        knots = [jnp.asarray(one, jnp.float32) for one in self.knots]
        if self.kind == "table":
            places = [jnp.clip(jnp.searchsorted(of, one), 0, len(of) - 1) for one, of in zip(x, knots, strict=True)]
            # A beam or class that was not seen is left as it is.
            seen = [of[at] == one for one, of, at in zip(x, knots, places, strict=True)]
            table = heights.reshape([len(of) for of in knots])
            height = jnp.where(jnp.stack(seen).all(0), table[tuple(places)], 0.0)
        elif self.kind == "wave":
            angle = TURN * jnp.stack([one * of[0] for one, of in zip(x, knots, strict=True)]).sum(0)
            # Amplitude and phase as a cosine and a sine: linear in both heights, as a fit wants it.
            height = heights[0] * jnp.cos(angle) + heights[1] * jnp.sin(angle)
            if self.channel == "drop":
                # No share of echoes is less than none.
                height = height + jnp.hypot(heights[0], heights[1])
        elif self.kind == "product":
            grid = heights.reshape(len(self.knots[0]), len(self.knots[1]))
            height = einsum("...i,ij,...j->...", _weights(x[0], knots[0]), grid, _weights(x[1], knots[1]))
        else:
            # Past the outermost knots a curve holds its ends: nothing was seen there to go on by.
            height = jnp.interp(x[0], knots[0], heights, period=TURN if self.kind == "periodic" else None)
        return jnp.where(rays.hit, height, 0.0)

    def apply(self, rays: Rays) -> Rays:
        """The rays with the law."""
        return CHANGE[self.change](rays, self.height(rays))

    def check_known(self, has: Mapping[str, bool]) -> None:
        """Raises ValueError where the frames do not hold (`has`, by NEEDS' values) what a covariate is read from."""
        for name in self.covariates:
            what = NEEDS.get(name)
            if what and not has.get(what, True):
                raise ValueError(
                    f"sensor: the law of {self.channel} learned along {name} needs the frames' {what}, of which these "
                    f"hold nothing, or 0 alone; give frames with {what}, or take the law out of sensor.json's `learned`"
                )

    def check(self, scan: Scan) -> None:
        """As `check_known`, of frames as they were read: what a folder lacks is 0 in all of them."""
        self.check_known({what: bool(np.any(getattr(scan, raster))) for what, raster in _RASTERS.items()})
        self.check_columns(scan.grid)

    def on(self, grid: PolarGrid) -> Learned:
        """The same law, which says on what grid it was learned if it goes by numbers of rows or columns."""
        by_cells = not {*self.covariates}.isdisjoint(BY_CELLS)
        size = len(grid.elevation_rad), len(grid.azimuth_rad)
        return replace(self, cells=size) if by_cells and self.cells is None else self

    def check_columns(self, grid: PolarGrid) -> None:
        """Raises ValueError where it goes by columns of another grid: column 100 looks elsewhere there."""
        columns = len(grid.azimuth_rad)
        if self.cells and self.cells[1] != columns and not {*self.covariates}.isdisjoint(("column", "even columns")):
            raise ValueError(
                f"{self.name} was learned on {self.cells[1]} columns; these frames have {columns}, which look "
                "elsewhere: take it out of sensor.json's `learned`, or simulate on that grid"
            )
        for name, knots in zip(self.covariates, self.knots, strict=True):
            if name == "column" and self.kind != "wave" and knots[-1] >= columns:
                raise ValueError(f"{self.name} was learned of {knots[-1] + 1:g} columns or more; these have {columns}")

    def check_rows(self, rows: int) -> None:
        """Raises ValueError where it goes by rows of a sensor of another number of beams, or knots along the rows lie
        beyond so many."""
        if self.cells and self.cells[0] != rows and not {*self.covariates}.isdisjoint(("row", "even rows")):
            raise ValueError(f"{self.name} was learned on {self.cells[0]} beams; the sensor has {rows}")
        for name, knots in zip(self.covariates, self.knots, strict=True):
            if name == "row" and self.kind != "wave" and knots[-1] >= rows:
                raise ValueError(f"{self.name} was learned of {knots[-1] + 1:g} beams or more; the sensor has {rows}")

    def to_json(self) -> dict[str, Any]:
        """The entry of sensor.json."""
        entry = asdict(self)
        # Said where it is so alone: readers of before know no such keys.
        return {name: value for name, value in entry.items() if value or name not in ("adds", "cells")}

    @classmethod
    def from_json(cls, entry: Any) -> Learned:
        """The law of an entry of sensor.json. Raises ValueError where it is none."""
        with placed("`learned` holds an entry that is no law"):
            return parse_settings(cls, entry)


def quantile_knots(
    x: Float[np.ndarray, " n"], count: int, *, low: float = 0.0, high: float = 1.0
) -> Float[np.ndarray, " k"]:
    """Knots at quantiles of x that lie evenly between two of them, at most `count`: fewer where values are the same."""
    return np.unique(np.quantile(x, np.linspace(low, high, count)))


def hats(x: Float[np.ndarray, "*n"], knots: Float[np.ndarray, " k"]) -> Float[np.ndarray, "*n k"]:
    """Hat functions: weights of the knots at each x, linear between two of them, the end's beyond."""
    return np.stack([np.interp(x, knots, row) for row in np.eye(len(knots))], axis=-1)


def _weights(x: Float[Array, "*n"], knots: Float[Array, " k"]) -> Float[Array, "*n k"]:
    """`hats` on the device."""
    eye = jnp.eye(len(knots), dtype=jnp.float32)
    return jnp.stack([jnp.interp(x, knots, row) for row in eye], axis=-1)


def curve_kind(covariate: str, knots: Numbers) -> str:
    """The kind of a law along one covariate: a table of beams or classes, periodic where its knots go all round."""
    if covariate in TABLES:
        return "table"
    widest = max(b - a for a, b in pairwise(knots))
    round_ = covariate in TURNING and knots[-1] - knots[0] + widest >= TURN
    return "periodic" if round_ else "curve"
