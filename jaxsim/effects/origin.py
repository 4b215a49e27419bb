"""Effects of one's own: where each comes from, so that a sensor.json can say it, and what it looks like.

A sensor.json never loads code: where it names an effect that is not there, the error says which file or package has it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from jaxsim.effects.catalogue import EFFECTS
from jaxsim.effects.effect import Effect


@dataclass(frozen=True)
class Origin:
    """A file with the SHA-256 of its bytes, or an installed package with its version."""

    file: str = ""
    """The file's name, without the folder."""
    sha256: str = ""
    package: str = ""
    version: str = ""

    def __str__(self) -> str:
        return f"{self.file}, SHA-256 {self.sha256}" if self.file else f"package {self.package} {self.version}"

    def to_json(self) -> dict[str, str]:
        """The entry `from` of sensor.json."""
        if self.file:
            return {"file": self.file, "sha256": self.sha256}
        return {"package": self.package, "version": self.version}


@dataclass(frozen=True)
class LookAlike:
    """An effect that acts much like another."""

    name: str
    share: float
    """Share of the other's expectation that it reproduces, 0..1."""
    apart: str
    """What would tell the two apart."""


@dataclass(frozen=True, eq=False, kw_only=True)
class OwnEffect(Effect):
    """An effect that is no part of the catalogue."""

    origin: Origin
    alike: tuple[LookAlike, ...] = ()
    """Computed from its expectation on some frames, nearest first; empty until then."""

    # By origin too: what was compiled for a file is not taken for the file after an edit.
    def __hash__(self) -> int:
        return hash((self.name, self.origin))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, OwnEffect) and (other.name, other.origin) == (self.name, self.origin)


def origin_of(name: str) -> dict[str, str] | None:
    """The entry `from` that sensor.json has of an effect; None of the catalogue's."""
    effect = EFFECTS.get(name)
    return effect.origin.to_json() if isinstance(effect, OwnEffect) else None


def check_origin(name: str, said: Any) -> None:
    """Raises ValueError where the effect `name`, that comes from what a sensor.json has as `said`, is not there, or is
    there from elsewhere."""
    if said is None:
        return
    wanted = _wanted(said)
    if name not in EFFECTS:
        raise ValueError(f"{name} is an effect of one's own and not there; {wanted}")
    have = origin_of(name)
    if have != dict(said):
        here = "the catalogue" if have is None else str(Origin(**have))
        raise ValueError(
            f"{name} here comes from {here}, which may not be the same formula; {wanted}, or, where it is the same, "
            f'correct "from" in the file'
        )


def _wanted(said: Any) -> str:
    """What to give so that an effect is there. Raises ValueError for an origin that is none."""
    given = {str(key): str(value) for key, value in said.items()} if isinstance(said, Mapping) else {}
    if set(given) == {"file", "sha256"}:
        return (
            f"give the file that it was found with, {given['file']} (SHA-256 {given['sha256']}), by --effects-from "
            f"{given['file']}: its code is run, so read it first"
        )
    if set(given) == {"package", "version"}:
        return f"install the package that it was found with, {given['package']} {given['version']}"
    raise ValueError(f'"from" is {said!r}; it must be {{"file", "sha256"}} or {{"package", "version"}}')
