"""Every threshold by which `discover` decides, in one place.

What the model itself assumes (noise scales, priors, bounds, steps of an optimiser) stands with it (`discover/model`).
Here stands what turns its numbers into an answer. Some were set on development cases of `benchmarks/blind` (seeds below
10000), as they say; how often they err, sealed cases tell (docs/discover-rates.md). Others are conventions.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from jaxsim.metrics.intervals import LEVEL


@dataclass(frozen=True)
class Rules:
    """Thresholds by the step that they serve. Probabilities and shares are 0..1, gains are nats of log-likelihood on
    scenes that a fit has not seen, summed over the find scenes."""

    # Scenes: their division, and what few of them may decide.
    fewest_scenes: int = 10
    """Scenes that a verdict needs: 3 to judge on and 7 to find with: signs of fewer cannot reach `agreement_level`."""
    judge_share: float = 1 / 3
    """Share of the scenes that is kept for judging."""
    folds: int = 3
    """Parts of the find scenes, each held out of a fit once."""
    decisive_scenes: int = 3
    """Scenes that must agree: no scene's gain or loss counts for more than the third largest (`scenes.clipped`)."""
    sign_draws: int = 4096
    """Signs drawn over scenes where they are too many for all to be tried: 2^12, as many as twelve scenes have."""
    interval_level: float = LEVEL
    """Coverage of every interval that a verdict gives."""

    # Read and pair: whether two folders can be compared at all.
    fewest_returns: float = 0.01
    """Share of rays that return below which a frame counts as empty."""
    nearest_m: float = 0.3
    """Median range below which ranges are not in metres ..."""
    farthest_m: float = 500.0
    """... and above which they are not."""
    consecutive_s: float = 2.0
    """Frames nearer in time than this show the same street."""
    near_m: float = 0.5
    """A measured range agrees with the simulated one within the larger of this ..."""
    near_share: float = 0.05
    """... and this share of the range: every effect of the catalogue but rain and fog leaves most rays so."""
    same_street: float = 0.75
    """Share of rays that agree in a frame, at least: effects of the catalogue leave nearly all, in another street
    little more than the road agrees (tests/discover/read/test_checks.py)."""
    not_beyond: float = 0.8
    """The same share of the rays that agree or go beyond, at least: clutter before the surface does not count."""
    in_sight: float = 0.7
    """Share of measured points that must lie within the simulated image as registered: fewer, and others are apart."""
    most_frames: float = 0.5
    """Share of frames, or of scenes, above which something holds for the folder."""
    common_returns: float = 0.05
    """Rays that return on both sides, of those of the poorer side, at least."""
    steady: float = 0.05
    """Median absolute deviation of ln(measured / simulated range) up to which the two differ by a factor."""
    unit_factor: float = 1.1
    """Factor from which on it is one of units: the catalogue's range_scale ends at 1.02."""
    moved_m: float = 0.06
    """Motion of the sensor beyond its interval from which on the sides are registered first:
    three times what a frame's own pose has; nearer by, fits arrive of themselves ..."""
    turned_rad: float = 0.004
    """... rotation likewise ..."""
    lifted_rad: float = 0.004
    """... and what all beams point higher by."""
    driven_m: float = 0.15
    """Way during a scan, median over drives, from which on missing speeds are read off the frames: nulls of the
    development cases reach 0.05 m; at 10 Hz it is 1.5 m/s ..."""
    driven_sd: float = 3.0
    """... and in how many standard deviations of its own: few rays without a surface have ways of 0.2 m by chance."""
    registered_least: tuple[float, float, float] = (0.006, 0.0003, 0.02)
    """Half widths of a motion's shift (m), turn (rad) and way during a scan (m) at least: planes through neighbouring
    cells are that far off on development cases (`python -m benchmarks.blind.placed`), however many scenes there are."""
    apart_m: float = 0.15
    """Scatter of frames along their heading (median deviation) from which on they are of other moments than their
    partners: poses of frames scatter by 2 cm on development cases ..."""
    farthest_mounted_m: float = 0.6
    """... as they are if all are farther along than this: a mounting is off by 0.5 m at most."""
    related_surfaces: int = 8
    """Surfaces of a scene from which on their intensities can be ranked."""
    related_rays: int = 3
    """Rays from which a surface's mean is taken."""
    better_partner: float = 0.1
    """Share of rays by which agreement is clearly better with another frame, or that of most frames clearly better."""

    # Compare: readings that say something of a reflectance or a distance.
    compared_below_rad: float = math.radians(80.0)
    """Intensities are compared below this incidence: beyond it a degree off changes the cosine by a tenth."""
    compared_steps: float = 3.0
    """Steps of the sensor's rounding below which predicted intensities are not compared: their logarithms are off."""
    compared_noise: float = 0.2
    """Noise that is the same for all intensities, over the predicted one, from which on intensities are not compared.
    The sensor's puts the mean of a logarithm off by half its square, the simulator's hides what it means."""
    full_reading: float = 0.9995
    """Intensity from which a reading lies at the end of the sensor's scale: what is brighter reads the same ..."""
    full_share: float = 0.05
    """... so surfaces of which more than this share reads it are not compared: the others of them are the dark ones."""
    least_slant: float = 0.03
    """Cosine of incidence below which a range tells nothing: it changes by 33 times what the surface does."""

    # Noise and lattices of frames. Those of noise were set on the street of tests/discover/noisy_street.py: without
    # noise it has none, and each kind of noise is told there within a tenth to a third.
    finest_step: float = 1e-3
    """Step up to which a lattice is no rounding: a thousandth of the full scale, or a millimetre."""
    lattice_share: float = 0.995
    """Share of the values that must lie on a lattice: a faulty reading does not hide it ..."""
    lattice_near: float = 0.02
    """... within this share of a step ..."""
    lattice_values: int = 100
    """... and values that it takes: few lie on some lattice by chance ..."""
    lattice_gaps: int = 5
    """... and gaps between them."""
    fewest_differences: int = 400
    """Differences between neighbouring rays of a surface from which noise is told, of each intensity's level too."""
    noisy_range_m: float = 0.004
    """Range noise below which a side counts as ideal, standard deviation: curved surfaces have as much."""
    noisy_intensity: float = 0.01
    """The same of intensity, as a share of it."""
    noisy_incidence_rad: float = math.radians(0.5)
    """The same of angles of incidence."""
    noisy_loss: float = 0.001
    """Share of rays lost within smooth surfaces below which holes are the street's."""
    noisy_constant: float = 4.0
    """The part of the noise that is the same for all intensities counts from so many times the proportional one on, in
    squares and in the darkest bin: where it is four fifths of the variance."""
    cosine_as_well: float = 1.1
    """Ratio of variances up to which intensities follow the cosine as well as they follow none."""

    # Find: dependences of residuals on covariates.
    most_residual_sd: float = 4.0
    """Standard deviations at which residuals of ln I and of ranges are held: heavy tails must not decide."""
    knots: int = 10
    """Knots of a covariate's curve; a free curve that competes with effects has twice as many."""
    interaction_knots: int = 5
    """Knots of each covariate's curve in an interaction of two; rows are a length there: a column each is too many."""
    few_values: int = 40
    """Different values of a covariate up to which its curve is a parabola: it must hold on frames it has not seen."""
    ridge: float = 4.0
    """Observations' worth of pull of a curve's knots to 0."""
    additive_folds: int = 4
    """Folds of scenes on which the additive model of residuals is judged."""
    fewest_residuals: int = 100
    """Residuals below which a channel is not looked at."""
    fewest_effective: float = 100.0
    """The same for interactions, counted as equally large ones (Kish 1965): a handful of lost rays tells nothing."""
    fewest_interaction_scenes: int = 6
    """Scenes below which interactions are not looked at: signs of fewer cannot reach `dependence_level`."""
    interaction_residuals: int = 30_000
    """Residuals on which interactions are tried, evenly spread: more cost time and hardly change their ranks."""
    one_clock: float = 0.99
    """Rank correlation above which time within the scan and azimuth are one covariate, called azimuth."""
    dependences_tried: int = 4
    """Dependences looked for in each channel, one on top of another."""
    dependences_listed: int = 8
    """Dependences that a verdict lists."""
    dependence_level: float = 0.05
    """Dependences that chance explains more often than this are not listed ..."""
    dependence_nats: float = 10.0
    """... nor those that gain less: what a consistent trace of a nuisance is worth."""

    # Name: which effect, or none.
    bar_nats: float = 10.0
    """Gain that a candidate must exceed; set on nulls of the development seeds. `nulls` may raise it."""
    agreement_level: float = 0.02
    """Of the sign-flip test over scenes that a candidate must pass; set on sixty nulls of the development seeds."""
    direction_share: float = 0.25
    """Part of the way from the null to a fit at which scenes must agree on its direction, if not on its length."""
    pile_within: float = 0.005
    """Readings within this share of the largest are piled up there ..."""
    piled_share: float = 0.002
    """... if they are at least this share of all: a saturation is then tried."""
    gate_nats: float = 20.0
    """Nats by which a border between lost and returned rays, or a wave of ranges, must be likelier than none."""
    hidden_share: float = 0.8
    """Share of rays lost above which a bin of azimuth may be hidden."""
    sudden_nats: float = 12.0
    """Gain of each of `decisive_scenes` with which a rare event (lost packets) passes without that test ..."""
    sudden_loss: float = 0.05
    """... if the others lose less than this share of what is gained in all."""
    beam_rows: int = 3
    """Rows to each side over which beams' numbers are made smooth, to see what the beams gain beyond their rows."""
    alike_level: float = 0.10
    """A candidate is a look-alike of the best unless the paired test against it falls to this ..."""
    alike_share: float = 0.75
    """... or it gains less than this share of what the best does."""
    same_share: float = 0.999
    """Share of one effect's expectation that another reproduces from which no frames like these tell them apart."""
    alike_nats: float = 2.0
    """Gain that is no difference between two candidates."""
    nearly_share: float = 0.9
    """Share of the best's gain from which a simpler one of its channels is tried instead, if others came after it."""
    weak_share: float = 0.5
    """Share of the largest gain, accepted or not, that the answer must reach: a weak one is none to a strong gap."""
    most_effects: int = 4
    """Effects that are named at most."""
    elsewhere_share: float = 0.25
    """Share of its gain that what is found may gain on other sides (`name.other_sides`): what is new loses there."""
    control_level: float = 0.002
    """Of the permutation test of scenes against the control's: each of a catalogue may differ a little by chance."""
    same_brightness_nats: float = 0.1
    """Standard deviation up to which both know how bright surfaces are; tables of reflectances are off by more."""
    contrast_nats: float = 30.0
    """Gain from which on the sensor does not follow the simulator's contrast: above ideal simulators' nulls."""
    curves_tried: int = 3
    """Covariates of each channel along which free curves compete: those that its residuals depend on most."""
    curve_level: float = 0.005
    """Of the sign-flip test of a free curve: curves are many and bend anywhere."""
    curve_factor: float = 1.1
    """To say `not_in_catalogue` a free curve must gain so many times what its channel's named effects do ..."""
    curve_margin_nats: float = 10.0
    """... and so much more."""
    curve_simpler: float = 0.5
    """... but only as much with fewer numbers than this share of theirs. Set on three offsets of every second row."""
    curve_pieces: int = 3
    """... and no more than so many effects of its channel where its law leaves none of them anything to say."""
    shape_price: float = 0.1
    """Each number of a curve's shape (line, step, wave) counts like this share of what the shape leaves unexplained."""
    shape_unlike: float = 0.6
    """Share of a free curve's variation, so counted, from which on no shape is near it."""

    # Learn: what no effect describes, as a law.
    learned_groups: int = 12
    """Groups of find scenes, at most, each left out once to see how sure a learned law is."""
    law_price_nats: float = 2.0
    """Held-out nats that each node of a closed formula must gain."""
    law_least_share: float = 0.5
    """Share of a learned curve's variation that a closed formula must tell."""
    law_fewest_knots: int = 5
    """Knots below which a covariate has no formula: any would fit them."""

    # Repeat: what comes back in sensor coordinates and no effect explains.
    repeats_level: float = 0.02
    """Of the sign flips over find scenes, over all scales, places and channels: one null in fifty ..."""
    repeats_judge_level: float = 0.05
    """... and of those over judge scenes, of the pattern that was found; of few scenes all must agree."""
    repeats_rays: int = 300_000
    """Rays that are looked at: more than a fit takes, or scenes would rarely show the same columns."""
    repeats_bins: int = 32
    """Groups of columns that are looked at as places, as many as a residual map shows."""
    repeats_tried: int = 8
    """Patterns looked for, each on top of the ones before."""
    repeats_least_nats: float = 0.02
    """Height below which a pattern of ln I does not count ..."""
    repeats_least_m: float = 0.005
    """... one of the range, m ..."""
    repeats_least_lost: float = 0.005
    """... and one of the share of rays lost: streets resemble each other, and so a little of nuisances repeats. Of 31
    development nulls with an ideal simulator none passed; of four with a noisy one ranges of rows were off by 1.1 mm
    at most. What rounding may do comes on top (`repeats.maps.Maps.rounding`)."""
    repeats_one_pattern: float = 0.5
    """Share of what scenes' maps have in common that one pattern must explain to be told in place of all."""

    # Sensitivity: what the frames could show.
    testable_share: float = 0.5
    """Size at which effects are asked whether these frames could show them, over a clearly visible one
    (`Parameter.scale`): severity 2 of `benchmarks/blind`, whose unit is a quarter of it or more."""
    testable_times: float = 4.0
    """Multiple of a size up to which more scenes of the same kind are advised: sixteen times as many."""
    taken_share: float = 0.5
    """Share of an effect taken up by nuisances, from which on they are said to hide it; else too few rays show it."""
    agreeing_scenes: int = 7
    """Scenes that must each gain a nat or so for the test over scenes to pass at `agreement_level`: 2 x 2^-7."""
    other_surface_m: float = 0.3
    """Change of a range from which on another surface is met."""
    ray_nats: float = 4.0
    """What one ray counts for at most: a reading far off, or a lost ray, costs the null about that much."""
    strange_nats: float = 2.0
    """What a reading is worth that the null has no place for (early, between two surfaces) ..."""
    empty_column_nats: float = 30.0
    """... and a column without any return, of which the null must lose ray by ray."""
    rounding_nats: float = 1e-3
    """What a scene may gain of an effect that does nothing in it: sums of float32 over its rays do not end at zero."""

    # Regimes: whether an effect acts everywhere.
    regime_level: float = 0.05
    """Rate of false discoveries (Benjamini-Hochberg) over all questions that are asked of what divides effects."""
    regime_fewest_scenes: int = 3
    """Scenes that a regime has inside and outside, at least."""
    regime_sectors: int = 48
    """Sectors of azimuth, of whose arcs regimes are made ..."""
    regime_least_arc: float = 0.06
    """... with this share of the scan, at least."""
    regime_nats: float = 10.0
    """What an effect must gain more on held-out find scenes where it acts in its region alone: `bar_nats` once more."""
    regime_outside: float = 0.5
    """Size outside, over that inside, below which it must lie for certain: streets alone make sizes differ a little."""
    regime_least_curvature: float = 0.02
    """Curvature of a scene's likelihood in an effect's size, over the largest scene's, below which it tells no size."""
    regime_rivals: int = 3
    """Other candidates that are fitted in a region, where another may be the better name."""

    # Levels: what sensors usually have of noise; conventions, after data sheets of automotive LiDARs.
    usual_range_noise_m: float = 0.03
    """Range noise up to which a sensor is as usual, m, standard deviation ..."""
    usual_intensity_noise: float = 0.25
    """... and noise of intensities, as a share of them ..."""
    usual_random_loss: float = 0.02
    """... and rays lost within smooth surfaces."""
    coarser_step: float = 1.5
    """A lattice is missing, and an effect that rounds a candidate, if its step is so many times the simulator's."""

    # Confirm: whether unseen scenes bear an answer out.
    confirmed_nats: float = 0.0
    """Mean gain of judge scenes, in the channels of an effect, above which it stays named. Weighed on 46 names of rows
    beside this package (benchmarks/blind/measured, worlds_noisy and planted_on_kitti; development seeds): of 41 right
    ones none has a mean below 0.16 nats; an interval above 0 would have cost 5 of them and none of the 5 wrong."""

    # Add and show: parameters, and the gap on judge scenes.
    interval_widening: float = 1.4
    """Half widths of parameters' intervals are multiplied by this, for the laws of a sensor are not quite those of
    the catalogue, nor were those of the development cases that it was set on."""
    not_worse_share: float = 0.01
    """Share of its distance by which a channel may grow and still count as not worse."""
    most_off_m: float = 1.0
    """Error of a range that counts at most in the gap: a reading of another surface is as wrong as any."""
    fewest_curve_rays: int = 200
    """Rays below which no curve of residuals is drawn."""
    candidates_listed: int = 12
    """Candidates of the first step that a verdict lists."""
    few_judge_scenes: int = 5
    """Judge scenes below which a note says that intervals are wide."""

    # Unpaired: where the two sides show different streets.
    unpaired_fewest_scenes: int = 8
    """Scenes that each side needs: 5 to find with, so that their exchange has 252 outcomes, and 3 to judge on."""
    unpaired_exchanges: int = 400
    """Exchanges of scenes between the sides, the true one included."""
    unpaired_level: float = 0.01
    """Share of exchanges that may reach what an accepted candidate reaches, over all candidates."""
    unpaired_agreement_level: float = 0.05
    """Of the sign-flip test over scenes that held-out gains must pass."""
    unpaired_folds: int = 4
    """Parts of each side's find scenes, each held out once."""
    unpaired_alike_share: float = 0.5
    """Share of the best candidate's gain below which another is no look-alike."""
    unpaired_most_effects: int = 3
    """Effects on intensity that are named at most."""
    unpaired_curve_factor: float = 1.3
    """A free curve must gain so many times what the best effect does, and `curve_margin_nats` more, to be none."""
    unpaired_few_scenes: int = 16
    """Find scenes of both sides below which a note says that weak effects cannot be told."""
    unpaired_same_m: float = 0.3
    """Frames of one name whose ranges agree this well ..."""
    unpaired_same_share: float = 0.5
    """... at more than this share of the rays show the same street: a note says that they need not be unpaired."""
    unpaired_level_rise: float = 0.9
    """Vertical part of a normal above which a surface is level ..."""
    unpaired_below_m: float = 0.3
    """... and how far below the sensor: the median height of such is the ground's."""
    unpaired_ground_rise: float = 0.7
    """Kinds of surfaces: ground is flatter than this (vertical part of the normal, 45 degrees) ..."""
    unpaired_ground_m: float = 0.4
    """... and lies no higher than this above the median of it ..."""
    unpaired_upright_rise: float = 0.5
    """... what is steeper than this (60 degrees) is upright, and all else a kind of its own."""
    unpaired_sure_hits: float = 0.98
    """Share of simulated rays that hit something in the rows in which losses of single rays are compared."""
    unpaired_fewest_rows: int = 3
    """Such rows below which they are not."""
    unpaired_usual_losses: float = 0.02
    """Share of rays on smooth surfaces that may be lost for what only paired frames tell apart (nulls: 1.1 %)."""
    unpaired_hidden_share: float = 0.5
    """Share of a side's frames in which a column is empty, from where it belongs to a hidden sector."""
    unpaired_smooth_share: float = 0.05
    """A lost ray lay on a smooth surface if the neighbours beside it returned, ranges no farther apart, as a share."""
    unpaired_lost_exchanges: int = 2000
    """Exchanges of scenes between the sides for lost rays, which cost next to nothing."""
    unpaired_parts: tuple[int, int] = (3, 6)
    """Parts of the rows and of the azimuth whose losses are compared."""
    unpaired_uneven: float = 2.5
    """Losses of one probability differ by less than this factor between these parts."""

    # Gate, watch and targets: whether a simulation passes, and whether a sensor is as it was.
    fewest_for_scatter: int = 4
    """Scenes below which the scatter between them says nothing of a distance, of a day, or of a kind of targets."""
    fewest_target_points: int = 10
    """Points of a target, on the side that has more of them, below which their counts are chance."""
    target_beside_m: float = 0.5
    """How far a measured point may lie before and behind a target's own simulated ranges to be one of it."""
    odd_frames: int = 5
    """Frames that are listed as those which an answer serves worst, of folders that do not fit into memory."""
    gate_worse_share: float = 0.10
    """Share by which a channel's distance may exceed the baseline's: a mean over eight scenes scatters by less."""
    gate_effect_nats: float = 2.5
    """Held-out nats a scene from which a named effect is a gap, by default, and nats of judge scenes from which what
    has no name is one; below it a gate is unsure. Weighed on benchmarks/blind/measured (worlds_sealed, ..._again,
    worlds_nulls_again): of 127 nulls six had a name, with 1.0 to 2.1 nats; of 40 named effects of severity 2 seven had
    less. Of ten nulls without a name two had more."""
    gate_least: float = 1e-3
    """Least threshold of a distance: a millimetre, a thousandth of the full scale, or of the rays; finer than files."""
    watch_chance: float = 0.05
    """Probability that a day without any change shows one, all rows and sectors together (Bonferroni)."""


RULES = Rules()
"""The rules that are in force."""
