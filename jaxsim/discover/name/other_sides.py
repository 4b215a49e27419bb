"""Other sides, into which what is about to be said is put as it was fitted: where it gains there too, it is not said.

The control's: what the simulator lacks on its control's frames as well it lacks by itself, and be it too weak to have
been named there. What is in place of the control is known no better than its scenes agree on it. So what is new must
also tell the scenes on which it is from those of the control, by what each says of its direction: if nothing is, these
are exchangeable (a permutation test of two samples).

The sides exchanged: what both say of each other alike is noise, and nothing that one of them lacks. Where the simulator
has noise of its own, both sides are noisy readings of the same surfaces. What noise does to a comparison (dark readings
regress to the mean, a ray at an edge meets now this surface, now that) it does whichever side is taken for the
simulation. What the sensor does and the simulator does not would have to be undone, not done once more, where the
sensor's frames are taken for simulated ones.

Frames of other moments are cast to where their partners stood, and what a ray meets 3 m further on is in no image:
rough surfaces, and what beams differ by, come out as noise on what is simulated, though the simulator has none. So
these are exchanged too, in all channels, the measured frames cast to where the simulated ones stood.

What lets beams through, crowns and fences, a beam meets by chance: two readings of it differ at depth steps in ranges
and returns, be the simulator without any noise, and before the sky as often one as the other meets nothing. So effects
of depth steps, and losses, be they an effect or a free curve, are always asked.

Of intensities of one moment this is a fair question only where both sides know how bright each surface is. A simulator
that has a table of reflectances lacks what surfaces have of their own, and that alone makes its readings regress once
it is taken for the sensor (Berkson's errors become classical ones; Carroll, Ruppert, Stefanski, Crainiceanu 2006).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxsim.discover.find.covariates import CURVES, Dependence, heights_at, with_columns
from jaxsim.discover.find.division import Division, NullModel
from jaxsim.discover.find.other_surfaces import met_by_chance
from jaxsim.discover.model.evidence import Measured
from jaxsim.discover.model.fit import Fit, Problem, channels_of, fit, fit_noise, partway
from jaxsim.discover.model.noise_levels import FINEST
from jaxsim.discover.model.null_model import implied_level
from jaxsim.discover.model.parameters import host_values
from jaxsim.discover.name.candidates import Candidate
from jaxsim.discover.name.select import FittedStep
from jaxsim.discover.read import Comparison
from jaxsim.discover.read.control import NO_CONTROL
from jaxsim.discover.rules import RULES
from jaxsim.discover.scenes import clipped, dealt
from jaxsim.effects import Law
from jaxsim.effects.effect import CHANNELS
from jaxsim.effects.rays import Scan

EXCHANGED = "with the sides exchanged it is found as well"
CONTROL = "the control's frames do not clearly differ in it"
BY_CHANCE = frozenset(("range", "drop"))
"""Channels in which two readings of what lets beams through differ at depth steps."""


@dataclass(frozen=True)
class OtherSides:
    """The null of the find scenes of other sides."""

    null_model: NullModel
    fit: Fit
    channels: frozenset[str]
    """Channels of which these sides can be asked."""
    why: str
    """EXCHANGED or CONTROL: why what is found here as well is not said."""
    share: float = RULES.elsewhere_share
    """Share of its gain from which on what was found is found here as well."""

    @classmethod
    def of_control(cls, comparison: Comparison) -> OtherSides:
        """The control's frames, with what was named of them in place."""
        null_model = NullModel.of(Division.of(comparison))
        return cls(null_model, fit_noise(null_model.problem), frozenset(CHANNELS), CONTROL)

    @classmethod
    def exchanged(
        cls, comparison: Comparison, null_model: NullModel, *, back: Callable[[Comparison], Comparison] | None = None
    ) -> OtherSides:
        """The comparison with what was measured in the place of what was simulated; `null` is that of the sides as they
        are. What else the sides differ by, known or found, is in neither place: it is left to the nuisances. `back`
        brings frames of other moments to their partners (`mounting.brought_back`)."""
        division = null_model.division
        sides = exchange(comparison, division)
        turned = Division.of(back(sides) if back else sides, chosen=division.blocks, parts=division.parts)
        other = NullModel.of(turned)
        channels = frozenset(CHANNELS) if back else alike(division, null_model.problem)
        # Casting blurs both sides alike: what is new loses there, and be it little.
        return cls(other, fit_noise(other.problem), channels, EXCHANGED, share=0.0 if back else RULES.elsewhere_share)

    def shows(
        self,
        law: Law,
        values: dict[str, np.ndarray],
        of: Candidate,
        *,
        there: Problem,
        here: Problem,
        channels: frozenset[str],
    ) -> bool:
        """Whether a law with the values that a candidate was fitted to `there` is found here as well, in these
        channels; both problems are those of nulls, whose rays may carry a basis."""
        # The values stay as they are: only the noise is fitted to these sides.
        placed = fit(law, here, starts=(values,), fixed=True)
        used = [CHANNELS.index(name) for name in channels_of(law) if name in channels]

        def by_scene(score: Float[np.ndarray, "b 3"]) -> Float[np.ndarray, " s"]:
            return here.ev.by_scene((score - self.fit.score)[:, used].sum(-1))

        # None of the scenes decides alone; of more rays each says more.
        gained = float(clipped(by_scene(placed.score)).mean()) / rays_by_scene(here).mean()
        if gained >= self.share * of.total / len(of.gain) / rays_by_scene(there).mean():
            return True
        # Of a rare event most scenes of either side say nothing, and a lattice has no direction.
        if self.why != CONTROL or of.sudden or law.name in FINEST:
            return False
        begun = replace(here, noise=self.fit.noise)
        slope = by_scene(partway(law, begun, fit=placed, share=RULES.direction_share))
        return not clearly_more(of.slope / rays_by_scene(there), slope / rays_by_scene(here))

    def has(self, step: FittedStep, there: Problem) -> bool:
        """Whether an effect that was chosen of a problem is found here as well."""
        effect = step.chosen.effect
        channels = self.channels | BY_CHANCE if looks_like_chance(effect) else self.channels
        if channels.isdisjoint(effect.channels):
            return False
        values = host_values(effect, step.fit.z)
        return self.shows(effect, values, step.chosen, there=there, here=self.null_model.problem, channels=channels)

    def has_curve(self, there: Problem, along: Dependence, curve: Candidate) -> bool:
        """Whether a free curve that was fitted to the problem `there` is found here as well."""
        channels = self.channels | {"drop"}
        if along.channel not in channels:
            return False
        fits = [np.asarray(values["height"]) for values in curve.fitted_values]
        here = self.null_model.problem
        # One column that is the curve itself: knots of its own would lie elsewhere on these rays.
        column = heights_at(here, there, along=along, numbers=np.mean(fits, axis=0))
        problem = with_columns(here, column[:, None].astype(np.float32))
        effect = CURVES[along.change]
        unit = np.zeros_like(fits[0])
        unit[0] = 1.0
        return self.shows(effect, {"height": unit}, curve, there=there, here=problem, channels=channels)


def goes_by_steps(effect: Law) -> bool:
    """Whether an effect acts at depth steps, and nowhere else."""
    return effect.covariates == ("step",)


def looks_like_chance(effect: Law) -> bool:
    """Whether two readings of what lets beams through may look like an effect: it acts at depth steps, or only loses
    rays."""
    return goes_by_steps(effect) or effect.channels == ("drop",)


def clearly_more(there: Float[np.ndarray, " s"], here: Float[np.ndarray, " t"]) -> bool:
    """Whether scenes `there` say more than those `here`, beyond what chance makes of such scenes dealt out anew."""
    group = np.arange(len(there) + len(here)) < len(there)
    _, chance = dealt(np.concatenate([there, here]), group[None])
    return chance <= RULES.control_level


def rays_by_scene(problem: Problem) -> Float[np.ndarray, " s"]:
    """Rays that each scene of a problem holds: what its scenes say grows with them."""
    return problem.ev.by_scene(np.asarray(problem.ev.rays.hit).sum((1, 2)).astype(float))


def alike(division: Division, null: Problem) -> frozenset[str]:
    """The channels in which both sides are noisy readings of the same: ranges and returns where ranges are noisy, and
    intensities where these are and surfaces are as bright on both sides."""
    channels = {"range", "drop"} if division.simulator.ranges is not None else set()
    if division.simulator.intensities is not None:
        brightness = implied_level(null.ev, null.equations)[np.asarray(null.ev.compared)]
        if len(brightness) and brightness.std() <= RULES.same_brightness_nats:
            channels.add("intensity")
    return frozenset(channels)


def exchange(comparison: Comparison, division: Division) -> Comparison:
    """The comparison with the sides exchanged. Classes and angles stay the simulator's, those of rays that it does not
    return from are a neighbour's on the same surface: a sensor tells none."""
    raw = comparison.scan
    reported = np.asarray(raw.hit)
    simulated = Measured(np.where(reported, raw.range_m, 0), np.where(reported, raw.intensity, 0), reported)
    known = met_by_chance(division.simulator.scan, comparison.measured)
    scan = _with_measured(known, comparison.measured)
    # What the simulator lacks by itself the sensor does not.
    return replace(comparison, scan=scan, measured=simulated, lattices=None, control=NO_CONTROL)


def _with_measured(meant: Scan, measured: Measured) -> Scan:
    """What the simulator means, with the measured readings in place of its own."""
    # Rays that the simulator lost by chance are put back in what it means.
    valid = jnp.asarray(measured.valid)
    return replace(
        meant,
        range_m=jnp.where(valid, measured.range_m, 0),
        intensity=jnp.where(valid, measured.intensity, 0),
        hit=jnp.asarray(meant.hit) & valid,
    )
