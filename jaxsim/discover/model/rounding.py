"""Rounded readings of a comparison: the steps on which they lie, and what their likelihood gains by it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from jaxsim.discover.model.evidence import Evidence
from jaxsim.discover.model.lattice import FINEST, lattice_step, log_rounding
from jaxsim.discover.model.likelihood import CHANNELS
from jaxsim.discover.rules import RULES
from jaxsim.effects import get_effect


def rounded(ev: Evidence) -> dict[str, float]:
    """Steps of the lattices on which the sensor's readings lie and the simulator's do not, by effect."""
    returned = np.asarray(ev.returned)
    simulated = dict(zip(FINEST, np.asarray(ev.own_step), strict=True))
    steps = {}
    for name, measured in _readings(ev).items():
        step = lattice_step(measured[returned], finest=FINEST[name])
        if step > RULES.coarser_step * simulated[name]:
            steps[name] = step
    return steps


def rounding_gain(ev: Evidence, steps: Mapping[str, float]) -> Float[np.ndarray, "b 3"]:
    """Nats that each block's readings gain, by channel, where they are known to lie on the lattices of `steps` (by
    effect; steps that count as no rounding gain nothing)."""
    gain = np.zeros((len(ev.scene), len(CHANNELS)))
    returned = np.asarray(ev.returned)
    for name, values in _readings(ev).items():
        if steps.get(name, 0.0) > FINEST[name]:
            # A step at or below the finest is how files hold readings, no effect.
            nats = log_rounding(values, steps[name], finest=FINEST[name])
            channel = CHANNELS.index(get_effect(name).channels[0])
            gain[:, channel] = np.where(returned, nats, 0).sum((1, 2))
    return gain


def _readings(ev: Evidence) -> dict[str, Float[np.ndarray, "b c r"]]:
    """What the sensor read, by the effect that rounds it."""
    return {"intensity_quantization": ev.intensity, "range_quantization": np.asarray(ev.range_m)}
