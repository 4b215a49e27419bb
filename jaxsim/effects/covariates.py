"""What a reading may depend on: covariates of rays, by the names that verdict.json and sensor.json use.

One table serves both kinds of arrays: NumPy's, where `discover` looks at residuals on the host, and JAX's, where a
learned law acts on rays.
"""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType
from typing import Any

import jax.numpy as jnp

TURN = 6.283185307179586
"""All round, rad."""


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
