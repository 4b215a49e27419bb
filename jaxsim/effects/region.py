"""Where an effect acts, if not everywhere: a sector of azimuth, a span of time, or frames that something is said of."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float

from jaxsim.effects.effect import Law
from jaxsim.effects.rays import TURN, Array, Rays, Scan
from jaxsim.files import parse_settings, placed

FOREVER_S = 1e9
"""Seconds that no recording lasts."""
L = TypeVar("L", bound=Law)
Span = tuple[float | None, float | None]


@dataclass(frozen=True)
class Region:
    """A part of a recording; what is None divides nothing. The content of `where` in sensor.json.

    Raises ValueError where it divides nothing at all, and for a sector or a span of time that cannot be.
    """

    azimuth_rad: tuple[float, float] | None = None
    """Azimuths from and to, counter-clockwise; the second may exceed pi."""
    time_s: Span | None = None
    """Times from and until, since the recording's first frame; None is open."""
    tag: str | None = None
    """A tag of frames, in grid.json."""
    scenes: tuple[str, ...] = ()
    """Drives that nothing else tells apart: in frames that are simulated the effect does not act."""

    def __post_init__(self) -> None:
        everywhen = self.time_s in (None, (None, None))  # open at both ends it divides nothing
        if self.azimuth_rad is None and everywhen and self.tag is None and not self.scenes:
            raise ValueError("where: nothing is said; give azimuth_rad, time_s, tag or scenes, or leave `where` out")
        ends = [*(self.azimuth_rad or ()), *(one for one in self.time_s or () if one is not None)]
        if any(not abs(end) <= FOREVER_S for end in ends):
            raise ValueError(f"where: {ends} are no radians or seconds; each must lie within {FOREVER_S:g}")
        if self.azimuth_rad is not None:
            low, high = self.azimuth_rad
            if max(abs(low), abs(high)) > 2 * TURN:
                raise ValueError(
                    f"where: azimuth_rad is {low:g} to {high:g}, turns away from a sensor's azimuths: give radians, "
                    "-pi..pi, no degrees"
                )
            if not 0 < high - low < TURN:
                raise ValueError(
                    f"where: azimuth_rad is {low:g} to {high:g}; it runs counter-clockwise from the first to the "
                    "second, in radians, by more than 0 and less than a turn"
                )
        if self.time_s is not None:
            first, last = self.time_s
            if first is not None and last is not None and not last > first:
                raise ValueError(f"where: time_s is {first:g} to {last:g}; it must end after it begins")

    @property
    def acts(self) -> bool:
        """Whether simulated frames say where it is: drives by name are those that were measured."""
        return not self.scenes

    def in_sector(self, azimuth_rad: Float[Array, "*n"]) -> Bool[Array, "*n"]:
        """Which directions lie in it."""
        if self.azimuth_rad is None:
            return jnp.ones(jnp.shape(azimuth_rad), bool)
        low, high = self.azimuth_rad
        # Counted from its begin on, so that a sector behind the sensor may cross the seam.
        return jnp.mod(azimuth_rad - low, TURN) <= high - low

    def in_time(self, time_s: Float[Array, "*n"]) -> Bool[Array, "*n"]:
        """Which moments lie in it."""
        first, last = self.time_s or (None, None)
        # Half open, so that regions that follow one another share no frame.
        after = time_s >= (-jnp.inf if first is None else first)
        return after & (time_s < (jnp.inf if last is None else last))

    def holds(self, rays: Rays, scan: Scan) -> Bool[Array, "*n"]:
        """Which rays lie in it; none where the frames do not say (a tag that none has, drives by name)."""
        inside = self.in_sector(rays.azimuth_rad) & self.in_time(rays.time_s)
        if self.tag is not None:
            tagged = scan.tags.get(self.tag)
            inside = inside & (False if tagged is None else jnp.asarray(tagged)[rays.frame])
        return inside & self.acts

    def to_json(self) -> dict[str, Any]:
        """The entry of sensor.json."""
        entries = asdict(self).items()
        return {name: list(v) if isinstance(v, tuple) else v for name, v in entries if v not in (None, ())}

    @classmethod
    def from_json(cls, entry: Mapping[str, Any]) -> Region:
        """The region of an entry of sensor.json. Raises ValueError where it is none."""
        known = ", ".join(cls.__dataclass_fields__)
        with placed(f"where: {entry!r:.200} is not understood", then=f"it may hold {known}"):
            return parse_settings(cls, entry)


def kept(inside: Bool[Array, "*n"], before: Rays, after: Rays) -> Rays:
    """Rays as they are `after` an effect where `inside`, else as they were; numbers of all rays together stay."""

    def choose(was: Array, now: Array) -> Array:
        # Steps and tops are one number for all rays: no part of them lies in a region.
        if jnp.ndim(was) < inside.ndim:
            return was
        return jnp.where(inside.reshape(inside.shape + (1,) * (jnp.ndim(was) - inside.ndim)), now, was)

    return jax.tree.map(choose, before, after)


def within(effect: L, region: Region, frames: Bool[Array, " f"], *, outside: bool = False) -> L:
    """The effect as it acts in a region alone, or `outside` it: a law of its own, named `EFFECT@...`. `frames` says
    which frames of the scan lie in the region."""
    chosen = jnp.asarray(frames)
    # Laws are told apart by name.
    mark = hashlib.sha256(f"{region} {chosen.tolist()} {outside}".encode()).hexdigest()[:12]

    def apply(p: dict[str, Array], rays: Rays) -> Rays:
        inside = region.in_sector(rays.azimuth_rad) & chosen[rays.frame]
        return kept(~inside if outside else inside, rays, effect.apply(p, rays))

    return replace(effect, name=f"{effect.plain_name}@{mark}", apply=apply)
