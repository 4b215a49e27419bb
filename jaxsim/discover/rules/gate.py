"""Gate, watch and targets: whether a simulation passes, and whether a sensor is as it was."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class GateRules:
    """Thresholds of gates, of `jaxsim watch`, and on targets."""

    fewest_for_scatter: int = 4
    """Scenes below which the scatter between them says nothing of a distance, of a day, or of a kind of targets (a
    judgement, not calibrated)."""
    fewest_target_points: int = 10
    """Points of a target, on the side that has more of them, below which their counts are chance (a judgement, not
    calibrated)."""
    target_beside_m: float = 0.5
    """How far a measured point may lie before and behind a target's own simulated ranges to be one of it (a judgement,
    not calibrated)."""
    target_tile: tuple[int, int] = (8, 32)
    """Rows and columns of the raster's tiles: where nothing numbers objects, a target is what of one class lies in one
    (a judgement, not calibrated)."""
    odd_frames: int = 5
    """Frames that are listed as those which an answer serves worst, of folders that do not fit into memory (a
    convention)."""
    gate_worse_share: float = 0.10
    """Share by which a channel's distance may exceed the baseline's: a mean over eight scenes scatters by less (a
    judgement, not calibrated)."""
    gate_frames_share: float = 0.9
    """Of the frames that a gate was written from, the share that must be there each time (a judgement, not
    calibrated)."""
    gate_effect_nats: float = 2.5
    """Held-out nats a scene from which a named effect is a gap, by default, and nats of judge scenes from which what
    has no name is one; below it a gate is unsure (set on benchmarks/blind/measured, worlds_sealed, ..._again and
    worlds_nulls_again: of 127 nulls six had a name, with 1.0 to 2.1 nats; of 40 named effects of severity 2 seven had
    less; of ten nulls without a name two had more)."""
    gate_least: float = 1e-3
    """Least threshold of a distance: a millimetre, a thousandth of the full scale, or of the rays (a convention: finer
    than files)."""
    watch_chance: float = 0.05
    """Probability that a day without any change shows one, all rows and sectors together by the strongest of them (a
    convention)."""
    watch_sectors: int = 12
    """Parts of the columns that are watched, 30 degrees each of a whole turn (a convention)."""
    watch_road_rad: float = 0.15
    """Angle below the horizon from which on rows see the road: of a sensor on a roof within 12 m (a convention)."""
    watch_road_quantile: float = 0.9
    """Quantile of such a row's ranges that is the road's: walls and cars are nearer than the road beneath them (a
    judgement, not calibrated)."""
    watch_least: float = 1e-3
    """Of a full scale: reflectivities below it count as this, so that a 0 has a logarithm; and the least width of
    an interval by which changes are ranked (a judgement, not calibrated)."""
