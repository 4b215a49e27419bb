"""Rays to surfaces, by Mitsuba: where each ray ends, and what light returns along it."""

from __future__ import annotations

from typing import NamedTuple

import mitsuba as mi
import numpy as np

from benchmarks.blind.mitsuba.materials import CONTEXT
from benchmarks.blind.mitsuba.street import SKY, Street

HEIGHT_M, REACH_M = 1.8, 120.0
STEEPEST_COS = 0.01


class View(NamedTuple):
    """Arrays (rows, columns); range_m is 0 where a ray meets nothing within reach.

    true: pi f(θ, θ) cos θ of the surface; plain: that of the Lambert surface of its albedo.
    """

    range_m: np.ndarray
    incidence_rad: np.ndarray
    true: np.ndarray
    plain: np.ndarray
    semantic: np.ndarray
    instance: np.ndarray


def look(street: Street, azimuth_rad: np.ndarray, elevation_rad: np.ndarray, yaw_rad: float) -> View:
    """What a sensor at the origin, `HEIGHT_M` above the ground and turned to the left by `yaw_rad`, sees of a street.

    Args:
        azimuth_rad: (columns,), elevation_rad: (rows,), of the sensor's own axes.
    """
    shape = len(elevation_rad), len(azimuth_rad)
    turned = azimuth_rad + yaw_rad
    el, az = np.repeat(elevation_rad, shape[1]), np.tile(turned, shape[0])
    directions = np.stack([np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), np.sin(el)], 1)
    scene, origin = street.scene(), mi.Point3f(0, 0, HEIGHT_M)
    range_m, cos, true, plain = np.zeros((4, len(directions)))
    piece = np.full(len(directions), -1)
    for ray, direction in enumerate(directions.tolist()):
        hit = scene.ray_intersect(mi.Ray3f(origin, mi.Vector3f(direction)))
        if not hit.is_valid() or hit.t > REACH_M:
            continue
        number = int(hit.shape.id())
        material, back = street.material[number], hit.wi
        range_m[ray], cos[ray], piece[ray] = hit.t, abs(back.z), number
        true[ray] = material.true.eval(CONTEXT, hit, back)[0]
        plain[ray] = material.plain.eval(CONTEXT, hit, back)[0]
    met = piece >= 0
    of = [np.array(x)[piece] for x in (street.semantic, street.instance)]
    arrays = (
        range_m,
        np.where(met, np.arccos(np.clip(cos, STEEPEST_COS, 1)), 0),
        np.pi * true,
        np.pi * plain,
        np.where(met, of[0], SKY),
        np.where(met, of[1], 0),
    )
    return View(*(x.reshape(shape) for x in arrays))
