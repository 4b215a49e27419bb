"""Frames named by text: `0-3,7` is 0, 1, 2, 3, 7; `0-8:4` is 0, 4, 8; `training` a part of the set; `all but training`
what is left of the set without it."""

from __future__ import annotations

import operator
import re
from collections.abc import Sized
from typing import Any

from jaxsim.files import repeated

_PART = re.compile(r"(\d+)(?:\s*-\s*(\d+)(?:\s*:\s*([1-9]\d*))?)?")
_ALL_BUT = re.compile(r"\s*all\s+but\s+(.+)")
_EVERY = re.compile(r"\s*:\s*([1-9]\d*)$")


def select(text: str, dataset: Sized) -> list[int]:
    """The positions that `text` names in a data set, in the order written. A name is one of the data set's `splits`.

    Raises ValueError for what is no number, range or split, runs backwards, comes twice, or lies beyond the end, for a
    split of which something is not there (the data set's `lacks`), and where `all but ...` leaves nothing.
    """
    if excepted := _ALL_BUT.fullmatch(text):
        left_out = set(select(excepted[1], dataset))
        if len(left_out) == len(dataset):
            raise ValueError(f"frames {text!r}: that is none of the data set's {len(dataset)}; name fewer after `but`")
        return [i for i in range(len(dataset)) if i not in left_out]
    chosen: list[int] = []
    for part in map(str.strip, text.split(",")):
        numbered = _PART.fullmatch(part)
        chosen.extend(_range(text, numbered, len(dataset)) if numbered else _split(text, part, dataset))
    if twice := repeated(chosen):
        raise ValueError(f"frames {text!r}: frame {twice[0]} is named more than once; name each frame once")
    return chosen


def select_or_all(text: str, dataset: Sized) -> list[int]:
    """The positions that a text names; all where it is empty.

    Raises ValueError as `select`.
    """
    return select(text, dataset) if text else list(range(len(dataset)))


def frame_number(index: Any, name: str, count: int) -> int:
    """The position that an index means in a data set of that name and so many frames; one below 0 counts from the end.

    Raises TypeError for what is no whole number, and IndexError beyond the ends.
    """
    try:
        position = operator.index(index)
    except TypeError:
        raise TypeError(
            f"{name}: a frame is given by its number, 0 to {count - 1}, not by {index!r:.60}; for several give one by "
            "one, [dataset[i] for i in range(3)], or [dataset[i] for i in select('0-2', dataset)]"
        ) from None
    if not -count <= position < count:
        raise IndexError(f"{name}: there is no frame {position}; the data set has 0 to {count - 1}")
    return position % count


def _range(text: str, match: re.Match[str], length: int) -> range:
    first = int(match[1])
    last = first if match[2] is None else int(match[2])
    if last < first:
        raise ValueError(f"frames {text!r}: {match[0]} runs backwards; write {last}-{first}")
    if last >= length:
        raise ValueError(f"frames {text!r}: there is no frame {last}; the data set has 0-{length - 1}")
    return range(first, last + 1, int(match[3] or 1))


def _split(text: str, part: str, dataset: Sized) -> list[int]:
    splits: dict[str, list[int]] = getattr(dataset, "splits", {})
    name, *every = _EVERY.split(part)
    if why := getattr(dataset, "lacks", {}).get(name):
        raise ValueError(f"frames {text!r}: {why}")
    if name not in splits:
        known = f", and the data set has no part of that name; it has {', '.join(splits)}" if splits else ""
        raise ValueError(f"frames {text!r}: {name!r} is no frame number{known}; write e.g. 0-3,7 or 0-8:4")
    if not splits[name]:
        raise ValueError(f"frames {text!r}: no frame of {name} is here; --data.scenes leaves out all of it")
    return splits[name][:: int(every[0]) if every else 1]
