"""The gap on judge scenes, before and after: scenes that nothing was fitted to.

Scenes are paired: intervals are those of a scene's own differences (`over_scenes`).
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from jaxsim.discover.model.likelihood import CHANNELS
from jaxsim.discover.scenes import mean_interval, ratio_interval
from jaxsim.discover.show.distance import UNITS, Distance
from jaxsim.discover.verdict import Gained, Gap, Interval


def gaps(before: Distance, after: Distance, placebo: Distance, floor: Distance) -> dict[str, Gap]:
    """By channel: mean errors, and what the log-likelihood gains."""
    found = {}
    for k, name in enumerate(CHANNELS):
        values = [float(np.nanmean(x.error[:, k])) for x in (before, after, floor, placebo)]
        shrunk = before.error[:, k] - after.error[:, k]
        more = [(x.log_likelihood - before.log_likelihood)[:, k] for x in (after, floor, placebo)]
        gained = Gained(
            float(more[0].mean()),
            *mean_interval(more[0]),
            floor=float(more[1].mean()),
            placebo=float(more[2].mean()),
            win_rate=float((more[0] > 0).mean()),
        )
        win = float(np.nanmean(shrunk > 0))
        found[name] = Gap(values[0], values[1], *mean_interval(shrunk), UNITS[name], values[2], values[3], win, gained)
    return found


def closure(before: Distance, after: Distance, floor: Distance, channels: Iterable[str]) -> Interval | None:
    """What the log-likelihood of the named effects' channels gains, as a share of what it gains with free curves (the
    floor); none where the scenes do not agree that these gain anything."""
    used = [k for k, name in enumerate(CHANNELS) if name in set(channels)]
    gain, room = ((x.log_likelihood - before.log_likelihood)[:, used].sum(1) for x in (after, floor))
    if not used or not mean_interval(room)[0] > 0:
        return None
    ends = ratio_interval(gain, room)
    return Interval(float(gain.sum() / room.sum()), *ends, "share of what free curves gain")
