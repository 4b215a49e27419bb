"""Learn: what no effect describes, as a law; and what comes back in sensor coordinates and no effect explains."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class LearnRules:
    """Thresholds on learned laws, their formulas, and patterns on the polar grid."""

    # Laws.
    learned_groups: int = 12
    """Groups of find scenes, at most, each left out once to see how sure a learned law is (a judgement, not
    calibrated: each costs a fit)."""
    law_price_nats: float = 2.0
    """Held-out nats that each node of a closed formula must gain (a judgement, not calibrated;
    tests/discover/law/test_search.py: made laws are found, chance is none)."""
    law_least_share: float = 0.5
    """Share of a learned curve's variation that a closed formula must tell (a judgement, not calibrated)."""
    law_fewest_knots: int = 5
    """Knots below which a covariate has no formula: any would fit them (a judgement, not calibrated)."""

    # What repeats.
    repeats_level: float = 0.02
    """Of the sign flips over find scenes, over all scales, places and channels (a convention: one null in fifty, which
    tests/discover/repeats/test_find.py counts) ..."""
    repeats_judge_level: float = 0.05
    """... and of those over judge scenes, of the pattern that was found; of few scenes all must agree (a convention).
    """
    repeats_rays: int = 300_000
    """Rays that are looked at: more than a fit takes, or scenes would rarely show the same columns (a judgement, not
    calibrated)."""
    repeats_bins: int = 32
    """Groups of columns that are looked at as places (a convention: as many as a residual map shows)."""
    repeats_tried: int = 8
    """Patterns looked for, each on top of the ones before (a judgement, not calibrated)."""
    repeats_least_nats: float = 0.02
    """Height below which a pattern of ln I does not count (set, as the next two, on 31 development nulls with an ideal
    simulator, of which none passed) ..."""
    repeats_least_m: float = 0.005
    """... one of the range, m (set on the same, and on four nulls with a noisy simulator, where ranges of rows were off
    by 1.1 mm at most) ..."""
    repeats_least_lost: float = 0.005
    """... and one of the share of rays lost (set on the same): streets resemble each other, and so a little of
    nuisances repeats. What rounding may do comes on top (`repeats.maps.Maps.rounding`)."""
    repeats_least_variance: float = 0.01
    """Variance that every return has at least, so that no ray that surely returns decides (a judgement, not
    calibrated)."""
    repeats_added_share: float = 0.5
    """Share of its size that the law of a pattern must be able to change (a judgement, not calibrated)."""
    repeats_one_pattern: float = 0.5
    """Share of what scenes' maps have in common that one pattern must explain to be told in place of all (a convention:
    the majority)."""
