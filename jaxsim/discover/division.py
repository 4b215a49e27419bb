"""A comparison on the device, and which of its columns find and which judge."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Int

from jaxsim.discover.model.cast import Blocks, Cast, blocks, cast
from jaxsim.discover.model.evidence import Evidence, Measured, gather
from jaxsim.discover.model.simulator import Meant, meant
from jaxsim.discover.model.surfaces import with_planes
from jaxsim.discover.read import Comparison
from jaxsim.discover.scenes import Split, split
from jaxsim.effects.chain import SensorModel
from jaxsim.effects.rays import Scan

NOTHING_YET = SensorModel()
"""A sensor model without effects."""


@dataclass(frozen=True)
class Division:
    """Columns of a comparison's frames in blocks, and the scenes that they are divided by."""

    scan: Scan
    """With incidence angles taken from planes of the range image."""
    given: Scan
    """As the simulator means it, with the incidence that was given."""
    simulator: Meant
    """What the simulator means, and its own noise."""
    measured: Measured
    blocks: Blocks
    rays: Cast
    """Of all blocks, traced once."""
    parts: Split

    @classmethod
    def of(cls, comparison: Comparison) -> Division:
        """Raises ValueError where the scenes are too few, or the sectors of a single drive too narrow."""
        measured = jax.tree.map(jnp.asarray, comparison.measured)
        simulator = meant(
            jax.tree.map(jnp.asarray, comparison.scan),
            range_m=measured.range_m,
            intensity=measured.intensity,
            valid=measured.valid,
        )
        given = simulator.scan
        chosen = blocks(comparison.scenes, *comparison.scan.range_m.shape[1:])
        planes = simulator.planes_rad
        scan = with_planes(given) if planes is None else replace(given, incidence_rad=planes)
        rays = cast(scan, chosen.frame, chosen.column)
        return cls(scan, given, simulator, measured, chosen, rays, split(chosen.unit))

    def evidence(
        self, names: Sequence[str], known: SensorModel = NOTHING_YET
    ) -> tuple[Evidence, Int[np.ndarray, " b"]]:
        """The evidence of the named scenes with the `known` effects in place, and the index of each block's scene
        among `names`."""
        keep = np.array([scene in names for scene in self.blocks.unit])
        order = {name: k for k, name in enumerate(names)}
        scene = np.array([order[name] for name in self.blocks.unit if name in order])
        frame = self.blocks.frame[keep]
        column = self.blocks.column[keep]
        ev = gather(
            self.scan,
            self.measured,
            frame=frame,
            column=column,
            unit=scene,
            given_rad=self.given.incidence_rad,
            rays=self.rays.part(keep),
            simulator=self.simulator,
        )
        return (replace(ev, rays=known.apply(ev.rays, self.scan)) if known.effects else ev), scene

    def all_evidence(self, known: SensorModel = NOTHING_YET) -> tuple[Evidence, Int[np.ndarray, " b"]]:
        """That of find and judge scenes, in this order."""
        return self.evidence((*self.parts.find, *self.parts.judge), known)
