"""Compare: readings that say something of a reflectance or a distance; noise and lattices of frames; kinds of surfaces.

Thresholds of noise were set on the street of tests/discover/noisy_street.py: without noise it has none, and each kind
of noise is told there within a tenth to a third.
"""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class CompareRules:
    """Thresholds on single readings, and on what all readings of a side have in common."""

    # Readings.
    compared_below_rad: float = math.radians(80.0)
    """Intensities are compared below this incidence: beyond it a degree off changes the cosine by a tenth (a
    judgement, not calibrated)."""
    compared_steps: float = 3.0
    """Steps of the sensor's rounding below which predicted intensities are not compared: their logarithms are off (a
    judgement, not calibrated)."""
    compared_noise: float = 0.2
    """Noise that is the same for all intensities, over what is usual of the class, from which on none are compared.
    The sensor's puts the mean of a logarithm off by half its square, the simulator's hides what it means (a judgement,
    not calibrated; tests/discover/model/test_simulator.py)."""
    full_reading: float = 0.9995
    """Intensity from which a reading lies at the end of the sensor's scale: what is brighter reads the same (a
    judgement, not calibrated) ..."""
    full_share: float = 0.05
    """... so surfaces of which more than this share reads it are not compared: the others of them are the dark ones (a
    judgement, not calibrated; tests/discover/model/test_evidence.py)."""
    least_slant: float = 0.03
    """Cosine of incidence below which a range tells nothing: it changes by 33 times what the surface does (a
    judgement, not calibrated)."""

    # Where surfaces end. A bend is how far a mean of the neighbours' 1 / range, straight on a plane, is off the ray's.
    edge_step_m: float = 0.3
    """A ray lies at an edge where the neighbour to a side is farther off than the larger of this (a judgement, not
    calibrated) ..."""
    edge_step_share: float = 0.05
    """... and this share of the range (a judgement, not calibrated) ..."""
    edge_bend: float = 0.03
    """... or where its surface bends by more than this share (a judgement, not calibrated) ..."""
    edge_bend_at_border: float = 0.2
    """... and in the first and last row, which have one neighbour above or below, by this (a judgement, not
    calibrated)."""
    plane_bend: float = 0.01
    """Below this the range image shows a plane, and gives its normal (a judgement, not calibrated)."""

    same_surface_bend: float = 0.1
    """A surface goes on past a ray, lost or not, where its two neighbours differ by less than this share of 1 / range
    (a judgement, not calibrated)."""

    # Surfaces that one side alone has.
    other_surface_m: float = 0.3
    """How far a reading lies off from where on it is of another surface (a judgement, not calibrated)."""
    one_side_share: float = 0.003
    """Share of all rays, with those that hit nothing, up to which readings of a surface that one side alone has are
    left where they are (set on single effects and nulls of the development seeds: 0.13 % at most, beside edges)."""
    apart_class_share: float = 0.03
    """Share of a class's rays on such surfaces from which what this class alone shows of ranges and losses is not said
    (a judgement, not calibrated)."""
    apart_most_share: float = 0.5
    """Share of the rays that such classes hold beyond which too little is left to ask (a judgement, not calibrated)."""
    apart_classes_told: int = 3
    """Classes of such surfaces that a note names at most (a convention)."""
    alike_by_chance: float = 0.1
    """Readings off what is simulated that are like one a quarter of the frame away, over those that are like a
    neighbour's: up to this share a neighbour's is of the same surface (set on the development seeds: fog and rain have
    0.19 to 0.5, crosstalk 0.01)."""

    # Noise and lattices of frames.
    finest_step: float = 1e-3
    """Step up to which a lattice is no rounding (a convention: a thousandth of the full scale, or a millimetre)."""
    lattice_share: float = 0.995
    """Share of the values that must lie on a lattice: a faulty reading does not hide it
    (tests/discover/model/test_noise_levels.py: a few off it do not hide it, many do) ..."""
    lattice_near: float = 0.02
    """... within this share of a step (a judgement, not calibrated) ..."""
    lattice_values: int = 100
    """... and values that it takes: few lie on some lattice by chance (a judgement, not calibrated) ..."""
    lattice_gaps: int = 5
    """... and gaps between them (a judgement, not calibrated)."""
    fewest_differences: int = 400
    """Differences between neighbouring rays of a surface from which noise is told, of each intensity's level too (set
    on noisy_street.py)."""
    fewest_of_class: int = 60
    """Rays of a class from which it is told how its intensities go with angle and range, and how much of what they
    differ by is noise (a judgement, not calibrated)."""
    noisy_range_m: float = 0.004
    """Range noise below which a side counts as ideal, standard deviation: curved surfaces have as much (set on
    noisy_street.py)."""
    noisy_intensity: float = 0.01
    """The same of intensity, as a share of it (set on noisy_street.py)."""
    noisy_incidence_rad: float = math.radians(0.5)
    """The same of angles of incidence (set on noisy_street.py)."""
    noisy_loss: float = 0.001
    """Share of rays lost within smooth surfaces below which holes are the street's (set on noisy_street.py)."""
    ideal_noise: float = 0.5
    """A simulator whose ranges scatter less than this share of the sensor's is ideal where growing noise is asked for:
    what scatters is its surfaces (a judgement, not calibrated) ..."""
    plane_noise: float = 1 / 3
    """... and planes are where they scatter less than this share (a judgement, not calibrated) ..."""
    noise_growth: float = 1.2
    """... whose weakest third of echoes must scatter by more than this ratio, in squares, as the strongest third does
    (a judgement, not calibrated: between even noise on yards of another maker's and the catalogue's of severity 2;
    tests/discover/find/test_levels.py)."""
    coarse_shapes: float = 1.5
    """Ratio of what ranges of smooth surfaces are off by to both sides' noise, beside all that is named, from which the
    simulator's shapes are told to be coarse (a judgement, not calibrated: between streets of the same shapes on both
    sides and cars as boxes on flat ground; tests/discover/show/test_explain.py)."""
    common_noise: float = 0.5
    """Share of the simulator's noise, in squares, above which what the measured readings have in common with it at the
    same rays is noise of neither (a judgement, not calibrated: independent noise has nothing in common, and where one
    side is made of the other's readings all is, tests/discover/model/test_own_noise.py)."""
    noisy_constant: float = 1.0
    """The part of the noise that is the same for all intensities counts from so many times the proportional one on, in
    squares and in the darkest bin: where it is half of the variance. At 4, dark roads in snow, whose readings have
    twice the noise of others, were named an offset (tests/discover/model/test_noise_levels.py)."""
    cosine_as_well: float = 1.1
    """Ratio of variances up to which intensities follow the cosine as well as they follow none (a judgement, not
    calibrated)."""

    # Kinds of surfaces: where no class tells them apart, and where intensities are those of a table.
    level_ground_rad: float = 0.15
    """Planes tilted by less than this are level ground (a judgement, not calibrated)."""
    least_down_rad: float = math.radians(1.0)
    """Rays that look down by less tell no ground from walls (a judgement, not calibrated)."""
    albedo_apart: float = 0.1
    """Nats between knots of ln albedo, at least; where all albedos are alike one knot is left (a judgement, not
    calibrated)."""
    heights_apart_m: float = 0.25
    """Metres between knots of the heights at which surfaces without classes stand, at least (a judgement, not
    calibrated)."""
    coarsest_step: float = 0.02
    """A few intensities are steps of a rounding, and no table, if they are no farther apart than this
    (tests/discover/model/test_kinds.py: a table of five, and a dark scene in 8 bits) ..."""
    filled_lattice: float = 0.5
    """... and so large a share of their lattice is read (set on the same)."""
    one_angle_share: float = 0.1
    """Share of the variance of angles that is left within intensities below which these follow the angle, as a road's
    do by Lambert's law, and are no table (tests/discover/model/test_kinds.py)."""
