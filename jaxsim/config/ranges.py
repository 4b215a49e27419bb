"""Ranges of numbers, beside the fields that they are of: a value outside is refused wherever it comes from.

@dataclass(frozen=True)
class Oven(Checked):
    loaves: Count = 8
"""

from __future__ import annotations

import math
from functools import cache
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin, get_type_hints

from annotated_types import Ge, Gt, Le

Count = Annotated[int, Ge(1)]
Whole = Annotated[int, Ge(0)]
Positive = Annotated[float, Gt(0)]
NotNegative = Annotated[float, Ge(0)]
Share = Annotated[float, Ge(0), Le(1)]


MOST = 1e12
"""No setting is larger, whatever it is of: a seed, a rate, a number of steps."""


class Checked:
    """A dataclass whose numbers are finite and in the ranges of their types: ValueError names the field if not."""

    def __post_init__(self) -> None:
        for name, hint in _hints(type(self)).items():
            value = getattr(self, name)
            if wrong := _wrong(value, hint):
                flag = name.replace("_", "-")
                raise ValueError(f"{flag} ({type(self).__name__}) is {value}; it must be {wrong}")


@cache
def _hints(kind: type) -> dict[str, Any]:
    return get_type_hints(kind, include_extras=True)


def _wrong(value: Any, hint: Any) -> str:
    """What a value must be and is not; empty where it is right. Looks into tuples and optional values."""
    if isinstance(value, float) and not math.isfinite(value):
        return "a finite number"
    if isinstance(value, int | float) and abs(value) > MOST:
        return f"within {MOST:g}"
    origin, arguments = get_origin(hint), get_args(hint)
    if origin is Annotated:
        limits = [limit for limit in hint.__metadata__ if isinstance(limit, Ge | Gt | Le)]
        broken = isinstance(value, int | float) and not all(_within(value, limit) for limit in limits)
        return " and ".join(map(_told, limits)) if broken else _wrong(value, arguments[0])
    if origin in (Union, UnionType) and value is not None:
        return next((wrong for one in arguments if (wrong := _wrong(value, one))), "")
    if origin is tuple and isinstance(value, tuple):
        own = arguments[:1] * len(value) if arguments[1:] == (...,) else arguments
        wrongs = (_wrong(one, of) for one, of in zip(value, own, strict=False))
        return next((f"{wrong}, each" for wrong in wrongs if wrong), "")
    return ""


def _within(value: Any, limit: Any) -> bool:
    if isinstance(limit, Le):
        return value <= limit.le
    return value >= limit.ge if isinstance(limit, Ge) else value > limit.gt


def _told(limit: Ge | Gt | Le) -> str:
    if isinstance(limit, Le):
        return f"{limit.le} or less"
    return f"{limit.ge} or more" if isinstance(limit, Ge) else f"above {limit.gt}"
