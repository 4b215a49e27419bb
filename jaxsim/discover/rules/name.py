"""Name: which effect, or none; and which effects look alike."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class NameRules:
    """Thresholds on starts, candidates, their rivals and free curves."""

    # Starts that are read off the readings.
    pile_within: float = 0.005
    """Readings within this share of the largest are piled up there (a judgement, not calibrated) ..."""
    piled_share: float = 0.002
    """... if they are at least this share of all: a saturation is then tried (a judgement, not calibrated)."""
    lost_says_nats: float = math.log(90.0)
    """By so much a lost ray speaks for being hidden (a judgement, not calibrated: of hidden rays nine of ten are lost,
    of others one of a hundred) ..."""
    returned_says_nats: float = math.log(0.1)
    """... and one that returned against it (the same judgement)."""
    gate_nats: float = 20.0
    """Nats by which a border between lost and returned rays, or a wave of ranges, must be likelier than none (a
    judgement, not calibrated)."""
    gate_past_m: tuple[float, float, float] = (0.02, 0.05, 0.1)
    """How far past a border between lost and returned rays a gate may lie: fits begin there (a judgement, not
    calibrated)."""
    hidden_share: float = 0.8
    """Share of rays lost above which a bin of azimuth may be hidden (a judgement, not calibrated)."""
    wave_most_m: float = 0.4
    """Errors beyond this are of another surface, and no wave's (a judgement, not calibrated)."""
    waves_tried: int = 3
    """Waves of different lengths that fits begin at (a judgement, not calibrated)."""

    # Candidates.
    bar_nats: float = 10.0
    """Gain that a candidate must exceed; `nulls` may raise it (set on nulls of the development seeds)."""
    hopeless_share: float = 0.25
    """Share of the bar that a fit must gain on the very scenes that it was fitted to, two thirds of all, to be worth
    others: on scenes that no fit has seen the three of them gain less, but for chance (a judgement, not calibrated)."""
    agreement_level: float = 0.02
    """Of the sign-flip test over scenes that a candidate must pass (set on sixty nulls of the development seeds)."""
    direction_share: float = 0.25
    """Part of the way from the null to a fit at which scenes must agree on its direction, if not on its length (set on
    yaw, falloff and range walk of severity 2, which were not told from noise without it)."""
    negligible: float = 0.1
    """Size up to which no effect is said, of what is clearly visible (`Parameter.scale`): many rays show scales of the
    range and offsets that a mesh's smoothing and rounding have as well (a judgement: set on real scans beside
    simulators made of them, which are not kept; hidden effects of `benchmarks/blind` are mostly over twice as large).
    """
    materials_nats: float = 7.0
    """Nats a thousand compared rays up to which nothing is said of intensities by range, row, height, angle or
    brightness where no class tells materials apart (set on false names in the bare halls and motorways of
    benchmarks/blind/measured/worlds_bare/before.jsonl and in another maker's car parks and streets; of what was hidden
    there or in real scans little gains less)."""
    scarce_clutter: float = 0.004
    """Share of false returns before surfaces up to which no effect is said (a judgement, not calibrated: where a
    simulator casts single rays, beams of 2.5 mrad read thin things that it misses on 0.2 to 0.35 % of the rays, and the
    unit of severity of `benchmarks/blind` is 0.5 % or more)."""
    sudden_nats: float = 12.0
    """Gain of each of `decisive_scenes` with which a rare event (lost packets) passes without that test (a judgement,
    not calibrated; tests/discover/name/test_candidates.py) ..."""
    sudden_loss: float = 0.1
    """... if the others lose less than this share of what is gained in all (follows from lost packets: a scene without
    any pays 0.6 nats for two that may be lost in a hundred, of the 16 that one gains; three of eleven are then 0.1)."""
    beam_rows: int = 3
    """Rows to each side over which beams' numbers are made smooth, to see what the beams gain beyond their rows
    (tests/discover/name/test_candidates.py: a line stays, numbers of a beam each lose more than half their variance).
    """
    closer_nats: float = 2.0
    """Gain from which on a candidate that is not accepted makes a closer look worth its time: three times as much might
    pass the bar (a judgement, not calibrated) ..."""
    closer_most: int = 12
    """... which asks so many, the best (a judgement, not calibrated)."""
    nearly_share: float = 0.9
    """Share of the best's gain from which a simpler one of its channels is tried instead, if others came after it (a
    judgement, not calibrated; tests/discover/name/test_select.py)."""
    weak_share: float = 0.5
    """Share of the largest gain, accepted or not, that the answer must reach: a weak one is none to a strong gap (a
    judgement, not calibrated)."""
    most_effects: int = 4
    """Effects that are named at most (a convention)."""

    # Rivals, and other sides.
    alike_level: float = 0.10
    """A candidate is a look-alike of the best unless the paired test against it falls to this (a convention) ..."""
    alike_share: float = 0.75
    """... or it gains less than this share of what the best does (a judgement, not calibrated)."""
    same_share: float = 0.999
    """Share of one effect's expectation that another reproduces from which no frames like these tell them apart (a
    judgement, not calibrated)."""
    alike_nats: float = 2.0
    """Gain that is no difference between two candidates (a judgement, not calibrated)."""
    class_least_share: float = 0.02
    """Share of the rays that a class holds, and leaves, to be asked what the others say without it (a judgement, not
    calibrated)."""
    denied_level: float = 0.05
    """Of the sign-flip test over scenes by which the others lose by an effect (a convention)."""
    denied_share: float = 0.25
    """Share of what the others would gain if an effect of the intensity were there up to which they speak against it (a
    judgement, not calibrated) ..."""
    denied_sds: float = 2.5
    """... if it lies so many standard deviations below that (set on development seeds, of which
    benchmarks/blind/measured/hidden_noisy_glass tells: cars' glass against hidden effects)."""
    outdone_sds: float = 3.0
    """Standard deviations by which a class falls short of what it would gain by an effect, from which on a look-alike
    is said instead (set on development cases, of which benchmarks/blind/measured/hidden_noisy_corners tells: effects
    that bend intensities, one against another) ..."""
    due_sds: float = 2.5
    """... of which no class falls short by so many (set as `denied_sds`)."""
    elsewhere_share: float = 0.25
    """Share of its gain that what is found may gain on other sides (`name.other_sides`): what is new loses there (a
    judgement, not calibrated)."""
    control_level: float = 0.002
    """Of the permutation test of scenes against the control's: each of a catalogue may differ a little by chance (a
    judgement, not calibrated; tests/discover/name/test_other_sides.py counts how often two alike groups pass)."""
    same_brightness_nats: float = 0.1
    """Standard deviation up to which both know how bright surfaces are; tables of reflectances are off by more (a
    judgement, not calibrated)."""
    contrast_nats: float = 30.0
    """Gain from which on the sensor does not follow the simulator's contrast (set on development nulls of ideal
    simulators, which gain less, and on learned simulators, which gain far more)."""

    # How alike an effect of one's own is to one of the catalogue: what changes of a ray are counted in.
    typical_nats: float = 0.1
    """Standard deviation of ln I in which a change of a ray is counted (a judgement, not calibrated) ..."""
    typical_m: float = 0.02
    """... of a reading of the range and of its noise (a judgement, not calibrated) ..."""
    typical_probability: float = 0.2
    """... and of what becomes of it by chance (a judgement, not calibrated)."""
    most_changed_sd: float = 10.0
    """Such deviations that one ray counts for at most: jumps to another surface are as good as lost (a judgement, not
    calibrated)."""

    # Free curves.
    curves_tried: int = 3
    """Covariates of each channel along which free curves compete: those that its residuals depend on most (a
    judgement, not calibrated)."""
    curve_level: float = 0.005
    """Of the sign-flip test of a free curve: curves are many and bend anywhere (a judgement, not calibrated)."""
    curve_factor: float = 1.1
    """To say `not_in_catalogue` a free curve must gain so many times what its channel's named effects do (a judgement,
    not calibrated; tests/discover/name/test_answer.py) ..."""
    curve_margin_nats: float = 10.0
    """... and so much more (a judgement, not calibrated: as much as `bar_nats`) ..."""
    curve_simpler: float = 0.5
    """... but only as much with fewer numbers than this share of theirs (set on three development cases of an offset of
    every second row) ..."""
    curve_pieces: int = 3
    """... and no more than so many effects of its channel where its law leaves none of them anything to say (a
    judgement, not calibrated; tests/discover/name/test_answer.py: two are no pieces)."""
    shape_price: float = 0.1
    """Each number of a curve's shape (line, step, wave) counts like this share of what the shape leaves unexplained (a
    judgement, not calibrated)."""
    shape_unlike: float = 0.6
    """Share of a free curve's variation, so counted, from which on no shape is near it (a judgement, not calibrated;
    tests/discover/name/test_unexplained.py)."""
    wave_cycles: tuple[float, float] = (2.0, 8.0)
    """Cycles of a wave over a whole curve: with fewer it is a bend, with more the knots do not follow it. In a turn one
    is enough, for what runs round the sensor once is a wave, too (a judgement, not calibrated)."""
    outer_rays: float = 0.005
    """Share of the rays at each end that do not count where waves are (tests/discover/name/test_unexplained.py: a few
    rays far off do not make a bend of the others a wave)."""
    whole_turn: float = 0.9
    """Share of a turn from which on a curve over angles closes (a judgement, not calibrated)."""
