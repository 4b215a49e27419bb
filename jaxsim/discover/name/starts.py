"""Starts of fits that are read off the measurement.

Borders between all and nothing (a ceiling, a gate, a hidden sector) have no slope away from themselves: where a fit
from elsewhere would feel no pull, it begins at these. A border lies between the last ray that is hidden and the first
that is not, and no frames know it better.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import jax
import numpy as np
from jaxtyping import Bool, Float, Int, Num

from jaxsim.discover.model.fit import Problem
from jaxsim.discover.rules import RULES
from jaxsim.effects import EFFECTS
from jaxsim.effects.places import longest_run, within_turn
from jaxsim.geometry import spans_turn

BIN_RAD = np.deg2rad(1.0)
"""Width of the bins of azimuth in which a hidden sector is looked for; its borders are then told by single rays."""
TURN_BINS = 360
"""Bins of a turn."""
SLICE_M = 0.02
"""Slices of the range in which a wave is looked for: a sixth of the shortest."""

Start = dict[str, float]


def starts_of(problem: Problem) -> dict[str, tuple[Start, ...]]:
    """Further starts of a fit, by effect."""
    on_host = replace(problem, ev=jax.tree.map(np.asarray, problem.ev))
    return {name: starts for name, read in STARTS.items() if (starts := read(on_host))}


def _ceiling(problem: Problem) -> tuple[Start, ...]:
    ev = problem.ev
    values = ev.intensity[ev.returned]
    if not len(values):
        return ()
    top = float(values.max())
    # A ceiling clips: readings pile up right below it.
    piled = np.mean(values > (1 - RULES.pile_within) * top) >= RULES.piled_share
    return ({"ceiling": top},) if piled and top < 1 else ()


def _speak_for_hidden(lost: Num[np.ndarray, "*n"], of: Num[np.ndarray, "*n"] | int) -> Float[np.ndarray, "*n"]:
    """Nats by which so many rays, and so many lost ones of them, speak for being hidden."""
    return lost * RULES.lost_says_nats + (of - lost) * RULES.returned_says_nats


def _gate(problem: Problem) -> tuple[Start, ...]:
    ev = problem.ev
    smooth = ev.rays.hit & ~ev.edge
    r = ev.rays.range_m[smooth]
    lost = ~ev.returned[smooth]
    starts = []
    for name, sign in (("minimum_m", 1.0), ("maximum_m", -1.0)):
        # From the end at which rays are lost, the border lies where the log-likelihood ratio of `gate here` to `no
        # gate` is largest: a cumulative sum.
        order = np.argsort(sign * r)
        score = np.cumsum(_speak_for_hidden(lost[order].astype(int), 1))
        score = score[: int(np.argmax(score < -RULES.gate_nats)) or None]  # returns have begun
        if len(score) and score.max() > RULES.gate_nats:
            border = float(r[order][int(score.argmax())])
            starts += [{name: border + sign * past} for past in RULES.gate_past_m]
    return tuple(starts)


def _sector(problem: Problem) -> tuple[Start, ...]:
    """Sectors in which nearly every ray is lost, of all rows and of those below the elevation up to which one is told
    best."""
    cells = GridCells.of(problem)
    if not len(cells.hits):
        return ()
    closed = bool(spans_turn(problem.scan.grid))
    starts = _hidden(cells, closed=closed)
    below = _hidden_below(cells, closed=closed)
    if below is not None:
        low = cells.where(cells.elevation < below)
        starts += tuple(start | {"below_rad": below} for start in _hidden(low, closed=closed))
    return starts


@dataclass(frozen=True)
class GridCells:
    """Cells of the grid in which any ray of the frames hits something: fits look at few columns of a frame, and the
    borders of a sector lie anywhere between two of these."""

    azimuth: Float[np.ndarray, " n"]
    elevation: Float[np.ndarray, " n"]
    hits: Int[np.ndarray, " n"]
    lost: Int[np.ndarray, " n"]

    @classmethod
    def of(cls, problem: Problem) -> GridCells:
        """The cells of a problem's frames."""
        hits, lost = np.asarray(problem.ev.cell_hits), np.asarray(problem.ev.cell_lost)
        grid = problem.scan.grid
        azimuth = np.broadcast_to(np.asarray(grid.azimuth_rad, float), hits.shape)
        elevation = np.broadcast_to(np.asarray(grid.elevation_rad, float)[:, None], hits.shape)
        seen = hits > 0
        return cls(azimuth[seen], elevation[seen], hits[seen], lost[seen])

    def where(self, keep: Bool[np.ndarray, " n"]) -> GridCells:
        """Some of the cells."""
        return GridCells(self.azimuth[keep], self.elevation[keep], self.hits[keep], self.lost[keep])

    @property
    def nats(self) -> Float[np.ndarray, " n"]:
        """By how much each cell speaks for being hidden."""
        return _speak_for_hidden(self.lost, self.hits)


def _bins(azimuth: Float[np.ndarray, " n"], *, closed: bool) -> Int[np.ndarray, " n"]:
    """Bins of azimuth, counted from behind the car; of a window, which may lie across the cut, from its border."""
    bins = np.floor((azimuth + np.pi) / BIN_RAD).astype(int)
    return bins % TURN_BINS if closed else bins - bins.min()


def _hidden_below(cells: GridCells, *, closed: bool) -> float | None:
    """The elevation below which bins of azimuth are hidden most surely; None where it is no row's, or nothing is."""
    azimuth_bin = _bins(cells.azimuth, closed=closed)
    rows, at = np.unique(cells.elevation, return_inverse=True)
    shape = (azimuth_bin.max() + 1, len(rows))
    # Rays and lost rays of each bin up to each elevation.
    cell = azimuth_bin * shape[1] + at
    count = np.cumsum(np.bincount(cell, cells.hits, shape[0] * shape[1]).reshape(shape), axis=1)
    gone = np.cumsum(np.bincount(cell, cells.lost, shape[0] * shape[1]).reshape(shape), axis=1)
    evidence = np.where(gone > RULES.hidden_share * count, _speak_for_hidden(gone, count), 0).sum(0)
    best = int(evidence.argmax())
    if best + 1 >= len(evidence) or evidence[best] <= RULES.gate_nats:
        return None
    return float(rows[best : best + 2].mean())


def _hidden(cells: GridCells, *, closed: bool) -> tuple[Start, ...]:
    """The longest run of bins of azimuth in which nearly every ray is lost, up to the rays at its borders, and sectors
    about as wide; nothing where no bin is hidden."""
    azimuth = cells.azimuth
    azimuth_bin = _bins(azimuth, closed=closed)
    count = np.bincount(azimuth_bin, cells.hits)
    seen = np.flatnonzero(count)
    hidden = np.bincount(azimuth_bin, cells.lost)[seen] > RULES.hidden_share * count[seen]
    if not hidden.any():
        return ()
    run = longest_run(hidden, closed=closed)
    turn, place = np.divmod(run[[0, -1]], len(seen))
    # A window's bins are counted from its border; in steps of bins from behind the car, as all are.
    first = -np.pi if closed else np.floor((azimuth.min() + np.pi) / BIN_RAD) * BIN_RAD - np.pi
    middle = float(((seen[place] + TURN_BINS * turn).mean() + 0.5) * BIN_RAD + first)
    away = within_turn(azimuth - middle) if closed else azimuth - middle
    right = float(np.mean(_border(away[away >= 0], cells.nats[away >= 0])))
    left = -float(np.mean(_border(-away[away < 0], cells.nats[away < 0])))
    width = right - left
    middle = within_turn(middle + (left + right) / 2)
    # Columns that a fit looks at may all lie well within: of widths that say the same the first is taken.
    return tuple({"azimuth_rad": middle, "width_rad": share * width} for share in (1.0, 0.7, 1.4))


def _border(away: Float[np.ndarray, " n"], nats: Float[np.ndarray, " n"]) -> tuple[float, float]:
    """The last place that is likelier hidden than not, on the way outward, and the next one."""
    if not len(away):
        return 0.0, 0.0
    order = np.argsort(away)
    last = away[order][np.cumsum(nats[order]).argmax()]
    beyond = away[away > last]
    return float(last), float(beyond.min() if len(beyond) else last)


def _wave(problem: Problem) -> tuple[Start, ...]:
    """The waves along the range that say most of the readings' errors: a wave of another length pulls nowhere."""
    ev = problem.ev
    usable = ev.smooth & ev.rays.hit
    r = ev.rays.range_m[usable]
    off = (ev.range_m - ev.rays.reading_m)[usable]
    near = np.abs(off) < RULES.wave_most_m
    # Both sides may have the very ranges, as beside Lambert's law on the measured ones.
    if near.sum() < RULES.fewest_residuals or np.ptp(off[near]) == 0:
        return ()
    r, off = r[near], off[near]
    off = off - off.mean()
    # Sums over slices of the range make of the search for the length one Fourier transform.
    at = np.floor(r / SLICE_M).astype(int)
    sums = np.bincount(at, off)
    # Twice as many lengths as the range tells apart.
    length = 2 * len(sums)
    power = np.abs(np.fft.rfft(sums, length))
    cycles = np.fft.rfftfreq(length, SLICE_M)
    known = EFFECTS["cyclic_range_error"].parameters["cycles_per_m"]
    power = np.where((cycles >= known.low) & (cycles <= known.high), power, 0)
    starts: list[Start] = []
    for _ in range(RULES.waves_tried):
        best = int(power.argmax())
        # A start is none of its neighbours' again.
        power[max(best - 2, 0) : best + 3] = 0
        phase = 2 * np.pi * cycles[best] * r
        wave = np.stack([np.sin(phase), np.cos(phase)], axis=-1)
        sine, cosine = np.linalg.lstsq(wave, off, rcond=None)[0]
        rest = off - wave @ (sine, cosine)
        # Some length always says a little, by chance.
        if len(off) / 2 * (1 - rest.var() / off.var()) < RULES.gate_nats:
            continue
        starts.append({"sine_m": float(sine), "cosine_m": float(cosine), "cycles_per_m": float(cycles[best])})
    return tuple(starts)


def sector_between(problem: Problem, values: Mapping[str, Any]) -> dict[str, tuple[float, float]]:
    """Between which values the parameters of a hidden sector lie, by the cells next to its borders."""
    cells = GridCells.of(problem)
    away = within_turn(cells.azimuth - float(values["azimuth_rad"]))
    low, inside = cells.elevation < float(values["below_rad"]), np.abs(away) < float(values["width_rad"]) / 2
    right = _border(away[low & (away >= 0)], cells.nats[low & (away >= 0)])
    left = _border(-away[low & (away < 0)], cells.nats[low & (away < 0)])
    # What lies lowest comes first.
    top = _border(cells.elevation[inside], cells.nats[inside])
    middle = float(values["azimuth_rad"])
    return {
        "azimuth_rad": (middle + (right[0] - left[1]) / 2, middle + (right[1] - left[0]) / 2),
        "width_rad": (right[0] + left[0], right[1] + left[1]),
        "below_rad": top if top[1] > top[0] else (top[0], np.pi / 2),
    }


STARTS: dict[str, Callable[[Problem], tuple[Start, ...]]] = {
    "saturation": _ceiling,
    "range_gate": _gate,
    "sector_occlusion": _sector,
    "cyclic_range_error": _wave,
}
