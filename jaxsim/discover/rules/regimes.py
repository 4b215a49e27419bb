"""Regimes: whether an effect acts everywhere, or in some drives, from a moment on, in a sector."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class RegimeRules:
    """Thresholds on what divides an effect. `python -m benchmarks.blind.regimes` measures what comes of them."""

    regime_level: float = 0.05
    """Rate of false discoveries (Benjamini-Hochberg) over all questions that are asked of what divides effects (a
    convention)."""
    regime_fewest_scenes: int = 3
    """Scenes that a regime has inside and outside, at least (a judgement, not calibrated: as many as may decide)."""
    regime_sectors: int = 48
    """Sectors of azimuth, of whose arcs regimes are made (a judgement, not calibrated) ..."""
    regime_least_arc: float = 0.06
    """... with this share of the scan, at least (a judgement, not calibrated)."""
    regime_nats: float = 10.0
    """What an effect must gain more on held-out find scenes where it acts in its region alone (a judgement, not
    calibrated: `bar_nats` once more)."""
    regime_outside: float = 0.5
    """Size outside, over that inside, below which it must lie for certain: streets alone make sizes differ a little (a
    judgement, not calibrated)."""
    regime_least_curvature: float = 0.02
    """Curvature of a scene's likelihood in an effect's size, over the largest scene's, below which it tells no size (a
    judgement, not calibrated)."""
    regime_least_rate: float = 0.1
    """What scenes say of a candidate's direction (`Candidate.slope`), nats, that counts as next to nothing (set on
    gains of beams from a moment on: of forty candidates some of far less looked as clearly divided)."""
    regime_rivals: int = 3
    """Other candidates that are fitted in a region, where another may be the better name (a judgement, not calibrated:
    each costs fits)."""
