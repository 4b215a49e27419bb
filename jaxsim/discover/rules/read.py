"""Read and pair: whether two folders can be compared at all; and scenes, what few of them may decide."""

from __future__ import annotations

from dataclasses import dataclass

from jaxsim.metrics.intervals import LEVEL


@dataclass(frozen=True)
class ReadRules:
    """Thresholds on scenes, frames and pairs of frames."""

    # Scenes: their division, and what few of them may decide.
    fewest_scenes: int = 10
    """Scenes that a verdict needs: 3 to judge on and 7 to find with (follows from `agreement_level`, which signs of
    fewer cannot reach; tests/discover/test_scenes.py)."""
    judge_share: float = 1 / 3
    """Share of the scenes that is kept for judging (a convention)."""
    sectors: int = 12
    """Sectors into which frames of a single drive are cut, as its scenes; of a few drives, into as many as give about
    so many of all. Into so many pieces, too, are drives cut along the way (a judgement, not calibrated)."""
    guard_columns: int = 4
    """Columns left out on each side of a sector: neighbouring rays share a surface (a judgement, not calibrated)."""
    fewest_columns: int = 8
    """Columns of each frame, and of each sector, that are looked at in any case; narrower sectors are refused (a
    judgement, not calibrated)."""
    folds: int = 3
    """Parts of the find scenes, each held out of a fit once (a convention)."""
    decisive_scenes: int = 3
    """Scenes that must agree: no scene's gain or loss counts for more than the third largest, `scenes.clipped` (a
    judgement, not calibrated; tests/discover/name/test_candidates.py: two decide nothing, three do)."""
    sign_draws: int = 4096
    """Signs drawn over scenes where they are too many for all to be tried (a convention: 2^12, as many as twelve scenes
    have)."""
    interval_level: float = LEVEL
    """Coverage of every interval that a verdict gives (a convention)."""

    # Frames.
    fewest_returns: float = 0.01
    """Share of rays that return below which a frame counts as empty (a judgement, not calibrated)."""
    nearest_m: float = 0.3
    """Median range below which ranges are not in metres (a judgement, not calibrated) ..."""
    farthest_m: float = 500.0
    """... and above which they are not (a judgement, not calibrated)."""
    consecutive_s: float = 2.0
    """Frames nearer in time than this show the same street (a judgement, not calibrated)."""

    # Pairs of frames.
    near_m: float = 0.5
    """A measured range agrees with the simulated one within the larger of this (set on the catalogue, whose effects but
    rain and fog leave most rays so; tests/discover/read/test_checks.py has some of severity 4) ..."""
    near_share: float = 0.05
    """... and this share of the range (set on the same)."""
    same_street: float = 0.75
    """Share of rays that agree in a frame, at least: effects of the catalogue leave nearly all, in another street
    little more than the road agrees (tests/discover/read/test_checks.py)."""
    not_beyond: float = 0.8
    """The same share of the rays that agree or go beyond, at least: clutter before the surface does not count
    (tests/discover/read/test_checks.py: dense fog passes, another street does not)."""
    in_sight: float = 0.7
    """Share of measured points that must lie within the simulated image as registered: fewer, and others are apart (a
    judgement, not calibrated)."""
    most_frames: float = 0.5
    """Share of frames, or of scenes, above which something holds for the folder (a convention: the majority)."""
    common_returns: float = 0.05
    """Rays that return on both sides, of those of the poorer side, at least (a judgement, not calibrated)."""
    steady: float = 0.05
    """Median absolute deviation of ln(measured / simulated range) up to which the two differ by a factor (a judgement,
    not calibrated) ..."""
    unit_factor: float = 1.1
    """... and factor from which on it is one of units (set on the catalogue, whose range_scale ends at 1.02)."""
    better_partner: float = 0.1
    """Share of rays by which agreement is clearly better with another frame, or that of most frames clearly better
    (tests/discover/read/test_checks.py: streets that share nine rows in ten tell nothing, those that share fewer do).
    """

    # Registration.
    moved_m: float = 0.06
    """Motion of the sensor beyond its interval from which on the sides are registered first (set on development cases:
    a scale of the range looks like one by up to 0.034 m; nearer by, fits arrive of themselves) ..."""
    stretched: float = 0.002
    """Share by which all ranges are too long, beyond its interval, that a motion is not held to explain (a judgement,
    not calibrated)."""
    turned_rad: float = 0.002
    """... rotation likewise (set on the same: no effect of ranges, and no other world, has any beyond its interval, and
    from a yaw of 0.0035 no fit arrives of itself) ..."""
    lifted_rad: float = 0.004
    """... and what all beams point higher by (a judgement, not calibrated)."""
    driven_m: float = 0.15
    """Way during a scan, median over drives, from which on missing speeds are read off the frames; at 10 Hz it is
    1.5 m/s (set on nulls of the development cases, which reach 0.05 m) ..."""
    driven_sd: float = 3.0
    """... and in how many standard deviations of its own: few rays without a surface have ways of 0.2 m by chance (a
    convention)."""
    registered_least: tuple[float, float, float] = (0.006, 0.0003, 0.02)
    """Half widths of a motion's shift (m), turn (rad) and way during a scan (m) at least, however many scenes there are
    (set on development cases, where planes through neighbouring cells are that far off:
    `python -m benchmarks.blind.placed`)."""
    unsteady_sd: float = 2.0
    """Scatter of frames' own poses about their median, over `POSE_SD`, from which on each frame is brought to its own
    place (a judgement, not calibrated: development cases scatter by 1)."""
    apart_m: float = 0.15
    """Scatter of frames along their heading (median deviation) from which on they are of other moments than their
    partners (set on development cases, where poses of frames scatter by 2 cm) ..."""
    farthest_mounted_m: float = 0.6
    """... as they are if all are farther along than this (set on the catalogue, by which a mounting is off by 0.5 m at
    most)."""
    fastest_mps: float = 50.0
    """Speed from which on a note asks for its unit: 180 km/h (a convention)."""
    uneven_nats: float = 0.3
    """Scatter of the frames' brightness beside the simulated ones, ln, from which on a note tells of it (a
    judgement, not calibrated: simulators that know no material have half as much)."""
    fading_drives: int = 3
    """Drives, each of `fading_frames` frames with times or more, from which on a note tells that all of them grow
    darker or brighter (a judgement, not calibrated)."""
    fading_frames: int = 4
    """Frames of a drive below which its course is not looked at (a judgement, not calibrated)."""
    fading_level: float = 0.01
    """Share of other orders of its frames that may fade as much (a convention)."""
    fading_nats: float = 0.15
    """Least change in the course of a drive, ln (a judgement, not calibrated: half of `uneven_nats`)."""
    alone_nats: float = 1.5
    """By so much one frame's brightness is off the others' before it is told by name, where it is also off by
    `alone_sds` of their scatter (a judgement, not calibrated)."""
    alone_sds: float = 6.0
    """... (a judgement, not calibrated)."""
    reversed_incidence: float = -0.5
    """Rank correlation of the angles of incidence that frames tell with those of their range images, below which they
    are something else, as cosines: angles of the same surfaces agree far above 0 (a judgement, not calibrated)."""
    background_share: float = 0.25
    """Share of a frame's rays from which on one object is asked whether it is one (a judgement, not calibrated) ..."""
    background_class_share: float = 0.05
    """... and of its rays, which two classes must have for it to be none: a rider has a bicycle, and no road (a
    judgement, not calibrated)."""
    same_numbers: float = 0.9
    """Share of rays with the same number on both sides from which on it is told: two that are read for themselves have
    few, whatever steps they are rounded to (a judgement, not calibrated)."""
    related_surfaces: int = 8
    """Surfaces of a scene from which on their intensities can be ranked (a judgement, not calibrated)."""
    related_rays: int = 3
    """Rays from which a surface's mean is taken (a judgement, not calibrated)."""
    one_material_bins: int = 24
    """Quantiles of the range, and of the angle within each, that rays are binned by (a convention)."""
    one_material_share: float = 0.02
    """Share of the simulated intensities' variance that bins may leave where these follow from range and angle alone:
    that of a smooth law within them is a five hundredth or so (tests/discover/find/test_correlation.py)."""
