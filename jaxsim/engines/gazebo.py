"""Gazebo's lidar and gpu_lidar: the <range> and <noise> of SDF.

Noise is Gaussian, one mean and one deviation for every ray; a laser's intensity is the visual's laser_retro. Sources:
http://sdformat.org/spec?elem=sensor (lidar) and https://gazebosim.org/api/sensors/9/Lidar_8hh_source.html
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from jaxsim.engines.engine import (
    LOSSES,
    OF_INTENSITY,
    Engine,
    Estimates,
    Setting,
    known,
    limits_of_range,
    mean_bias,
    noise_of_range,
)

_RETRO = (
    "intensity is the number laser_retro of the visual that a ray hits, whatever range and angle: set it by surface, "
    "and apply what depends on range or angle in a node that reads the points"
)
_DROP = "no ray is lost but by range; drop points in a node that reads them"
INSTEAD = {
    **dict.fromkeys(OF_INTENSITY, _RETRO),
    **dict.fromkeys(LOSSES, _DROP),
    "beam_azimuth_error": "all rows have the same horizontal samples; several sensors of few samples come nearer",
    "beam_elevation_error": "vertical samples lie evenly between min_angle and max_angle; several sensors of few "
    "samples come nearer",
    "motion_distortion": "a scan is rendered at one moment; several sensors of a sector each, at different times, come "
    "nearer",
}


def settings(answer: Estimates, _: Mapping[str, float]) -> list[Setting]:
    """Elements of <lidar>."""
    return [
        *mean_bias(answer, "noise.mean"),
        *noise_of_range(answer, "noise.stddev"),
        *limits_of_range(answer, minimum="range.min", maximum="range.max"),
        *known(("range.resolution", answer.range_step, "m", "steps of the range")),
    ]


def text(chosen: Sequence[Setting]) -> str:
    """The elements as SDF."""
    values = {one.name: f"{one.value.value:.6g}" for one in chosen}
    inner: list[str] = []
    for group in ("range", "noise"):
        members = [name.partition(".")[2] for name in values if name.startswith(f"{group}.")]
        if not members:
            continue
        inner.append(f"  <{group}>")
        if group == "noise":
            inner.append("    <type>gaussian</type>")
        inner += [f"    <{name}>{values[f'{group}.{name}']}</{name}>" for name in members]
        inner.append(f"  </{group}>")
    return "\n".join(["<lidar>", *inner, "</lidar>", ""])


ENGINE = Engine(
    title="Gazebo",
    settings=settings,
    expresses=frozenset(
        ("range_offset", "beam_range_bias", "range_noise", "range_gate", "range_quantization", "range_step")
    ),
    instead=INSTEAD,
    text=text,
    suffix=".sdf",
    notes=("Compare with frames that have no <noise>: Gazebo's own would be part of the comparison.",),
    links=("http://sdformat.org/spec?elem=sensor", "https://gazebosim.org/api/sensors/9/Lidar_8hh_source.html"),
)
