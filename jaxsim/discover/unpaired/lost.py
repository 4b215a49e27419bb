"""What needs no law where the streets differ: rays that are lost, and lattices on which readings lie.

A ray that is lost has no range, so only its row and azimuth are known.

Losses of single rays show between two neighbours on one surface, in rows in which simulated rays nearly always hit
something (the ground). Whole columns are counted apart: those that are empty in most frames as a hidden sector,
the others as lost packets. Letters: f frames, s scenes, r rows, c columns.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import bdtrc

from jaxsim.discover.model.noise_levels import FINEST
from jaxsim.discover.rules import RULES
from jaxsim.discover.scenes import attainable, chance_of, difference_interval
from jaxsim.discover.unpaired.read import UnpairedComparison
from jaxsim.discover.verdict import Interval, Named
from jaxsim.effects import EFFECTS
from jaxsim.effects.places import longest_run, within_turn
from jaxsim.frame import PolarGrid
from jaxsim.geometry import spans_turn


@dataclass(frozen=True)
class _Side:
    """The find frames of one side."""

    lost: Bool[np.ndarray, "f r c"]
    smooth: Bool[np.ndarray, "f r c"]
    """Rays whose neighbours left and right returned from one surface; edges lose rays of their own."""
    scene: Int[np.ndarray, " f"]

    @classmethod
    def of(cls, comparison: UnpairedComparison, frames: Bool[np.ndarray, " f"]) -> _Side:
        lost = comparison.lost[frames]
        r = np.where(lost, np.nan, comparison.scan.range_m[frames]).astype(np.float64)
        left = np.roll(r, 1, 2)
        right = np.roll(r, -1, 2)
        # NaN of a lost neighbour compares as no surface.
        smooth = np.abs(left - right) < RULES.unpaired_smooth_share * np.minimum(left, right)
        # np.roll brings the other end's rays to the borders.
        smooth[..., [0, -1]] = False
        return cls(lost, smooth, comparison.frame_scene[frames])

    @property
    def empty(self) -> Bool[np.ndarray, "f c"]:
        """Columns without a return."""
        return np.asarray(self.lost.all(axis=1))

    def share(self, rows: Bool[np.ndarray, " r"], columns: Bool[np.ndarray, " c"]) -> Float[np.ndarray, " f"]:
        """The share that is lost of the rays on smooth surfaces in these rows and columns; NaN where there are none."""
        # Of rays that must have hit something: their neighbours did, on one surface.
        asked = self.smooth[:, rows] & columns
        count = asked.sum((1, 2))
        return np.where(count > 0, (self.lost[:, rows] & asked).sum((1, 2)) / np.maximum(count, 1), np.nan)

    def by_scene(self, of_frames: Float[np.ndarray, " f"]) -> Float[np.ndarray, " s"]:
        """Means over each scene's frames that have a value; scenes without one are left out."""
        known = np.isfinite(of_frames)
        return np.array([of_frames[known & (self.scene == scene)].mean() for scene in np.unique(self.scene[known])])

    def mean_share(self, rows: Bool[np.ndarray, " r"], columns: Bool[np.ndarray, " c"]) -> float:
        """The mean share over frames; NaN where nothing can be lost, as behind a bracket."""
        shares = self.share(rows, columns)
        known = np.isfinite(shares)
        return float(shares[known].mean()) if known.any() else float("nan")


def lost_rays(
    comparison: UnpairedComparison, find: Bool[np.ndarray, " s"]
) -> tuple[tuple[Named, ...], tuple[str, ...]]:
    """The effects on returns by which the shares of lost rays of the find scenes differ, and notes for the reader; an
    effect's gain is the share of rays that it costs, beyond what the simulated side loses."""
    use = find[comparison.frame_scene]
    of_measured = comparison.measured[comparison.frame_scene]
    measured = _Side.of(comparison, use & of_measured)
    simulated = _Side.of(comparison, use & ~of_measured)
    mostly = RULES.unpaired_hidden_share
    # A sector is empty in most measured frames and in few simulated ones: the sky above is empty in both.
    hidden = (measured.empty.mean(0) > mostly) & (simulated.empty.mean(0) < 1 - mostly)
    effects, notes = _sector(comparison.grid, hidden, measured=measured, simulated=simulated)
    effects += _packets(measured, simulated, ~hidden)
    rows = _sure_rows(simulated, ~hidden)
    if rows.sum() < RULES.unpaired_fewest_rows:
        note = "in no three rows do simulated rays nearly always hit something: losses of single rays are not compared"
        return tuple(effects), (*notes, note)
    single, of_single = _single_rays(measured, simulated, rows, columns=~hidden)
    return (*effects, *single), (*notes, *of_single)


def _sure_rows(simulated: _Side, columns: Bool[np.ndarray, " c"]) -> Bool[np.ndarray, " r"]:
    """Rows in which simulated rays nearly always hit something; where these are too few, as beside a real sensor, rows
    in which rays of these columns do that lie between two returns of one surface."""
    # Rows that look at the sky lose rays to the street: their losses say nothing of the sensor.
    sure = simulated.lost.mean((0, 2)) < 1 - RULES.unpaired_sure_hits
    if sure.sum() >= RULES.unpaired_fewest_rows:
        return sure
    row_numbers = np.arange(len(sure))
    lost = np.array([simulated.mean_share(row_numbers == row, columns) for row in row_numbers])
    # NaN of rows without smooth surfaces compares as no such row.
    return lost < RULES.unpaired_usual_losses


def _sector(
    grid: PolarGrid, hidden: Bool[np.ndarray, " c"], *, measured: _Side, simulated: _Side
) -> tuple[list[Named], list[str]]:
    """The hidden columns as a sector, if so many measured scenes show it as chance does not, else a note; neither where
    none is hidden."""
    if not hidden.any():
        return [], []
    columns = _run(grid, hidden)
    shows = measured.by_scene(measured.empty[:, columns].mean(1)) > RULES.unpaired_hidden_share
    # A sign test: by chance a scene is as likely to show it as not to.
    p = float(bdtrc(int(shows.sum()) - 1, len(shows), 0.5))
    if p > attainable(RULES.unpaired_level, len(shows)):
        return [], [
            f"{len(columns)} columns without returns in {shows.sum()} of {len(shows)} measured scenes: too few of them "
            "for a sector_occlusion; losses are compared in the other columns"
        ]
    costs = [side.by_scene((side.empty & hidden).mean(1)) for side in (measured, simulated)]
    gain = Interval(float(costs[0].mean() - costs[1].mean()), *difference_interval(*costs), "share of rays")
    return [Named.alone("sector_occlusion", p, gain, parameters=_borders(grid, columns))], []


def _run(grid: PolarGrid, hidden: Bool[np.ndarray, " c"]) -> Int[np.ndarray, " k"]:
    """Numbers of the columns of the longest run of hidden ones, in its order."""
    # Single empty columns beside it may be chance; one thing before the sensor hides neighbours.
    return longest_run(hidden, closed=bool(spans_turn(grid))) % len(hidden)


def _borders(grid: PolarGrid, columns: Int[np.ndarray, " k"]) -> dict[str, Interval]:
    """The place of neighbouring columns, known to a column's width."""
    azimuth_rad = np.asarray(grid.azimuth_rad, float)
    step = float(np.abs(np.diff(azimuth_rad)).mean())
    middle = within_turn(float(np.unwrap(azimuth_rad[columns]).mean()))
    width = len(columns) * step
    of = EFFECTS["sector_occlusion"].parameters
    return {
        "azimuth_rad": Interval.about(middle, step / 2, "").within(of["azimuth_rad"]),
        "width_rad": Interval.about(width, step, "").within(of["width_rad"]),
    }


def _packets(measured: _Side, simulated: _Side, columns: Bool[np.ndarray, " c"]) -> list[Named]:
    """Lost packets, if more of these columns are empty than usual."""
    p, share = _compared(*[side.by_scene(side.empty[:, columns].mean(1)) for side in (measured, simulated)])
    if p > RULES.unpaired_level or share.value <= RULES.unpaired_usual_losses:
        return []
    return [_of_share("packet_loss", p, share, probability=share)]


def _single_rays(
    measured: _Side, simulated: _Side, rows: Bool[np.ndarray, " r"], *, columns: Bool[np.ndarray, " c"]
) -> tuple[list[Named], list[str]]:
    """Single rays, if more are lost than usual: an effect where they are lost evenly, else notes."""
    p, share = _compared(*[side.by_scene(side.share(rows, columns)) for side in (measured, simulated)])
    usual = RULES.unpaired_usual_losses
    if p > RULES.unpaired_level or share.value <= usual:
        return [], []
    row_numbers = np.arange(len(rows))
    column_numbers = np.arange(len(columns))
    parts = {
        "row": [
            measured.mean_share(np.isin(row_numbers, part), columns)
            for part in np.array_split(np.flatnonzero(rows), RULES.unpaired_parts[0])
        ],
        "azimuth": [
            measured.mean_share(rows, columns & np.isin(column_numbers, part))
            for part in np.array_split(column_numbers, RULES.unpaired_parts[1])
        ],
    }
    # Parts that a sector hides say nothing of single rays.
    known = {name: [share for share in shares if np.isfinite(share)] for name, shares in parts.items()}
    uneven = {name: shares for name, shares in known.items() if max(shares) > RULES.unpaired_uneven * min(shares)}
    if not uneven:
        # Of what is lost, between none and what is usual is lost anyway.
        beyond = replace(share, value=share.value - usual / 2, low=share.low - usual)
        return [_of_share("random_dropout", p, share, probability=beyond)], []
    notes = []
    for name, shares in uneven.items():
        percentages = ", ".join(f"{100 * part:.2g} %" for part in shares)
        notes.append(
            f"rays are lost unevenly along the {name} ({percentages}): no random_dropout alone; which effect does it "
            "cannot be told from lost rays unpaired"
        )
    return [], notes


def _compared(measured: Float[np.ndarray, " s"], simulated: Float[np.ndarray, " t"]) -> tuple[float, Interval]:
    """Chance that scenes exchanged at random differ as much, and by how much the measured ones lose more; 1 and NaN of
    fewer than two scenes a side."""
    if min(len(measured), len(simulated)) < 2:
        return 1.0, Interval(float("nan"), float("nan"), float("nan"), "share of rays")
    rng = np.random.default_rng(0)
    # Where nothing differs any scene could have come from either side.
    both = np.concatenate([measured, simulated])
    n = len(measured)
    seen = measured.mean() - simulated.mean()
    drawn = np.array([both[rng.permutation(len(both))] for _ in range(RULES.unpaired_lost_exchanges)])
    p = chance_of(drawn[:, :n].mean(1) - drawn[:, n:].mean(1), seen)
    return p, Interval(float(seen), *difference_interval(measured, simulated), "share of rays")


def lattices(comparison: UnpairedComparison, find: Bool[np.ndarray, " s"]) -> list[Named]:
    """Rounding, read off the values: each measured scene shows it, and its gain is what lying on a lattice saves."""
    scenes = int((find & comparison.measured).sum())
    simulated_frames, _ = comparison.frames
    returns = float((~comparison.lost[simulated_frames:]).sum() / comparison.measured.sum())
    entries = []
    for name, step in comparison.steps.items():
        # A reading that can only lie on the lattice is likelier by step / finest step.
        gain = returns * float(np.log(step / FINEST[name]))
        ((parameter, of),) = EFFECTS[name].parameters.items()
        nats = Interval.exact(gain, "nats per scene")
        entries.append(Named.alone(name, 2.0**-scenes, nats, parameters={parameter: Interval.exact(step, of.unit)}))
    return entries


def _of_share(effect: str, p_value: float, gain: Interval, *, probability: Interval) -> Named:
    """An effect that loses each of its rays, or columns, with one probability."""
    bounded = probability.within(EFFECTS[effect].parameters["probability"])
    return Named.alone(effect, p_value, gain, parameters={"probability": bounded})
