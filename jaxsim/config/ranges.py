"""Types of settings, ranges of numbers and roles, beside the fields that they are of. What is outside its range is
refused wherever it comes from; whoever compares settings asks for those of a role.

@dataclass(frozen=True)
class Oven(Checked):
    loaves: Count = 8
    shelf: Kept[Path] = Path("shelf")
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import is_dataclass
from functools import cache
from numbers import Integral, Real
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from annotated_types import Ge, Gt, Le, Lt

Count = Annotated[int, Ge(1)]
Whole = Annotated[int, Ge(0)]
Positive = Annotated[float, Gt(0)]
NotNegative = Annotated[float, Ge(0)]
Share = Annotated[float, Ge(0), Le(1)]
Decay = Annotated[float, Ge(0), Lt(1)]
Columns = Annotated[int, Ge(2), Le(2**16)]  # of a polar grid: one would have no step

# Roles. A setting without one decides what is learned.
Role = Literal["kept", "used", "lasts", "file", "drawn", "chosen", "frame", "weights"]
T = TypeVar("T")
Kept = Annotated[T, "kept"]  # where results are kept, and how often
Used = Annotated[T, "used"]  # how what was learned is used
Lasts = Annotated[T, "lasts"]  # how long is learned: cut off or going on, it is the same training
File = Annotated[T, "file"]  # where that lies which is learned from
Drawn = Annotated[T, "drawn"]  # what chance decides in training
Chosen = Annotated[T, "chosen"]  # which of a data set's frames are used
OfFrame = Annotated[T, "frame"]  # what the frame at a position holds, besides its files
WeightsFile = Annotated[T, "weights"]  # a file of weights: what it holds counts, wherever it lies

MOST_SETTING = 1e12
"""No setting is larger, whatever it is of: a seed, a rate, a number of steps."""


class Checked:
    """A dataclass whose values are of their types, its numbers finite and in the ranges of these. A path may be text, a
    tuple a list, which it becomes: settings are compared and hashed.

    ValueError names the field if not.
    """

    def __post_init__(self) -> None:
        for name, hint in _hints(type(self)).items():
            given = getattr(self, name)
            value = _converted(given, hint)
            if value is not given:
                object.__setattr__(self, name, value)  # of a frozen dataclass
            if wrong := _wrong(value, hint):
                flag = name.replace("_", "-")
                raise ValueError(f"{flag} ({type(self).__name__}) is {value!r:.200}; it must be {wrong}")


def _converted(value: Any, hint: Any) -> Any:
    """The path of a text, the tuple of a list, where the type asks for one; else the value itself."""
    hint = get_args(hint)[0] if get_origin(hint) is Annotated else hint
    kinds = [hint] if get_origin(hint) is tuple else [hint, *get_args(hint)]
    if isinstance(value, str) and Path in kinds:
        return Path(value)
    return tuple(value) if isinstance(value, list) and any(get_origin(kind) is tuple for kind in kinds) else value


def settings_of(kind: type, *roles: Role) -> Iterator[str]:
    """Names of a dataclass's settings that have one of these roles, names within names dotted: `run.keep`."""
    for name, hint in _hints(kind).items():
        if is_dataclass(hint) and isinstance(hint, type):
            yield from (f"{name}.{inner}" for inner in settings_of(hint, *roles))
        elif {*roles} & {*getattr(hint, "__metadata__", ())}:
            yield name


@cache
def _hints(kind: type) -> dict[str, Any]:
    return get_type_hints(kind, include_extras=True)


_PLAIN: dict[Any, tuple[type, str]] = {
    int: (Integral, "a whole number"),
    float: (Real, "a number"),
    bool: (bool, "True or False"),
    str: (str, "a text"),
    Path: (Path, "a path"),
    NoneType: (NoneType, "None"),
}
"""Types of settings that hold no others: of what a value must be, and how a user is told."""


def _wrong(value: Any, hint: Any) -> str:
    """What a value must be and is not; empty where it is right. Looks into tuples and alternatives."""
    origin, arguments = get_origin(hint), get_args(hint)
    if origin is Annotated:
        limits = [limit for limit in hint.__metadata__ if isinstance(limit, Ge | Gt | Le | Lt)]
        broken = not all(_within(value, limit) for limit in limits) if isinstance(value, Real) else False
        return _wrong(value, arguments[0]) or (" and ".join(map(_told, limits)) if broken else "")
    if origin in (Union, UnionType):
        wrongs = [_wrong(value, one) for one in arguments]
        return "" if "" in wrongs else wrongs[0]
    if origin is Literal:
        return "" if value in arguments else f"one of {', '.join(map(str, arguments))}"
    if origin is tuple:
        if not isinstance(value, tuple):
            return "a tuple of values"
        of_items = arguments[:1] * len(value) if arguments[1:] == (...,) else arguments
        if len(of_items) != len(value):
            return f"{len(of_items)} values"
        wrongs = [_wrong(one, of) for one, of in zip(value, of_items, strict=True)]
        return next((f"{wrong}, each" for wrong in wrongs if wrong), "")
    if is_dataclass(hint) and isinstance(hint, type):
        return "" if isinstance(value, hint) else f"a {hint.__name__}"
    kind, description = _PLAIN.get(hint, (object, ""))
    if not isinstance(value, kind) or (isinstance(value, bool) and hint in (int, float)):
        return description
    if isinstance(value, Real):
        size = abs(int(value)) if isinstance(value, Integral) else abs(float(value))
        if isinstance(size, float) and not math.isfinite(size):
            return "a finite number"
        return f"within {MOST_SETTING:g}" if size > MOST_SETTING else ""
    return ""


def _within(value: Any, limit: Any) -> bool:
    if isinstance(limit, Le):
        return value <= limit.le
    if isinstance(limit, Lt):
        return value < limit.lt
    return value >= limit.ge if isinstance(limit, Ge) else value > limit.gt


def _told(limit: Ge | Gt | Le | Lt) -> str:
    if isinstance(limit, Le):
        return f"{limit.le} or less"
    if isinstance(limit, Lt):
        return f"below {limit.lt}"
    return f"{limit.ge} or more" if isinstance(limit, Ge) else f"above {limit.gt}"
