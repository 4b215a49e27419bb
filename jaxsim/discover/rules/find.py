"""Find: dependences of residuals on covariates."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class FindRules:
    """Thresholds on curves of residuals along covariates, and on which of them are told."""

    most_residual_sd: float = 4.0
    """Standard deviations at which residuals of ln I and of ranges are held: heavy tails must not decide (a
    convention)."""
    knots: int = 10
    """Knots of a covariate's curve; a free curve that competes with effects has twice as many (a judgement, not
    calibrated)."""
    interaction_knots: int = 5
    """Knots of each covariate's curve in an interaction of two; rows are a length there: a column each is too many (a
    judgement, not calibrated)."""
    few_values: int = 40
    """Different values of a covariate up to which its curve is a parabola, as it must hold on frames it has not seen;
    and intensities that a table has at most (a judgement, not calibrated)."""
    moment_fewest: int = 6
    """Scenes from which on steps in time are looked for (a judgement, not calibrated) ..."""
    moment_scenes: int = 2
    """... scenes before and after a step, or within and outside a span, at least (the same judgement) ..."""
    moment_level: float = 0.01
    """... how often levels that scatter by a normal law step as clearly, at most (a judgement, not calibrated: streets'
    levels are not quite normal, and held-out scenes are asked as well) ..."""
    moment_nats: float = 0.15
    """... how much brighter or darker they are, at least (a judgement, not calibrated: streets differ by 0.1) ..."""
    moment_share: float = 0.5
    """... and what a step may leave of levels' squares, of what a line in time leaves (a judgement, not calibrated;
    tests/discover/find/test_moments.py)."""
    ridge: float = 4.0
    """Observations' worth of pull of a curve's knots to 0 (a judgement, not calibrated)."""
    additive_folds: int = 4
    """Folds of scenes on which the additive model of residuals is judged (a convention)."""
    fewest_residuals: int = 100
    """Residuals below which a channel is not looked at (a judgement, not calibrated)."""
    fewest_effective: float = 100.0
    """The same for interactions, counted as equally large ones (Kish 1965): a handful of lost rays tells nothing (a
    judgement, not calibrated; tests/discover/find/test_dependences.py)."""
    fewest_interaction_scenes: int = 6
    """Scenes below which interactions are not looked at (follows from `dependence_level`, which signs of fewer cannot
    reach)."""
    interaction_residuals: int = 30_000
    """Residuals on which interactions are tried, evenly spread: more cost time and hardly change their ranks (a
    judgement, not calibrated)."""
    one_clock: float = 0.99
    """Rank correlation above which time within the scan and azimuth are one covariate, called azimuth (a judgement,
    not calibrated)."""
    height_share: float = 0.05
    """Share of the residuals' variance that a dependence on the height must explain: plinths, shop fronts and crowns
    are of other materials than what stands on them (set on two nulls of the development seeds, of 0.01, and on frames
    with spray over the road that another made, of 0.12)."""
    dependences_tried: int = 4
    """Dependences looked for in each channel, one on top of another (a judgement, not calibrated)."""
    dependences_listed: int = 8
    """Dependences that a verdict lists (a convention)."""
    dependence_level: float = 0.05
    """Dependences that chance explains more often than this are not listed (a convention;
    tests/discover/find/test_dependences.py counts how often noise alone has one) ..."""
    dependence_nats: float = 10.0
    """... nor those that gain less: what a consistent trace of a nuisance is worth (a judgement, not calibrated: as
    much as `bar_nats`)."""
