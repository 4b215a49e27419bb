"""Unpaired: where the two sides show different streets."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class UnpairedRules:
    """Thresholds of the method for different streets, which has a model of its own."""

    # Scenes and candidates.
    unpaired_fewest_scenes: int = 8
    """Scenes that each side needs: 5 to find with and 3 to judge on (follows from the exchanges, of which 5 scenes a
    side have 252, all of which are tried)."""
    unpaired_exchanges: int = 400
    """Exchanges of scenes between the sides, the true one included (a convention: four of them are
    `unpaired_level`)."""
    unpaired_level: float = 0.01
    """Share of exchanges that may reach what an accepted candidate reaches, over all candidates (a convention)."""
    unpaired_agreement_level: float = 0.05
    """Of the sign-flip test over scenes that held-out gains must pass (a convention)."""
    unpaired_folds: int = 4
    """Parts of each side's find scenes, each held out once (a convention)."""
    unpaired_alike_share: float = 0.5
    """Share of the best candidate's gain below which another is no look-alike (a judgement, not calibrated)."""
    unpaired_most_effects: int = 3
    """Effects on intensity that are named at most (a convention)."""
    unpaired_least_share: float = 0.025
    """Share of the first effect's gain that a later one must have: a law that is written a little differently leaves as
    much behind (set on the development cases of `--first 7`, where second names below it were false, and some above it
    too)."""
    unpaired_curve_factor: float = 1.3
    """A free curve must gain so many times what the best effect does, and `curve_margin_nats` more, to be none (a
    judgement, not calibrated; tests/discover/unpaired/test_select.py)."""
    unpaired_few_scenes: int = 16
    """Find scenes of both sides below which a note says that weak effects cannot be told (a judgement, not
    calibrated)."""

    # Frames, and kinds of surfaces.
    unpaired_height_factor: float = 1.5
    """Ratio of the sensors' heights over the ground from which on a note asks for the unit: cars' roofs differ by less
    (a judgement, not calibrated)."""
    unpaired_same_m: float = 0.3
    """Frames of one name whose ranges agree this well (a judgement, not calibrated) ..."""
    unpaired_same_share: float = 0.5
    """... at more than this share of the rays show the same street: a note says that they need not be unpaired (a
    convention: the majority)."""
    unpaired_level_rise: float = 0.9
    """Vertical part of a normal above which a surface is level (a judgement, not calibrated) ..."""
    unpaired_below_m: float = 0.3
    """... and how far below the sensor: the median height of such is the ground's (a judgement, not calibrated)."""
    unpaired_ground_rise: float = 0.7
    """Kinds of surfaces: ground is flatter than this, the vertical part of the normal (a convention: 45 degrees) ..."""
    unpaired_ground_m: float = 0.4
    """... and lies no higher than this above the median of it (a judgement, not calibrated) ..."""
    unpaired_upright_rise: float = 0.5
    """... what is steeper than this is upright, and all else a kind of its own (a convention: 60 degrees)."""
    unpaired_least_besides: float = 0.1
    """Share of the rays that must meet something besides the ground for that to be asked whether it shows an effect (a
    judgement, not calibrated)."""

    # Readings that the law is learned from.
    unpaired_bright_quantile: float = 0.75
    """Quantile of measured intensities that stay whatever lattice they lie on: a quarter is as bright or brighter (a
    judgement, not calibrated)."""
    unpaired_held_sd: float = 3.0
    """Robust standard deviations about each side's own law at which readings are held (a judgement, not calibrated).
    """
    unpaired_rare_share: float = 0.01
    """Share of the simulated rays up to which a class has no level of its own (a judgement, not calibrated)."""
    unpaired_bent_steps: float = 3.5
    """Readings of up to so many steps of a lattice that the measured side alone has are not compared: rounding moves
    them by over a seventh (set on the development cases of `--first 7` and 8, whose rounded readings of severity 8 were
    named another effect as well).
    """

    # Lost rays.
    unpaired_sure_hits: float = 0.98
    """Share of simulated rays that hit something in the rows in which losses of single rays are compared (a judgement,
    not calibrated)."""
    unpaired_fewest_rows: int = 3
    """Such rows below which they are not (a judgement, not calibrated)."""
    unpaired_usual_losses: float = 0.02
    """Share of rays on smooth surfaces that may be lost for what only paired frames tell apart (set on development
    nulls, which reach 1.1 %)."""
    unpaired_hidden_share: float = 0.5
    """Share of a side's frames in which a column is empty, from where it belongs to a hidden sector (a convention: the
    majority)."""
    unpaired_smooth_share: float = 0.05
    """A lost ray lay on a smooth surface if the neighbours beside it returned, ranges no farther apart, as a share (a
    judgement, not calibrated)."""
    unpaired_lost_exchanges: int = 2000
    """Exchanges of scenes between the sides for lost rays, which cost next to nothing (a convention)."""
    unpaired_parts: tuple[int, int] = (3, 6)
    """Parts of the rows and of the azimuth whose losses are compared (a judgement, not calibrated)."""
    unpaired_uneven: float = 2.5
    """Losses of one probability differ by less than this factor between these parts (a judgement, not calibrated)."""
