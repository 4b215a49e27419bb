"""Judge and show: what unseen scenes must bear out, what the frames could show at all, and what a verdict lists."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ShowRules:
    """Thresholds on what is said of an answer that stands."""

    # Sensitivity: what the frames could show. Weights of rays are what they cost the null (`model.likelihood`).
    testable_share: float = 0.5
    """Size at which effects are asked whether these frames could show them, over a clearly visible one,
    `Parameter.scale` (set on severity 2 of `benchmarks/blind`, whose unit is a quarter of it or more)."""
    testable_times: float = 4.0
    """Multiple of a size up to which more scenes of the same kind are advised: sixteen times as many (a judgement, not
    calibrated)."""
    taken_share: float = 0.5
    """Share of an effect taken up by nuisances, from which on they are said to hide it; else too few rays show it (a
    convention: the majority)."""
    agreeing_scenes: int = 7
    """Scenes that must each gain a nat or so for the test over scenes to pass (follows from `agreement_level`: 2 x
    2^-7)."""
    ray_nats: float = 4.0
    """What one ray counts for at most (set on the null, which a reading far off, or a lost ray, costs about that much).
    """
    strange_nats: float = 2.0
    """What a reading is worth that the null has no place for, early or between two surfaces (a judgement, not
    calibrated) ..."""
    empty_column_nats: float = 30.0
    """... and a column without any return, of which the null must lose ray by ray (a judgement, not calibrated)."""
    rounding_nats: float = 1e-3
    """What a scene may gain of an effect that does nothing in it: sums of float32 over its rays do not end at zero (a
    judgement, not calibrated; tests/discover/show/test_sensitivity.py)."""

    # Levels: what sensors usually have of noise.
    usual_range_noise_m: float = 0.03
    """Range noise up to which a sensor is as usual, m, standard deviation (a convention, after data sheets of
    automotive LiDARs) ..."""
    usual_intensity_noise: float = 0.25
    """... and noise of intensities, as a share of them (a convention, likewise) ..."""
    usual_random_loss: float = 0.02
    """... and rays lost within smooth surfaces (a convention, likewise) ..."""
    usual_range_step_m: float = 0.005
    """... and the step of ranges, m, up to which a lattice is said after all else (a convention, likewise) ..."""
    usual_intensity_step: float = 0.004
    """... as that of intensities: eight bits (a convention, likewise)."""
    coarser_step: float = 1.5
    """A lattice is missing, and an effect that rounds a candidate, if its step is so many times the simulator's (a
    judgement, not calibrated)."""

    # Confirm: whether unseen scenes bear an answer out.
    confirmed_nats: float = 0.0
    """Mean gain of judge scenes, in the channels of an effect, above which it stays named (set on 46 names of
    development rows beside this package, benchmarks/blind/measured, worlds_noisy and planted_on_kitti: of 41 right ones
    none has a mean below 0.16 nats; an interval above 0 would have cost 5 of them and none of the 5 wrong) ..."""
    confirmed_share: float = 0.15
    """... and share of what it gained on each scene that it was found on, which judge scenes gain at least (set on
    development rows, benchmarks/blind/measured/hidden_noisy_rows: right names have 0.45 and more, the two wrong ones of
    `blooming` 0.11 and 0.13)."""

    # Add and show: parameters, and the gap on judge scenes.
    interval_widening: float = 1.4
    """Half widths of parameters' intervals are multiplied by this, for the laws of a sensor are not quite those of
    the catalogue (set on development cases, whose laws are not, either)."""
    not_worse_share: float = 0.01
    """Share of its distance by which a channel may grow and still count as not worse (a convention)."""
    most_off_m: float = 1.0
    """Error of a range that counts at most in the gap: a reading of another surface is as wrong as any (a judgement,
    not calibrated)."""
    fewest_curve_rays: int = 200
    """Rays below which no curve of residuals is drawn (a judgement, not calibrated)."""
    candidates_listed: int = 12
    """Candidates of the first step that a verdict lists (a convention)."""
    few_judge_scenes: int = 5
    """Judge scenes below which a note says that intervals are wide (a judgement, not calibrated)."""
