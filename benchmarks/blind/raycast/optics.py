"""Light: what an ideal renderer predicts of a place, and the echoes that a sensor's beams bring back from it.

Letters: a albedo, θ incidence, I reported intensity = a cos θ, P received power with ln P = ln I - 2 ln(r / 10 m).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from benchmarks.blind.raycast.chance import cell_value, stream, value_noise
from benchmarks.blind.raycast.materials import MATERIALS, NAMES, texture_of
from benchmarks.blind.raycast.nuisance import Nuisance
from benchmarks.blind.raycast.scenes import Hits, Scene
from benchmarks.blind.raycast.sensors import Grid

SKY, COS_FLOOR = 23, 0.015
WEIGHTS = np.array([0.4, 0.15, 0.15, 0.15, 0.15])
"""Light of the middle and of the four corners of a beam."""
SAME_M = 0.5
"""Echoes that lie closer than this are one."""


class Albedo:
    """The renderer's table and textures of one scene, and the truth about its surfaces."""

    def __init__(self, case: str, scene: int, nuisance: Nuisance):
        self.nuisance = nuisance
        self.table = np.array([MATERIALS[name].albedo for name in NAMES])
        self.true_table = self.table * np.exp(nuisance.table_sd * stream(case, "table").normal(size=len(NAMES)))
        rng = stream(case, "albedo", scene)
        self.thing = nuisance.thing_sd * rng.normal(size=5000)
        self.salt = int(rng.integers(1 << 20))

    def texture(self, hits: Hits) -> np.ndarray:
        """Nats that the renderer knows."""
        return self.nuisance.texture_sd * texture_of(hits.material, hits.point, self.salt)

    def true(self, hits: Hits) -> np.ndarray:
        """The surfaces' albedo: table, texture, object or patch of 5 m, and fine detail that no renderer knows."""
        n, salt = self.nuisance, self.salt + 1000
        patch = 0.8 * n.thing_sd * np.sqrt(3) * cell_value(np.floor(hits.point / 5 + 0.4), salt)
        own = np.where(hits.thing > 0, self.thing[hits.thing], patch)
        unknown = n.detail_sd * value_noise(hits.point, 0.25, salt + 1)
        return self.true_table[hits.material] * np.exp(self.texture(hits) + own + unknown)


class Place(NamedTuple):
    """Where a frame is taken: pose is the sensor's (rotation from sensor to scene, origin in m)."""

    frame: int
    scene: Scene
    albedo: Albedo
    turn: np.ndarray
    origin: np.ndarray
    time_s: float
    speed_m_s: float
    heading_rad: float


@dataclass
class Echoes:
    """(rows, columns) arrays of one measured frame while it is being made."""

    grid: Grid
    hit: np.ndarray
    range_m: np.ndarray
    theta: np.ndarray
    semantic: np.ndarray
    albedo: np.ndarray
    intensity: np.ndarray
    power: np.ndarray
    lost: np.ndarray
    bias_m: np.ndarray
    sd_m: np.ndarray

    def dim(self, factor: np.ndarray | float) -> None:
        """Less light (or more)."""
        self.intensity, self.power = self.intensity * factor, self.power * factor

    def lose(self, probability: np.ndarray | float) -> None:
        """A further, independent chance to lose the return."""
        self.lost = 1 - (1 - self.lost) * (1 - probability)


def _semantic(material: np.ndarray) -> np.ndarray:
    return np.array([*(MATERIALS[name].semantic for name in NAMES), SKY])[material]


def render(place: Place, grid: Grid, case: str, nuisance: Nuisance) -> dict[str, np.ndarray]:
    """The ideal simulator's frame: range (0 where nothing is hit), intensity without texture, incidence, semantic,
    instance, rgb; and `texture` (nats) and `true_cos`, with which every simulator deals in its own way."""
    direction = (grid.directions() @ place.turn.T).reshape(-1, 3)
    hits = place.scene.cast(np.broadcast_to(place.origin, direction.shape), direction)
    hit, rng = hits.material >= 0, stream(case, "render", place.frame)
    tilt = hits.normal + nuisance.normals_sd_rad * rng.normal(size=hits.normal.shape)
    cos = np.abs((tilt * direction).sum(1)) / np.linalg.norm(tilt, axis=1)
    cos = np.clip(cos, COS_FLOOR, 1)
    thing_rng = stream(case, "labels", place.frame)
    swapped = thing_rng.random(5000) < nuisance.wrong_label
    stranger = thing_rng.integers(len(NAMES), size=5000)
    material = np.where((hits.thing > 0) & swapped[hits.thing], stranger[hits.thing], hits.material)
    known = hits._replace(material=material)
    texture = np.where(hit, place.albedo.texture(known), 0.0)
    hue = np.array([*(MATERIALS[name].hue for name in NAMES), (150, 180, 220)])[material]
    rgb = hue * np.exp(0.5 * texture + 0.15 * thing_rng.normal(size=5000)[hits.thing])[:, None]
    frame = {
        "range": np.where(hit, hits.range_m, 0.0),
        "intensity": np.where(hit, place.albedo.table[material] * cos, 0.0),
        "incidence": np.where(hit, np.arccos(cos), 0.0),
        "semantic": _semantic(material),
        "instance": hits.thing,
        "rgb": np.clip(rgb, 0, 255).astype(np.uint8),
        "texture": texture,
        "true_cos": np.maximum(hits.cos, COS_FLOOR),
    }
    return {name: x.reshape(*grid.shape, *x.shape[1:]) for name, x in frame.items()}


def expose(place: Place, grid: Grid, case: str, nuisance: Nuisance) -> Echoes:
    """The strongest echo of every beam: five rays, grouped by range, with the albedo of the surface they come from."""
    rng = stream(case, "pose", place.frame)
    turn = place.turn @ small_turn(nuisance.pose_rad * rng.normal(size=3))
    origin = place.origin + nuisance.pose_m * rng.normal(size=3)
    ahead = grid.directions().reshape(-1, 3)
    aside = np.stack([-ahead[:, 1], ahead[:, 0], np.zeros(len(ahead))], 1)
    aside /= np.linalg.norm(aside, axis=1, keepdims=True)
    above = np.cross(ahead, aside)
    corners = 0.5 * grid.beam_rad * np.array([[0, 0], [1, 1], [1, -1], [-1, 1], [-1, -1]])
    rays = ahead[:, None] + corners[None, :, :1] * aside[:, None] + corners[None, :, 1:] * above[:, None]
    rays = (rays / np.linalg.norm(rays, axis=-1, keepdims=True)).reshape(-1, 3) @ turn.T
    hits = place.scene.cast(np.broadcast_to(origin, rays.shape), rays)
    cos, albedo = np.maximum(hits.cos, COS_FLOOR), np.where(hits.material >= 0, place.albedo.true(hits), 0.0)
    beams = (len(ahead), len(WEIGHTS))
    r, light = hits.range_m.reshape(beams), (albedo * cos).reshape(beams) * WEIGHTS
    with np.errstate(invalid="ignore", divide="ignore"):
        power = np.where(np.isfinite(r), light / (r / 10) ** 2, 0.0)
        one = np.abs(r[:, :, None] - r[:, None, :]) < SAME_M
    group = np.where(one, power[:, None, :], 0.0).sum(2)
    lead = (group + 1e-9 * WEIGHTS).argmax(1)
    pick = np.arange(len(lead))
    hit = group[pick, lead] > 0
    members = one[pick, lead] & np.isfinite(r)
    share = np.where(members, WEIGHTS, 0.0)
    range_m = np.where(hit, (share * np.where(members, r, 0)).sum(1) / np.maximum(share.sum(1), 1e-9), np.inf)
    intensity = np.exp(nuisance.gain) * np.where(members, light, 0.0).sum(1)
    flat = pick * len(WEIGHTS) + lead
    zero = np.zeros(len(lead))
    parts = {
        "hit": hit,
        "range_m": range_m,
        "theta": np.arccos(np.clip(cos[flat], 0, 1)),
        "semantic": _semantic(hits.material)[flat],
        "albedo": albedo[flat],
        "intensity": intensity,
        "power": np.where(hit, intensity / np.where(hit, range_m / 10, 1.0) ** 2, 0.0),
        "lost": np.where(np.isfinite(r).all(1) & one.all((1, 2)), nuisance.loss, nuisance.loss + nuisance.edge_loss),
        "bias_m": zero,
        "sd_m": zero,
    }
    return Echoes(grid, **{name: x.reshape(grid.shape) for name, x in parts.items()})


def small_turn(angles: np.ndarray) -> np.ndarray:
    """The rotation by a vector of small angles (rad), by Rodrigues' formula."""
    size = float(np.linalg.norm(angles))
    if size == 0:
        return np.eye(3)
    x, y, z = angles / size
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(size) * k + (1 - np.cos(size)) * k @ k
