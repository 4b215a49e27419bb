"""A comparison divided into find and judge scenes, on the device; and the null model of its find scenes, which all that
is found stands on.

Fits look at blocks of columns. What scenes share (noise, gain, reflectances of classes) is fitted to the find scenes
alone, also where judge scenes are held against what was found (`AllScenes`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from jaxsim.discover.find.other_surfaces import (
    apart_in_words,
    same_surfaces,
    seen_by_both,
    shares_of_classes,
    surfaces_apart,
)
from jaxsim.discover.model.cast import (
    CLOSER_RAYS,
    RAYS,
    UNKNOWN_BETWEEN,
    Blocks,
    Cast,
    blocks,
    cast,
    seeing,
    with_planes,
)
from jaxsim.discover.model.evidence import Evidence, Measured, gather
from jaxsim.discover.model.fit import Chain, Problem, in_place
from jaxsim.discover.model.noise import Noise
from jaxsim.discover.model.noise_levels import on_lattices
from jaxsim.discover.model.null_model import fit_null, reweighted
from jaxsim.discover.model.simulator import Meant, meant
from jaxsim.discover.read import Comparison
from jaxsim.discover.read.control import NO_CONTROL, Control
from jaxsim.discover.rules import RULES
from jaxsim.discover.scenes import Split, split_scenes
from jaxsim.effects import get_effect
from jaxsim.effects.chain import SensorModel
from jaxsim.effects.rays import Scan

NOTHING_YET = SensorModel()
"""A sensor model without effects."""


@dataclass(frozen=True)
class Division:
    """Columns of a comparison's frames in blocks, and the scenes that they are divided by."""

    scan: Scan
    """The simulated frames, with incidence angles taken from planes of the range image."""
    given: Scan
    """The frames as the simulator means them, with the incidence that was given."""
    simulator: Meant
    """What the simulator means, and its own noise."""
    measured: Measured
    blocks: Blocks
    rays: Cast
    """Rays of all blocks, traced once."""
    parts: Split
    between_unknown: bool = False
    """Whether what lies between two surfaces is unknown (`Comparison`)."""
    names: tuple[str, ...] = ()
    """Names of the frames."""
    scenes: tuple[str, ...] = ()
    """Scenes of the frames; a block's are `blocks.scene`, which are sectors where all frames are of few drives."""
    control: Control = NO_CONTROL
    """What the simulator lacks by itself, before all that is known of the sensor."""
    left_out: str = ""
    """What is left out, for one side alone has the surface that is there, in words."""
    apart: tuple[int, ...] = ()
    """The classes of which so much is left out that what else their surfaces show is hardly the sensor's."""

    @classmethod
    def of(
        cls,
        comparison: Comparison,
        *,
        chosen: Blocks | None = None,
        parts: Split | None = None,
        like: Division | None = None,
    ) -> Division:
        """A comparison divided, or with blocks that were `chosen` and `parts` that are known. Of further frames of two
        sides holds what frames before have told, whose division they are `like`: its parts, the noise of both sides,
        whether contrast is free, and whether surfaces that one side alone has are left out.

        Raises ValueError where the scenes are too few, or the sectors of few drives too narrow."""
        measured = jax.tree.map(jnp.asarray, comparison.measured)
        simulator = _simulator(comparison, measured, like)
        sides = _Sides.of(comparison, simulator, measured, like=like)
        simulator = replace(simulator, scan=sides.scan)
        given, ranges = simulator.scan, simulator.ranges
        parts = like.parts if like else parts
        if chosen is None:
            chosen, parts = _blocks_and_parts(comparison.scenes, parts, scan=given, measured=sides.measured)
        scan = with_planes(given) if ranges is None else replace(given, incidence_rad=ranges.planes_rad)
        return cls(
            scan,
            given,
            simulator,
            sides.measured,
            chosen,
            cast(scan, chosen.frame, chosen.column),
            parts or split_scenes(chosen.scene),
            between_unknown=comparison.between_unknown,
            names=comparison.names,
            scenes=comparison.scenes,
            control=comparison.control,
            left_out=sides.left_out,
            apart=sides.apart,
        )

    def looking_at(self, chosen: Blocks) -> Division:
        """The same frames and scenes, of which other columns are looked at."""
        return replace(self, blocks=chosen, rays=cast(self.scan, chosen.frame, chosen.column))

    def closer(self) -> Division:
        """The same frames and scenes, of which about `CLOSER_RAYS` rays are looked at; itself where there are no
        more."""
        chosen, _ = _blocks_and_parts(
            self.scenes, self.parts, scan=self.given, measured=self.measured, rays=CLOSER_RAYS
        )
        return self.looking_at(chosen) if chosen.column.size > self.blocks.column.size else self

    def divided_by(self, scenes: Sequence[str]) -> Division:
        """The same frames, divided by other `scenes` of them. Raises ValueError where these are too few."""
        chosen, parts = _blocks_and_parts(scenes, None, scan=self.given, measured=self.measured)
        return replace(self.looking_at(chosen), parts=parts)

    def with_free_contrast(self) -> Division:
        """The same, with how far the sensor follows the simulator's contrast left to a nuisance."""
        return replace(self, simulator=replace(self.simulator, free_contrast=True))

    def blocks_of(self, names: Sequence[str]) -> tuple[Bool[np.ndarray, " b"], Int[np.ndarray, " k"]]:
        """Which blocks are of the named scenes, and of these the index of each one's scene among `names`."""
        order = {name: k for k, name in enumerate(names)}
        keep = np.array([name in order for name in self.blocks.scene])
        return keep, np.array([order[name] for name in self.blocks.scene if name in order])

    def evidence(
        self, names: Sequence[str], known: SensorModel = NOTHING_YET
    ) -> tuple[Evidence, Int[np.ndarray, " b"]]:
        """The evidence of the named scenes with the `known` effects in place, and the index of each block's scene
        among `names`."""
        keep, scene = self.blocks_of(names)
        ev = gather(
            self.scan,
            self.measured,
            frame=self.blocks.frame[keep],
            column=self.blocks.column[keep],
            scene=scene,
            given_rad=self.given.incidence_rad,
            rays=self.rays.part(keep),
            simulator=self.simulator,
            apart=self.apart,
        )
        if self.between_unknown:
            between = get_effect("mixed_pixels")
            ev = replace(ev, rays=between.apply({"probability": np.float32(UNKNOWN_BETWEEN)}, ev.rays))
        for model in (self.control.of_rays, known):
            if model.effects or model.learned:
                ev = replace(ev, rays=model.apply(ev.rays, self.scan))
        return ev, scene


def _simulator(comparison: Comparison, measured: Measured, like: Division | None) -> Meant:
    """What the simulator means; its noise and whether contrast is free as in the division that it is `like`."""
    simulator = meant(
        jax.tree.map(jnp.asarray, comparison.scan),
        range_m=measured.range_m,
        intensity=measured.intensity,
        valid=measured.valid,
        noises=(like.simulator.noise, like.simulator.measured_noise) if like else None,
    )
    if comparison.lattices is not None:
        simulator = replace(simulator, noise=on_lattices(simulator.noise, comparison.lattices))
    free_contrast = like.simulator.free_contrast if like else comparison.control.contrast_off
    # Noise on intensities has left it free already.
    return replace(simulator, free_contrast=True) if free_contrast and simulator.intensities is None else simulator


@dataclass(frozen=True)
class _Sides:
    """Both sides without the rays that met what one of them alone has."""

    scan: Scan
    measured: Measured
    left_out: str = ""
    """What was left out, in words, and of which classes (`Division`)."""
    apart: tuple[int, ...] = ()

    @classmethod
    def of(
        cls, comparison: Comparison, simulator: Meant, measured: Measured, *, like: Division | None = None
    ) -> _Sides:
        # After `_simulator`: a ray that counts on neither side would look like one that the simulator lost.
        both = simulator.scan, measured
        if simulator.noise.loss > RULES.usual_random_loss:
            # Within surfaces its losses are put back; beside them a return may be of what it lost there.
            both = seen_by_both(*both, same=simulator.scan.hit)
        if comparison.told is not None:
            both = seen_by_both(*both, same=comparison.told)
        if comparison.other_moments:
            return cls(*jax.tree.map(jnp.asarray, same_surfaces(*both)))
        apart = surfaces_apart(*both)
        # By few frames the share is not known: those before say whether such surfaces are many.
        many = bool(like.left_out) if like else apart.mean() > RULES.one_side_share
        if not many:
            return cls(*jax.tree.map(jnp.asarray, both))
        shares = shares_of_classes(apart, both[0])
        return cls(
            *jax.tree.map(jnp.asarray, seen_by_both(*both, same=~apart)),
            left_out=apart_in_words(apart, both[0]),
            apart=tuple(one for one, share in shares.items() if share >= RULES.apart_class_share),
        )


def _blocks_and_parts(
    scenes: Sequence[str], parts: Split | None, *, scan: Scan, measured: Measured, rays: int = RAYS
) -> tuple[Blocks, Split]:
    """Columns of about so many rays spread over all frames, and the parts that divide their `scenes`, where these are
    not known. A column in which nearly all that the find scenes' frames could see is lost is among those of each
    block."""
    chosen = blocks(scenes, *scan.range_m.shape[1:], rays=rays)
    parts = parts or split_scenes(chosen.scene)
    frames = np.unique(chosen.frame[[name in parts.find for name in chosen.scene]])
    hit = np.asarray(scan.hit)[frames]
    lost = hit & ~np.asarray(measured.valid)[frames]
    return seeing(chosen, lost.sum((0, 1)) > RULES.hidden_share * np.maximum(hit.sum((0, 1)), 1)), parts


@dataclass(frozen=True)
class NullModel:
    """The null model of a comparison, fitted to its find scenes with what is `known` of the sensor in place."""

    division: Division
    known: SensorModel
    problem: Problem

    @classmethod
    def of(cls, division: Division, known: SensorModel = NOTHING_YET) -> NullModel:
        """Fits it. Raises ValueError for a learned law of what the frames do not hold."""
        control = division.control.of_rays
        for law in (*control.learned, *known.learned):
            law.check(division.scan)
        ev, _ = division.evidence(division.parts.find, known)
        # The null needs the component of false returns as soon as a known effect makes some.
        clutter = any(get_effect(name).clutter for name, _ in (*control.effects, *known.effects))
        return cls(division, known, fit_null(division.scan, ev, clutter=clutter))


@dataclass(frozen=True)
class AllScenes:
    """Find and judge scenes, in this order, with what is known in place: what is found is held against them."""

    null_model: NullModel
    division: Division
    """The null model's, or other columns of its frames."""
    ev: Evidence
    scene: Int[np.ndarray, " b"]
    in_fit: Float[np.ndarray, " b"]
    """1 for the find scenes, from which follows what scenes share."""

    @classmethod
    def of(cls, null_model: NullModel, division: Division | None = None) -> AllScenes:
        """All scenes of a null model, by the columns of another `division` of its frames where one is given."""
        division = division or null_model.division
        find, judge = division.parts.find, division.parts.judge
        ev, scene = division.evidence((*find, *judge), null_model.known)
        return cls(null_model, division, ev, scene, (scene < len(find)).astype(np.float32))

    def problem_with(self, effects: Chain = (), noise: Noise | None = None) -> Problem:
        """The null model's problem here, with effects in place and the `noise` that they leave (by default the
        null's)."""
        null = self.null_model.problem
        noise = null.noise if noise is None else noise
        bare = Problem(self.division.scan, self.ev, null.equations, noise, null.clutter)
        return reweighted(in_place(bare, effects, simulated=True), self.in_fit)
