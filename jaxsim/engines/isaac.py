"""Isaac Sim's RTX LiDAR: attributes of an OmniLidar prim, and of its emitters.

Sources: https://docs.omniverse.nvidia.com/kit/docs/omni.sensors.nv.lidar/latest/lidar_extension.html and
https://nvidia-omniverse.github.io/ovrtx/0.7.0/sensors/nonvisual/lidar_core/attributes.html
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from jaxsim.engines.engine import (
    OF_SURFACES,
    Engine,
    Estimate,
    Estimates,
    Setting,
    degrees,
    known,
    limits_of_range,
    mean_of,
    noise_of_range,
)

_CORE = "omni:sensor:Core:"
_EMITTER = f"{_CORE}emitterState:s001:"
_MATERIAL = (
    "reflection belongs to the materials of the scene (their sensor attributes), not to the LiDAR: change these, or "
    "apply it behind the sensor"
)
INSTEAD = {
    **dict.fromkeys(OF_SURFACES, _MATERIAL),
    "random_dropout": "returns are lost by their power alone; drop points at random behind the sensor",
    "random_loss": "returns are lost by their power alone; drop points at random behind the sensor",
    "material_dropout": "returns are lost by their power alone; drop by class behind the sensor",
    "beam_dropout": "returns are lost by their power alone; leave a dead beam's emitters out, drop the others by row "
    "behind the sensor",
    "snr_dropout": "minReflectance at minReflectionRangeM is its threshold, in its own power budget: set it so that a "
    "surface which half returns at a range does so there",
    "range_offset": "take it off each emitter's distanceCorrectionM, which the sensor takes off again",
    "motion_distortion": "switch motion on for the renderer (Motion BVH) and give emitters their fireTimeNs",
    "atmospheric_extinction": "it has no air; scale intensity by exp(-2 α range) behind the sensor",
    "intensity_noise": "intensity has no noise; add it behind the sensor",
}


def settings(answer: Estimates, _: Mapping[str, float]) -> list[Setting]:
    """Attributes of the prim; those of emitters are changes, one an emitter, top beam first."""
    divergence = answer.one("incidence_range_bias", "divergence_rad")
    wide = divergence and degrees(divergence)
    why_wide = "incidence_range_bias: the beam's divergence, for rayType GAUSSIAN_BEAM"
    bias = [b.mapped(lambda v: -v) for b in answer.each("beam_range_bias", "bias_m")]
    why_bias = "beam_range_bias: taken off again by the emitter's correction, hence its sign"
    upward = [degrees(e) for e in answer.each("beam_elevation_error", "error_rad")]
    aside = [degrees(e) for e in answer.each("beam_azimuth_error", "error_rad")]
    power = [g.mapped(math.exp) for g in answer.each("beam_gain", "gain")]
    return [
        *noise_of_range(answer, f"{_CORE}rangeAccuracyM"),
        *known((f"{_CORE}rangeResolutionM", answer.range_step, "m", "steps of the range")),
        *limits_of_range(answer, minimum=f"{_CORE}nearRangeM", maximum=f"{_CORE}farRangeM"),
        *known(*((f"{_CORE}divergence{side}Deg", wide, "degrees", why_wide) for side in ("Hor", "Ver"))),
        *_emitters("distanceCorrectionM", bias, unit="m", why=why_bias),
        *_emitters("elevationDeg", upward, unit="degrees", why="beam_elevation_error: add it"),
        *_emitters("azimuthDeg", aside, unit="degrees", why="beam_azimuth_error: add it"),
        *_emitters("emitterPeakPowerW", power, unit="times", why="beam_gain: multiply the emitter's power by it"),
    ]


def _emitters(name: str, values: Sequence[Estimate], *, unit: str, why: str) -> list[Setting]:
    return [Setting(_EMITTER + name, mean_of(values), unit, why, each=tuple(values))] if values else []


def text(chosen: Sequence[Setting]) -> str:
    """USD: an `over` of the prim; changes of emitters stand in comments, since they are added to what is there."""
    lines = ["#usda 1.0", "", 'over "Lidar"', "{"]
    for one in chosen:
        if one.each:
            values = ", ".join(f"{value.value:.6g}" for value in one.each)
            lines.append(f"    # {one.why} ({one.unit}), top beam first:")
            lines.append(f"    # float[] {one.name} ... [{values}]")
        else:
            lines.append(f"    float {one.name} = {one.value.value:.6g}")
    return "\n".join([*lines, "}", ""])


ENGINE = Engine(
    title="Isaac Sim",
    settings=settings,
    expresses=frozenset(
        {
            *("range_noise", "range_quantization", "range_step", "range_gate", "incidence_range_bias"),
            *("beam_range_bias", "beam_elevation_error", "beam_azimuth_error", "beam_gain"),
        }
    ),
    instead=INSTEAD,
    text=text,
    suffix=".usda",
    notes=(
        "Compare with frames that have rangeAccuracyM 0: its own noise would be part of the comparison.",
        "Intensity is comparable where omni:sensor:Core:intensityProcessing is the same on both sides.",
    ),
    links=(
        "https://docs.omniverse.nvidia.com/kit/docs/omni.sensors.nv.lidar/latest/lidar_extension.html",
        "https://nvidia-omniverse.github.io/ovrtx/0.7.0/sensors/nonvisual/lidar_core/attributes.html",
    ),
)
