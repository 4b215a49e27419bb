"""The question put to a comparison: what still repeats once everything that was named is in place."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Int

from jaxsim.discover.add import in_place
from jaxsim.discover.model.cast import blocks, cast
from jaxsim.discover.model.evidence import Evidence
from jaxsim.discover.model.fit import Chain, Problem
from jaxsim.discover.model.noise import Noise
from jaxsim.discover.model.null import first_residuals
from jaxsim.discover.model.random_effects import conditional_residuals, normal_equations
from jaxsim.discover.name.select import refitted
from jaxsim.discover.read import Division
from jaxsim.discover.repeats.find import FoundPattern, find_repeats
from jaxsim.discover.repeats.learn import LearnedRepeat, as_law, form_of, learn_repeats
from jaxsim.discover.repeats.maps import Maps, maps_of
from jaxsim.discover.rules import RULES
from jaxsim.effects.chain import SensorModel
from jaxsim.effects.learned import Learned


@dataclass(frozen=True)
class Dense:
    """More columns of a comparison's frames than fits are given, of find and judge scenes."""

    division: Division
    null: Problem
    """The null as it was fitted to the find scenes."""
    ev: Evidence
    scene: Int[np.ndarray, " b"]
    finding: Bool[np.ndarray, " n"]
    """Whether each scene is one to find with."""

    @classmethod
    def of(cls, division: Division, scenes: Sequence[str], null: Problem, *, known: SensorModel) -> Dense:
        """The columns with the `known` effects in place; `scenes` are those of the frames."""
        rows, columns = division.scan.range_m.shape[1:]
        chosen = blocks(scenes, rows, columns, rays=RULES.repeats_rays)
        dense = replace(division, blocks=chosen, rays=cast(division.scan, chosen.frame, chosen.column))
        ev, scene = dense.all_evidence(known)
        finding = np.arange(len(dense.parts.find) + len(dense.parts.judge)) < len(dense.parts.find)
        return cls(division, null, ev, scene, finding)

    def maps(self, effects: Chain, noise: Noise) -> dict[str, Maps]:
        """What is left with `effects` in place, which leave `noise`."""
        fitted = self.finding[self.scene].astype(np.float32)
        bare = Problem(self.division.scan, self.ev, self.null.equations, noise, self.null.clutter)
        problem = in_place(bare, effects, simulated=True)
        first = normal_equations(problem.ev, noise, first_residuals(problem.ev))
        # Student-t weights follow from residuals, which the effects in place have made smaller.
        off = conditional_residuals(problem.ev, first, fitted)
        problem = replace(problem, equations=normal_equations(problem.ev, noise, off))
        return maps_of(problem, fitted, self.scene, columns=self.division.scan.range_m.shape[2])

    def learn(self, found: Sequence[FoundPattern], effects: Chain, noise: Noise) -> tuple[LearnedRepeat, ...]:
        """The laws of what was found on top of `effects`, which leave `noise`."""

        def maps_with(laws: Sequence[Learned]) -> Mapping[str, Maps]:
            chain = [*effects, *((as_law(law), {}) for law in laws)]
            return self.maps(chain, refitted(in_place(self.null, chain)).noise if laws else noise)

        rows, columns = self.division.scan.range_m.shape[1:]
        return learn_repeats([form_of(one, rows, columns) for one in found], self.finding, maps_with)


def examine(
    division: Division,
    scenes: Sequence[str],
    null: Problem,
    *,
    chain: Chain,
    noise: Noise,
    known: SensorModel,
) -> tuple[LearnedRepeat, ...]:
    """What repeats in `division` with the effects of `chain`, which leave `noise`, and the `known` ones in place, each
    pattern with the law that it makes. `scenes` are those of the frames."""
    dense = Dense.of(division, scenes, null, known=known)
    found = find_repeats(dense.maps(chain, noise), dense.finding, bins=RULES.repeats_bins)
    return dense.learn(found, chain, noise) if found else ()
