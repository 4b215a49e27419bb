"""Frame numbers written as text: `0-3,7` is 0, 1, 2, 3, 7; `0-8:4` is 0, 4, 8."""

from __future__ import annotations

import re
from collections import Counter

_PART = re.compile(r"(\d+)(?:\s*-\s*(\d+)(?:\s*:\s*([1-9]\d*))?)?")


def select(text: str, length: int) -> list[int]:
    """The positions that `text` names in a data set of `length` frames, in the order written.

    Raises ValueError for what is no number or range, runs backwards, comes twice, or lies beyond the end.
    """
    chosen: list[int] = []
    for part in text.split(","):
        match = _PART.fullmatch(part.strip())
        if match is None:
            raise ValueError(f"frames {text!r}: {part.strip()!r} is no frame number; write e.g. 0-3,7 or 0-8:4")
        first = int(match[1])
        last = first if match[2] is None else int(match[2])
        if last < first:
            raise ValueError(f"frames {text!r}: {part.strip()} runs backwards; write {last}-{first}")
        if last >= length:
            raise ValueError(f"frames {text!r}: there is no frame {last}; the data set has 0-{length - 1}")
        chosen.extend(range(first, last + 1, int(match[3] or 1)))
    repeated = [i for i, times in Counter(chosen).items() if times > 1]
    if repeated:
        raise ValueError(f"frames {text!r}: frame {repeated[0]} is named more than once; name each frame once")
    return chosen
