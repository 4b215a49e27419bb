"""A sensor that does not stand where, or when, the simulator has it; beside whatever effect a case hides."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from benchmarks.blind.hidden.frames import Grid, Moment, Rays
from benchmarks.blind.hidden.light import _turn
from benchmarks.blind.hidden.plan import Plan


@dataclass(frozen=True)
class Placed:
    """roll, pitch, yaw in degrees, x, y, z in m (forward, left, up); beams higher by `lifted_deg`; frames `late_s`."""

    turned_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    moved_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    lifted_deg: float = 0.0
    late_s: float = 0.0

    def plan(self) -> Plan:
        """Rays cast again from there: no range image is bent."""
        turn = _turn(*np.deg2rad(self.turned_deg))

        def rays(r: Rays, grid: Grid, moment: Moment) -> None:
            flat = np.hypot(r.direction[..., 0], r.direction[..., 1])[..., None]
            elevation = np.arctan2(r.direction[..., 2:], flat) + np.deg2rad(self.lifted_deg)
            lifted = np.concatenate([r.direction[..., :2] / flat * np.cos(elevation), np.sin(elevation)], axis=-1)
            r.direction = lifted @ turn.T
            r.offset = r.offset + np.array(self.moved_m)

        return Plan({}, rays=[rays])

    def moments(self, given: list[Moment]) -> list[Moment]:
        """When the sensor's frames were taken: of the same drives, a little later."""
        return [replace(one, since_scene_s=one.since_scene_s + self.late_s) for one in given]
