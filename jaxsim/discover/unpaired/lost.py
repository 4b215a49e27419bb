"""Lost rays where the streets differ: a ray that is lost has no range, so only its row and azimuth are known.

Losses of single rays show in rows in which simulated rays nearly always hit something (the ground), between two
neighbours on one surface. Whole columns are counted apart: those that are empty in most frames as a hidden sector,
the others as lost packets.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from jaxsim.discover.scenes import difference_interval
from jaxsim.discover.unpaired.streets import Streets
from jaxsim.discover.verdict import Interval
from jaxsim.effects import EFFECTS

SURE = 0.98
"""Share of simulated rays that hit something in the rows that are looked at."""
USUAL = 0.02
"""Of rays on smooth surfaces: as many may be lost for reasons that only paired frames tell apart (weak echoes at
grazing angles, small gaps). Development cases without an effect, of the independent generator, reach 1.1 %."""
AGREE = 0.05
"""A lost ray lay on a smooth surface if its neighbours to both sides returned, with ranges this close."""
MOSTLY = 0.5
"""Of a side's frames in which a column is empty, from where it belongs to a hidden sector."""
FEWEST_ROWS = 3
LEVEL = 0.01
UNEVEN = 2.5
"""Losses of one probability differ by less than this factor between thirds of the rows and sectors of azimuth."""
SECTORS = 6
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
    smooth = [_smooth(streets.scan.range_m[side], streets.lost[side]) for side in (use & sensed, use & ~sensed)]
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
        _of_scenes(_share(lost, on, hidden, rows), k) for lost, on, k in zip((here, there), smooth, scene, strict=True)
    ]
    p, share = _test(*single)
    if p <= LEVEL and share.value > USUAL:
        lines, columns = np.flatnonzero(rows), np.arange(here.shape[2])
        by_row = [
            np.mean(_share(here, smooth[0], hidden, np.isin(np.arange(len(rows)), part)))
            for part in np.array_split(lines, 3)
        ]
        by_azimuth = [
            np.mean(_share(here, smooth[0], hidden | ~np.isin(columns, part), rows))
            for part in np.array_split(columns, SECTORS)
        ]
        uneven = {"row": by_row, "azimuth": by_azimuth}
        uneven = {name: x for name, x in uneven.items() if max(x) > UNEVEN * min(x)}
        if not uneven:
            # Of what is lost, between none and USUAL is lost anyway.
            own = Interval(share.value - USUAL / 2, share.low - USUAL, share.high, share.unit)
            found.append(Loss("random_dropout", p, {"probability": _as(own, "random_dropout", "probability")}, share))
        for name, parts in uneven.items():
            shares = ", ".join(f"{100 * part:.2g} %" for part in parts)
            notes.append(
                f"rays are lost unevenly along the {name} ({shares}): no random_dropout alone; which effect does it "
                "cannot be told from lost rays unpaired"
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


def _smooth(range_m: np.ndarray, lost: np.ndarray) -> Bool[np.ndarray, "f r c"]:
    """Rays whose neighbours left and right returned from one surface; edges lose rays of their own."""
    r = np.where(lost, np.nan, range_m).astype(np.float64)
    left, right = np.roll(r, 1, 2), np.roll(r, -1, 2)
    smooth = np.abs(left - right) < AGREE * np.minimum(left, right)
    smooth[..., [0, -1]] = False
    return smooth


def _share(lost: np.ndarray, smooth: np.ndarray, hidden: np.ndarray, rows: np.ndarray) -> Float[np.ndarray, " f"]:
    """Of rays on smooth surfaces that are lost."""
    counts = smooth[:, rows] & ~hidden
    return (lost[:, rows] & counts).sum((1, 2)) / np.maximum(counts.sum((1, 2)), 1)


def _of_scenes(of_frames: np.ndarray, scene: np.ndarray) -> Float[np.ndarray, " s"]:
    return np.array([of_frames[scene == s].mean() for s in np.unique(scene)])


def _test(measured: np.ndarray, simulated: np.ndarray) -> tuple[float, Interval]:
    """Chance that scenes exchanged at random differ as much, and by how much the measured ones lose more."""
    rng = np.random.default_rng(0)
    both, n = np.concatenate([measured, simulated]), len(measured)
    seen = measured.mean() - simulated.mean()
    drawn = np.array([both[rng.permutation(len(both))] for _ in range(DRAWS)])
    p = (1 + (drawn[:, :n].mean(1) - drawn[:, n:].mean(1) >= seen - 1e-12).sum()) / (1 + DRAWS)
    return float(p), Interval(float(seen), *difference_interval(measured, simulated), "share of rays")


def _as(share: Interval, effect: str, parameter: str) -> Interval:
    p = EFFECTS[effect].parameters[parameter]

    def clip(x: float) -> float:
        return float(np.clip(x, p.low, p.high))

    return Interval(clip(share.value), clip(share.low), clip(share.high), p.unit)
