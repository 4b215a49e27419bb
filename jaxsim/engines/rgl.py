"""Robotec GPU LiDAR (RGL): noise nodes of its graph.

`rgl_node_gaussian_noise_distance(node, mean, st_dev_base, st_dev_rise_per_meter)` moves points along their rays, after
the ray tracing. Sources: https://github.com/RobotecAI/RobotecGPULidar/blob/develop/docs/GaussianNoise.md and the
library's api/core.h.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from jaxsim.effects.catalogue.range_falloff import REFERENCE_M
from jaxsim.engines.engine import LOSSES, OF_INTENSITY, Engine, Estimates, Setting, known, mean_bias

_TEXTURE = (
    "intensity is the value of the mesh's texture (rgl_entity_set_intensity_texture), whatever range and angle: write "
    "it into the textures where it depends on the surface alone, else apply it behind the graph, with the fields "
    "INTENSITY_F32, DISTANCE_F32, INCIDENT_ANGLE_F32 and ENTITY_ID_I32"
)
_DROP = "no node loses points at random; drop them behind the graph"
INSTEAD = {
    **dict.fromkeys(OF_INTENSITY, _TEXTURE),
    **dict.fromkeys(LOSSES, _DROP),
    "mixed_pixels": "rgl_node_raytrace_configure_beam_divergence casts several rays a beam, and returns of its first "
    "or last hit; points between two surfaces need a mean of hits behind the graph",
    "range_scale": "move points along their rays behind the graph; the noise node's mean is one number for all ranges",
    "beam_azimuth_error": "add it to the ray poses that rgl_node_rays_from_mat3x4f is given",
    "beam_elevation_error": "add it to the ray poses that rgl_node_rays_from_mat3x4f is given",
    "motion_distortion": "rgl_node_raytrace_configure_velocity with time offsets of the rays "
    "(rgl_node_rays_set_time_offsets) does it",
}


def settings(answer: Estimates, _: Mapping[str, float]) -> list[Setting]:
    """The arguments of the noise of distances."""
    base, grows = answer.levels.get("range_noise"), answer.one("range_noise", "sd_m")
    rise = grows and grows.mapped(lambda sd: sd / REFERENCE_M)
    why = "range_noise grows as the echo weakens, so over the range of one surface evenly; at reference power"
    return [
        *mean_bias(answer, "distance.mean", ": the node knows no beams"),
        *known(("distance.st_dev_base", base, "m", "noise of the range that is the same for all")),
        *known(("distance.st_dev_rise_per_meter", rise, "1", why)),
    ]


def text(chosen: Sequence[Setting]) -> str:
    """The C call that makes the node."""
    values = {one.name: one.value.value for one in chosen}
    arguments = (values.get(f"distance.{key}", 0.0) for key in ("mean", "st_dev_base", "st_dev_rise_per_meter"))
    # As Python writes a float, always with a point or an exponent: C knows no `0f`.
    literals = ", ".join(f"{float(f'{value:.6g}')}f" for value in arguments)
    return f"rgl_node_t noise = nullptr;\nrgl_node_gaussian_noise_distance(&noise, {literals});\n"


ENGINE = Engine(
    title="RGL",
    settings=settings,
    expresses=frozenset({"range_offset", "beam_range_bias", "range_noise"}),
    instead=INSTEAD,
    text=text,
    suffix=".cpp",
    notes=("RGL adds base and rise, not their squares: where both are given, near the sensor a little too much.",),
    links=("https://github.com/RobotecAI/RobotecGPULidar/blob/develop/docs/GaussianNoise.md",),
)
