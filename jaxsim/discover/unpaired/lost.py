"""Lost rays where the streets differ: a ray that is lost has no range, so only its row and azimuth are known.

Rows in which simulated rays nearly always hit something (the ground) show losses; whole columns are counted apart,
those that are empty in most frames as a hidden sector, the others as lost packets.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from jaxsim.discover.unpaired.streets import Streets
from jaxsim.discover.verdict import Interval
from jaxsim.effects import EFFECTS

SURE = 0.98
"""Share of simulated rays that hit something in the rows that are looked at."""
USUAL = 0.01
"""Of rays that any sensor loses, edges included; more is an effect."""
MOSTLY = 0.5
"""Of a side's frames in which a column is empty, from where it belongs to a hidden sector."""
FEWEST_ROWS = 3
LEVEL = 0.01
UNEVEN = 3.0
"""Between the rows, nearest third and farthest third, losses of one probability differ by less than this factor."""
DRAWS = 2000


@dataclass(frozen=True)
class Loss:
    """An effect on returns, with its parameters."""

    name: str
    p_value: float
    parameters: dict[str, Interval]
    share: Interval
    """Of rays, beyond what the simulated side loses."""


@dataclass(frozen=True)
class Losses:
    """What was found, and what a reader must know."""

    found: tuple[Loss, ...]
    rows: Bool[np.ndarray, " r"]
    notes: tuple[str, ...]


def losses(streets: Streets, find: Bool[np.ndarray, " s"]) -> Losses:
    """Compares the shares of lost rays of the find scenes."""
    use = find[streets.frame_scene]
    sensed = streets.measured[streets.frame_scene]
    here, there = streets.lost[use & sensed], streets.lost[use & ~sensed]
    rows = there.mean((0, 2)) < 1 - SURE
    scene = streets.frame_scene[use & sensed], streets.frame_scene[use & ~sensed]
    empty = np.all(here, axis=1, keepdims=True)[:, 0], np.all(there, axis=1, keepdims=True)[:, 0]
    hidden = (empty[0].mean(0) > MOSTLY) & (empty[1].mean(0) < 1 - MOSTLY)
    found, notes = [], []
    if hidden.any():
        found.append(_sector(streets, hidden, int(find[streets.measured].sum())))
    groups = [_of_scenes(e[:, ~hidden].mean(1), s) for e, s in zip(empty, scene, strict=True)]
    packets = _test(*groups)
    if packets[0] <= LEVEL and packets[1].value > USUAL:
        p, share = packets
        found.append(Loss("packet_loss", p, {"probability": _as(share, "packet_loss", "probability")}, share))
    if rows.sum() < FEWEST_ROWS:
        notes.append(
            "in no three rows do simulated rays nearly always hit something: losses of single rays are not compared"
        )
        return Losses(tuple(found), rows, tuple(notes))
    single = [
        _of_scenes(_share(lost, e, hidden, rows), s) for lost, e, s in zip((here, there), empty, scene, strict=True)
    ]
    p, share = _test(*single)
    if p <= LEVEL and share.value > USUAL:
        thirds = np.array_split(np.flatnonzero(rows), 3)
        ends = [np.mean(_share(here, empty[0], hidden, np.isin(np.arange(len(rows)), third))) for third in thirds]
        if max(ends) < UNEVEN * max(min(ends), 1e-6):
            found.append(Loss("random_dropout", p, {"probability": _as(share, "random_dropout", "probability")}, share))
        else:
            shares = " ".join(f"{100 * end:.2g} %" for end in ends)
            notes.append(
                f"rays are lost in the rows that see the ground, the more the farther or nearer it lies (upper, "
                f"middle, lower third: {shares}); whether range, power or surface does it cannot be told unpaired"
            )
    return Losses(tuple(found), rows, tuple(notes))


def _sector(streets: Streets, hidden: np.ndarray, scenes: int) -> Loss:
    azimuth = np.asarray(streets.grid.azimuth_rad, float)
    step = float(np.abs(np.diff(azimuth)).mean())
    runs = np.split(np.flatnonzero(hidden), np.flatnonzero(np.diff(np.flatnonzero(hidden)) > 1) + 1)
    run = max(runs, key=len)
    middle, width = float(azimuth[run].mean()), len(run) * step
    values = {"azimuth_rad": (middle, step / 2), "width_rad": (width, step)}
    parameters = {
        name: _as(Interval(v, v - e, v + e, "rad"), "sector_occlusion", name) for name, (v, e) in values.items()
    }
    share = float(hidden.mean())
    return Loss("sector_occlusion", 2.0**-scenes, parameters, Interval(share, share, share, "share of rays"))


def _share(lost: np.ndarray, empty: np.ndarray, hidden: np.ndarray, rows: np.ndarray) -> Float[np.ndarray, " f"]:
    """Of rays that are lost in columns that are not lost whole."""
    counts = ~(empty | hidden)
    return (lost[:, rows] & counts[:, None]).sum((1, 2)) / np.maximum(counts.sum(1) * rows.sum(), 1)


def _of_scenes(of_frames: np.ndarray, scene: np.ndarray) -> Float[np.ndarray, " s"]:
    return np.array([of_frames[scene == s].mean() for s in np.unique(scene)])


def _test(measured: np.ndarray, simulated: np.ndarray) -> tuple[float, Interval]:
    """Chance that scenes exchanged at random differ as much, and by how much the measured ones lose more."""
    rng = np.random.default_rng(0)
    both, n = np.concatenate([measured, simulated]), len(measured)
    seen = measured.mean() - simulated.mean()
    drawn = np.array([both[rng.permutation(len(both))] for _ in range(DRAWS)])
    p = (1 + (drawn[:, :n].mean(1) - drawn[:, n:].mean(1) >= seen - 1e-12).sum()) / (1 + DRAWS)
    draws = [rng.choice(x, (DRAWS, len(x))).mean(1) for x in (measured, simulated)]
    low, high = np.quantile(draws[0] - draws[1], [0.05, 0.95])
    return float(p), Interval(float(seen), float(low), float(high), "share of rays")


def _as(share: Interval, effect: str, parameter: str) -> Interval:
    p = EFFECTS[effect].parameters[parameter]

    def clip(x: float) -> float:
        return float(np.clip(x, p.low, p.high))

    return Interval(clip(share.value), clip(share.low), clip(share.high), p.unit)
