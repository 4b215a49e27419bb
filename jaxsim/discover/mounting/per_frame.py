"""Frames that each stand a little elsewhere: a car rides up and down on its springs, or a drive was located by
satellites alone, and the simulator does not know.

The model gives each frame a pose of its own (`random_effects`), to first order and of a few centimetres. Where frames
scatter by clearly more than that, floors and ceilings that rays graze are off by decimetres, and effects of the range
would explain them. So each simulated frame is brought to where its own registration has it. What all share stays where
it is surely more than the mean of such scatter: it is the mounting's.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from jaxsim.discover.model.evidence import POSE_SD
from jaxsim.discover.mounting.constant import OF_POSE, brought, of_frames
from jaxsim.discover.read import Comparison
from jaxsim.discover.read.registration import MOTION_PARTS, POSE, Registration
from jaxsim.discover.rules import RULES

ABSOLUTE = 1.2533
"""Standard deviation of a normal over its mean distance from the middle."""


def scatter_of(registered: Registration) -> Float[np.ndarray, " 6"]:
    """The standard deviations of frames' poses about their median, m and rad."""
    poses = registered.frames[:, POSE]
    apart = np.sort(np.abs(poses - np.median(poses, axis=0)), axis=0)
    # Not the median of distances: frames of which most ride low have next to none. The farthest one decides nothing.
    return ABSOLUTE * apart[:-1].mean(axis=0) if len(apart) > 1 else np.zeros(len(POSE_SD))


def is_unsteady(comparison: Comparison) -> bool:
    """Whether frames' own poses scatter by clearly more than the model lets them."""
    registered = comparison.registration
    if registered is None or registered.early_or_late:
        return False
    return bool((scatter_of(registered) > RULES.unsteady_sd * POSE_SD).any())


def steadied(comparison: Comparison) -> Comparison:
    """The comparison with each simulated frame as seen from where its own registration has it, less what the mounting
    of all frames surely is off by, and with a note that says so."""
    registered = comparison.registration
    assert registered is not None, "frames are unsteady by their registration"
    own = np.zeros_like(registered.frames)
    own[:, POSE] = registered.frames[:, POSE]
    for name in OF_POSE:
        if name in registered.sure:
            own[:, MOTION_PARTS[name]] -= registered.motion[MOTION_PARTS[name]]
    # A frame that agrees no better there was registered to something else.
    own[registered.near <= registered.near_as_given] = 0
    effects = of_frames(own, rows=comparison.scan.range_m.shape[1])
    placed = brought(comparison, {name: effects[name] for name in OF_POSE})
    return replace(placed, own_places=True, notes=(*comparison.notes, unsteady_in_words(registered)))


def unsteady_in_words(registered: Registration) -> str:
    """Gives a note on frames that each stand elsewhere."""
    sd = scatter_of(registered)
    moved = ", ".join(f"{100 * v:.1f}" for v in sd[:3])
    turned = ", ".join(f"{v:.2f}" for v in np.rad2deg(sd[3:]))
    return (
        "the measured frames stand each a little elsewhere than the simulated ones: standard deviations of "
        f"{moved} cm along x, y, z and {turned} deg about them. Each simulated frame was brought to where its partner "
        "stood: a car rides on its springs, or poses come from a poor localisation. A mounting that is off by no more "
        "than the mean of such scatter cannot be told on these frames"
    )
