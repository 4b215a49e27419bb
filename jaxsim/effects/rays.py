"""What effects act on: the rays of simulated frames, from what they hit to what the sensor says of it.

Shapes: a `Scan` holds whole frames (f frames, r rows, c columns); `Rays` are any choice of its rays, shape
`*n`. An effect is written once and serves both: all rays of a scan to simulate, a thinned set to fit.

`covariates` has what a reading may depend on, by the names that verdict.json and sensor.json use. One table serves both
kinds of arrays: NumPy's, where `discover` looks at residuals on the host, and JAX's, where a learned law acts on rays.
"""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType
from typing import Any

import jax.numpy as jnp
from flax import struct
from jaxtyping import Bool, Float, Int

from jaxsim.frame import Array, PolarGrid

TURN = 6.283185307179586
"""All round, rad."""
REFERENCE_M = 10.0
"""Range at which power and intensity agree."""
LEAST_M = 0.1
"""Ranges count as no nearer where they divide or their logarithm is taken: what hits nothing may have range 0."""
FLOOR = 1e-4
"""Intensities are kept above this before their logarithm is taken."""
NEVER = -30.0
"""Logarithm of a probability that is as good as 0."""
CLUTTER_REACH_M = 100.0
"""The range where clutter of rays that hit nothing ends."""


def covariates(xp: ModuleType) -> dict[str, Callable[[Any], Any]]:
    """Each covariate as a function of rays whose fields are arrays of `xp`, numpy or jax.numpy."""

    def step(r: Any) -> Any:
        """Signed depth step to the side where it is larger: positive to the right, compressed, m."""
        beside = r.beside_m[..., :2]
        # A neighbour that hits nothing lies far behind.
        side = xp.where(xp.isfinite(beside), beside, 100.0) - r.range_m[..., None]
        larger = xp.where(xp.abs(side[..., 0]) > xp.abs(side[..., 1]), -side[..., 0], side[..., 1])
        return xp.sign(larger) * xp.log1p(xp.abs(larger) / 0.3)

    return {
        "range": lambda r: xp.log(xp.maximum(r.range_m, 0.5)),
        "incidence": lambda r: r.incidence_rad,
        "height": lambda r: r.range_m * xp.sin(r.elevation_rad),
        "row": lambda r: r.row,
        "azimuth": lambda r: r.azimuth_rad,
        "even rows": lambda r: r.row % 2,
        "even columns": lambda r: r.column % 2,
        "column": lambda r: r.column,
        "class": lambda r: r.semantic,
        "power": lambda r: r.log_power,
        "intensity": lambda r: r.log_intensity,
        "step": lambda r: xp.abs(step(r)),
        "step side": step,
        "frame": lambda r: r.time_s,
        "time": lambda r: r.phase,
        "speed": lambda r: r.speed_mps,
        "speed x time": lambda r: r.speed_mps * (r.phase - 0.5) * xp.cos(r.azimuth_rad),
        "heading": lambda r: xp.mod(r.azimuth_rad + r.heading_rad, TURN),
        "rgb": lambda r: r.rgb.mean(-1),
        "hue": lambda r: r.rgb[..., 0] - r.rgb[..., 2],
        "hue angle": lambda r: xp.arctan2(
            xp.sqrt(3.0) * (r.rgb[..., 1] - r.rgb[..., 2]), 2 * r.rgb[..., 0] - r.rgb[..., 1] - r.rgb[..., 2]
        ),
    }


READ = covariates(jnp)
"""The covariates as learned laws read them; the column serves what repeats alone, curves go by the azimuth."""


@struct.dataclass
class Scan:
    """Simulated frames on one grid: what the ray model knows. Where `hit` is False the other rasters mean nothing."""

    grid: PolarGrid
    range_m: Float[Array, "f r c"]
    hit: Bool[Array, "f r c"]
    intensity: Float[Array, "f r c"]
    incidence_rad: Float[Array, "f r c"]
    semantic: Int[Array, "f r c"]
    """Cityscapes ids; 0 where the simulator gives none."""
    instance: Int[Array, "f r c"]
    rgb: Float[Array, "f r c 3"]
    """0..1; 0 where the simulator gives none."""
    phase: Float[Array, "f r c"]
    """When the ray was fired, 0 first to 1 last of its scan."""
    glare_m: Float[Array, "f r c"]
    """Range of the nearest very bright target (signs, or intensity 0.9 and more) by angle."""
    glare_rad: Float[Array, "f r c"]
    """Angle to it; pi where there is none within 0.3 rad."""
    slopes: Float[Array, "f r c 2"]
    """Slopes of the surfaces to the left and up: what `scan.slopes_of` makes of `range_m` and `hit`."""
    time_s: Float[Array, " f"]
    """Since the first frame of the recording."""
    speed_mps: Float[Array, " f"]
    heading_rad: Float[Array, " f"]
    tags: dict[str, Bool[Array, " f"]] = struct.field(default_factory=dict)
    """The frames that have a tag, by tag."""


@struct.dataclass
class Rays:
    """Rays with the surface that each meets and, edited by effect after effect, what becomes of it."""

    # Which ray
    frame: Int[Array, "*n"]
    row: Int[Array, "*n"]
    column: Int[Array, "*n"]
    azimuth_rad: Float[Array, "*n"]
    """Nominal: the direction under which the reading is written."""
    elevation_rad: Float[Array, "*n"]
    phase: Float[Array, "*n"]
    time_s: Float[Array, "*n"]
    speed_mps: Float[Array, "*n"]
    heading_rad: Float[Array, "*n"]

    # Where it truly goes; effects of geometry turn and move it, one after the other
    turned_rad: Float[Array, "*n 2"]
    """True minus nominal azimuth and elevation."""
    moved_m: Float[Array, "*n 3"]
    """True minus nominal origin, in `velo`."""

    # What it meets; effects of geometry meet something else
    hit: Bool[Array, "*n"]
    range_m: Float[Array, "*n"]
    incidence_rad: Float[Array, "*n"]
    semantic: Int[Array, "*n"]
    instance: Int[Array, "*n"]
    rgb: Float[Array, "*n 3"]
    beside_m: Float[Array, "*n 4"]
    """Ranges of the neighbours left, right, up, down; infinite where they hit nothing, the own one past the border."""
    glare_m: Float[Array, "*n"]
    glare_rad: Float[Array, "*n"]

    met_log_intensity: Float[Array, "*n"]
    """The simulator's own intensity of the surface met."""

    # What becomes of it
    log_intensity: Float[Array, "*n"]
    log_power: Float[Array, "*n"]
    """Logarithm of the received power; at REFERENCE_M it equals that of the reported intensity."""
    log_power_sd: Float[Array, "*n"]
    """Standard deviation of the logarithm of the received power, nats: 0 in a simulation, which knows its power."""
    log_keep: Float[Array, "*n"]
    """Logarithm of the probability that the surface's echo is reported; 0 is certain."""
    column_loss: Float[Array, "*n"]
    """Probability that the ray's whole column is lost."""
    reading_m: Float[Array, "*n"]
    """Expected range, before noise and rounding."""
    noise_m: Float[Array, "*n"]
    """Standard deviation of the range that effects add."""
    between: Float[Array, "*n"]
    """Probability that the reading lies between `reading_m` and `between_m`, evenly."""
    between_m: Float[Array, "*n"]
    ghost: Float[Array, "*n"]
    """Probability that the reading is `ghost_m` instead."""
    ghost_m: Float[Array, "*n"]
    clutter: Float[Array, "*n"]
    """Probability of an early false return; its range has density r**clutter_power exp(-r / clutter_scale_m)
    from `clutter_from_m` to the surface (or `CLUTTER_REACH_M`)."""
    clutter_power: Float[Array, "*n"]
    clutter_scale_m: Float[Array, "*n"]
    clutter_from_m: Float[Array, "*n"]
    clutter_log_intensity: Float[Array, "*n"]
    intensity_step: Float[Array, ""]
    """Reported intensity is rounded to multiples; 0 not at all."""
    intensity_top: Float[Array, ""]
    """Reported intensity ends here."""
    range_step_m: Float[Array, ""]

    basis: Float[Array, "*n k"] | None = None
    """Columns of which a free curve along some covariate is made; None where no such curve is fitted."""
    origin_slope: Float[Array, "*n 3"] | None = None
    """Change of the range with the sensor's place (x, y, z), m/m, while rays stay on their planes; None where rays that
    move are cast again."""
