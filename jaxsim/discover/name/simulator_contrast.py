"""Whether the sensor follows the simulator's contrast: what a learned simulator gets wrong, told apart from the sensor.

An answer is held against the simulator's contrast on several scales and in each class (`model.contrast`): where scenes
that were not fitted gain by slopes that differ between these, and agree on it, no law of the sensor explains them. Then
all is asked again with these slopes left to nuisances, so that an effect counts by what it does along ranges, angles
and rows, and between classes. Of a simulator with noise on its intensities they are left free from the start
(`model.simulator`).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from jaxsim.discover.find.covariates import CURVES, with_columns
from jaxsim.discover.find.division import NullModel
from jaxsim.discover.model.evidence import without_detail
from jaxsim.discover.model.fit import Problem
from jaxsim.discover.model.null_model import reweighted
from jaxsim.discover.model.random_effects import shared_levels
from jaxsim.discover.name.candidates import Candidate, rank_effects
from jaxsim.discover.name.select import Choice
from jaxsim.discover.rules import RULES
from jaxsim.discover.scenes import clipped
from jaxsim.discover.verdict import Contrast, Interval
from jaxsim.metrics.intervals import jackknife_half_width

SLOPES = CURVES["intensity"]
"""The law by which contrast is asked: heights are differences of slopes."""


def contrast_off(null_model: NullModel, choice: Choice) -> Candidate | None:
    """The contrast as a candidate beside what was chosen, where it is accepted; None where the sensor follows the
    simulator's contrast, or noise on intensities or a control has left that free."""
    division = null_model.division
    if division.simulator.intensities is not None or division.simulator.free_contrast:
        return None
    ev, _ = division.with_free_contrast().evidence(division.parts.find)
    # Rays that were chosen to go elsewhere may hit where these do not: there they say nothing of the contrast.
    columns = np.asarray(ev.features)[..., -len(ev.scales) :][np.asarray(choice.problem.ev.rays.hit)]
    # Heights are thought to be of the curve's own scale, slopes of 1.
    columns = columns / SLOPES.parameters["height"].scale
    # Usual errors within classes have a nuisance of their own, which would say the same.
    as_said = replace(choice.problem, ev=without_detail(choice.problem.ev))
    as_said = reweighted(as_said, as_said.ev.all_blocks)
    [candidate] = rank_effects(with_columns(as_said, columns), [SLOPES])
    return candidate if candidate.accepted(max(choice.bars.effect, RULES.contrast_nats)) else None


def contrast_of_answer(found: Candidate, problem: Problem) -> Contrast:
    """What an answer says of the contrast that was `found`, `problem` being that of the answer, contrast left free."""
    scene, scales = np.asarray(problem.ev.scene), problem.ev.scales

    def slopes(in_fit: Any) -> np.ndarray:
        return 1 + np.asarray(shared_levels(problem.ev, problem.equations, in_fit))[-len(scales) :]

    whole = slopes(problem.ev.all_blocks)
    without = np.stack([slopes((scene != left_out).astype(np.float32)) for left_out in np.unique(scene)])
    half = jackknife_half_width(without)
    of_scale = [Interval(float(v), float(v - h), float(v + h), "") for v, h in zip(whole, half, strict=True)]
    return Contrast(
        slopes=dict(zip(scales, of_scale, strict=True)),
        gain=Interval.of_scenes(clipped(found.by_scene), "nats per scene"),
        p_value=found.chance,
    )
