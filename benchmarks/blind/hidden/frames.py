"""One frame: what the simulator predicts, and what light and electronics make of the same street.

`simulate` is the ideal ray model: centre ray, class reflectance times cosine, no noise, no drops. `expose` follows
the measured beam through geometry, surface and path; each hidden effect is a set of hooks, called by stage in that
order. `read_out` turns the state into a reading. Letters: θ incidence (rad), I reported intensity before noise of
the reading, P received power with ln P = ln I - 2 ln(r / 10 m).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from benchmarks.blind.hidden.nuisance import Nuisance, Surfaces, stream
from benchmarks.blind.hidden.street import Drive, pose
from benchmarks.blind.hidden.world import Hits, cast

HEIGHT_M, REACH_M, SCAN_S = 1.8, 120.0, 0.1
BEAM_RADIUS_RAD = 0.75e-3
COS_FLOOR = 0.012
STAGES = ("surface", "path", "receiver", "detection", "ranging")


@dataclass(frozen=True)
class Grid:
    """Sensor raster: (columns,) azimuths that fall, (rows,) elevations, top first; rad."""

    azimuth: np.ndarray
    elevation: np.ndarray

    @property
    def full_turn(self) -> bool:
        return bool(self.azimuth[0] - self.azimuth[-1] > 6)


@dataclass(frozen=True)
class Moment:
    """A frame's place in its recording; times in s since the first frame of the case."""

    frame: int
    scene: int
    time_s: float
    since_scene_s: float
    speed_m_s: float
    heading_rad: float


@dataclass
class Rays:
    """Beams before they are cast, vehicle frame (x forward, y left); (rows, columns, 3) each."""

    direction: np.ndarray
    offset: np.ndarray


@dataclass
class State:
    """Arrays (rows, columns) of the measured frame while it is being made."""

    grid: Grid
    moment: Moment
    simulated: dict[str, np.ndarray]
    hit: np.ndarray
    range_m: np.ndarray  # inf where nothing is hit
    theta: np.ndarray
    semantic: np.ndarray
    instance: np.ndarray
    intensity: np.ndarray
    power: np.ndarray
    drop: np.ndarray
    bias_m: np.ndarray
    sd_m: np.ndarray
    entropy: tuple[int, ...]
    rgb: np.ndarray
    round_m: float = 0.0
    early: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = field(default_factory=list)  # probability, range, I
    outshine: bool = False  # early returns win against nearer surfaces too (strongest echo)

    def random(self, what: str) -> np.random.Generator:
        return stream(self.entropy, "state", what, self.moment.frame)

    def scale(self, factor: np.ndarray | float) -> None:
        """Fewer or more photons: power and the intensity that firmware makes of it."""
        self.intensity = self.intensity * factor
        self.power = self.power * factor

    def lose(self, probability: np.ndarray | float) -> None:
        """An independent further chance to lose the return."""
        self.drop = 1 - (1 - self.drop) * (1 - probability)

    @property
    def row(self) -> np.ndarray:
        return np.broadcast_to(np.arange(self.hit.shape[0])[:, None], self.hit.shape)

    @property
    def column(self) -> np.ndarray:
        return np.broadcast_to(np.arange(self.hit.shape[1])[None], self.hit.shape)

    @property
    def azimuth(self) -> np.ndarray:
        return np.broadcast_to(self.grid.azimuth[None], self.hit.shape)


Hook = Callable[[State], None]
RayHook = Callable[[Rays, Grid, Moment], None]


def make_grid(rng: np.random.Generator, rows: int, columns: int, full_turn: bool) -> Grid:
    """Elevations from about +2 to -24 degrees, denser near the horizon; cell centres of the turn or of +-60 degrees."""
    t = (np.arange(rows) + 0.3 * rng.uniform(-1, 1, rows)) / max(rows - 1, 1)
    elevation = np.deg2rad(2.0 - 26.0 * np.clip(t, 0, 1.01) ** rng.uniform(1.3, 1.6))
    half = np.pi if full_turn else np.pi / 3
    azimuth = half - (np.arange(columns) + 0.5) * (2 * half / columns)
    return Grid(azimuth, elevation)


def nominal(grid: Grid) -> Rays:
    el, az = grid.elevation[:, None], grid.azimuth[None]
    d = np.stack([np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), np.sin(el) + 0 * az], -1)
    return Rays(d, np.zeros_like(d))


def _turn(roll: float, pitch: float, yaw: float) -> np.ndarray:
    (cr, sr), (cp, sp), (cy, sy) = ((np.cos(a), np.sin(a)) for a in (roll, pitch, yaw))
    x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    return z @ y @ x


def shoot(drive: Drive, moment: Moment, rays: Rays, jitter: tuple[np.ndarray, np.ndarray] | None = None) -> Hits:
    """Cast vehicle-frame rays from the drive's pose; fields keep the rays' (rows, columns) shape."""
    place, yaw = pose(drive, moment.since_scene_s, HEIGHT_M)
    turn = _turn(0, 0, yaw)
    if jitter is not None:
        turn, place = turn @ _turn(*jitter[0]), place + jitter[1]
    shape = rays.direction.shape[:-1]
    hits = cast(drive.world, (rays.offset @ turn.T + place).reshape(-1, 3), (rays.direction @ turn.T).reshape(-1, 3))
    return Hits(*(x.reshape(shape + x.shape[1:]) for x in hits)), (rays.direction @ turn.T)


def _incidence(normal: np.ndarray, direction: np.ndarray) -> np.ndarray:
    return np.arccos(np.clip(-(normal * direction).sum(-1), COS_FLOOR, 1))


def _colours(hits: Hits, drive: Drive, entropy: tuple[int, ...], scene: int) -> np.ndarray:
    """Camera colours: a hue an instance (a class for stuff) and pixel texture, unrelated to the infrared spread."""
    rng = stream(entropy, "colours", scene)
    thing, stuff = rng.uniform(20, 235, (1000, 3)), rng.uniform(60, 200, (64, 3))
    base = np.where((hits.instance > 0)[..., None], thing[hits.instance], stuff[hits.semantic])
    pixel = stream(entropy, "pixels", scene).normal(0, 9, hits.semantic.shape)
    return np.clip(base + pixel[..., None], 0, 255).astype(np.uint8)


def steps(range_m: np.ndarray, full_turn: bool) -> np.ndarray:
    """Range of the neighbour minus own, (4, rows, columns): left, right, up, down; 0 outside the image."""
    r = range_m
    pad = "wrap" if full_turn else "edge"
    wide, tall = np.pad(r, ((0, 0), (1, 1)), mode=pad), np.pad(r, ((1, 1), (0, 0)), mode="edge")
    with np.errstate(invalid="ignore"):
        out = np.stack([wide[:, :-2] - r, wide[:, 2:] - r, tall[:-2] - r, tall[2:] - r])
    return np.where(np.isnan(out), 0.0, out)


def silhouette(range_m: np.ndarray, full_turn: bool) -> np.ndarray:
    """True where a neighbour lies more than 0.3 m and 5 % away, or hits nothing."""
    far = np.abs(steps(range_m, full_turn))
    return (far > np.maximum(0.3, 0.05 * np.where(np.isfinite(range_m), range_m, 1e9))).any(0)


def simulate(
    drive: Drive, moment: Moment, grid: Grid, surfaces: Surfaces, nuisance: Nuisance, entropy: tuple[int, ...]
) -> dict[str, np.ndarray]:
    """The ideal simulator's arrays, as they are written, and `true_theta`, `true_semantic` and `texture` (nats), which
    are not."""
    hits, d = shoot(drive, moment, nominal(grid))
    hit = np.isfinite(hits.range_m)
    rng = stream(entropy, "normals", moment.frame)
    sd = nuisance.normals_sd_rad
    shake = rng.normal(0, 1, (*hit.shape, 3)) * 0.85
    shake += 0.5 * stream(entropy, "tilts", moment.scene).normal(0, 1, (1000, 3))[hits.instance]
    noisy = hits.normal + sd * shake
    noisy /= np.linalg.norm(noisy, axis=-1, keepdims=True)
    cos = np.abs((noisy * d).sum(-1))
    theta = np.arccos(np.clip(cos, COS_FLOOR, 1))
    label = hits.semantic.copy()
    if nuisance.wrong_label > 0:
        label = _mislabel(hits, nuisance, grid, stream(entropy, "labels", moment.scene))
    intensity = np.where(hit, np.clip(surfaces.table[label] * np.cos(theta), 0, 1), 0)
    return {
        "range": np.where(hit, hits.range_m, 0.0),
        "intensity": intensity,
        "incidence": np.where(hit, theta, 0.0),
        "semantic": label,
        "instance": np.where(hit, hits.instance, 0),
        "rgb": _colours(hits, drive, entropy, moment.scene),
        "true_theta": _incidence(hits.normal, d),
        "true_semantic": hits.semantic,
        "texture": np.where(hit, surfaces.texture(hits.point.reshape(-1, 3)).reshape(hit.shape), 0.0),
    }


def _mislabel(hits: Hits, nuisance: Nuisance, grid: Grid, rng: np.random.Generator) -> np.ndarray:
    """Whole instances take another class's label; silhouette pixels take a neighbour's."""
    other = np.array([11, 12, 17, 20, 21, 24, 26, 27])
    swap = rng.random(1000) < nuisance.wrong_label
    kinds = other[rng.integers(len(other), size=1000)]
    label = np.where((hits.instance > 0) & swap[hits.instance], kinds[hits.instance], hits.semantic)
    edge = silhouette(hits.range_m, grid.full_turn) & np.isfinite(hits.range_m)
    beside = np.roll(label, int(rng.choice([-1, 1])), 1)
    bleed = edge & (rng.random(label.shape) < 4 * nuisance.wrong_label) & (beside != 23)
    return np.where(bleed, beside, label)


def expose(
    drive: Drive,
    moment: Moment,
    grid: Grid,
    surfaces: Surfaces,
    nuisance: Nuisance,
    entropy: tuple[int, ...],
    simulated: dict[str, np.ndarray],
    ray_hooks: Sequence[RayHook] = (),
    hooks: Sequence[tuple[str, Hook]] = (),
) -> State:
    """The measured frame's state after all stages, before chance decides about returns and range noise."""
    rng = stream(entropy, "jitter", moment.frame)
    jitter = rng.normal(0, nuisance.pose_rad, 3), rng.normal(0, nuisance.pose_m, 3)
    rays = nominal(grid)
    for hook in ray_hooks:
        hook(rays, grid, moment)
    hits, d = shoot(drive, moment, rays, jitter)
    range_m, fraction = _footprint(drive, moment, grid, rays, jitter, hits)
    hit = np.isfinite(range_m)
    theta = _incidence(hits.normal, d)
    flat = surfaces.reflectance(hits.point.reshape(-1, 3), hits.semantic.ravel(), hits.instance.ravel())
    intensity = np.exp(nuisance.gain) * flat.reshape(hit.shape) * np.cos(theta) * fraction
    state = State(
        grid=grid, moment=moment, simulated=simulated, hit=hit, range_m=range_m, theta=theta,
        semantic=hits.semantic, instance=hits.instance, intensity=np.where(hit, intensity, 0.0),
        power=np.where(hit, intensity / np.where(hit, range_m / 10, 1) ** 2, 0.0),
        drop=np.zeros(hit.shape), bias_m=np.zeros(hit.shape), sd_m=np.zeros(hit.shape),
        entropy=entropy, rgb=simulated["rgb"],
    )  # fmt: skip
    state.lose(nuisance.drop + nuisance.edge_drop * silhouette(range_m, grid.full_turn))
    for stage in STAGES:
        if stage == "receiver":
            state.scale(np.exp(nuisance.intensity_sd * state.random("shot").normal(0, 1, hit.shape)))
        for at, hook in hooks:
            if at == stage:
                hook(state)
    return state


def _footprint(drive, moment, grid, rays, jitter, hits) -> tuple[np.ndarray, np.ndarray]:
    """Range of the strongest echo of 7 sub-rays and its share of the beam; only where a silhouette is near."""
    range_m, fraction = hits.range_m.copy(), np.ones(hits.range_m.shape)
    at = np.nonzero(silhouette(range_m, grid.full_turn))
    if not len(at[0]):
        return range_m, fraction
    d = rays.direction[at]
    side = np.stack([-d[:, 1], d[:, 0], np.zeros(len(d))], 1)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    up = np.cross(d, side)
    ring = np.arange(6) * np.pi / 3
    offsets = BEAM_RADIUS_RAD * np.stack([np.cos(ring), np.sin(ring)], 1)
    around = d[:, None] + offsets[None, :, :1] * side[:, None] + offsets[None, :, 1:] * up[:, None]
    around /= np.linalg.norm(around, axis=-1, keepdims=True)
    origin = np.broadcast_to(rays.offset[at][:, None], around.shape)
    sub, _ = shoot(drive, moment, Rays(around, origin), jitter)
    echo = np.concatenate([range_m[at][:, None], sub.range_m], 1)
    weight = np.array([0.28] + [0.12] * 6)
    with np.errstate(invalid="ignore"):
        same = np.abs(echo[:, :, None] - echo[:, None, :]) < 0.5
    same |= np.isinf(echo[:, :, None]) & np.isinf(echo[:, None, :])
    share = np.where(np.isfinite(echo), (same * weight).sum(2), -1)
    lead = np.concatenate([share[:, :1] + 1e-9, share[:, 1:]], 1).argmax(1)
    pick = np.arange(len(lead))
    found = share[pick, lead] > 0
    # The centre ray's surface gives the reflectance, so an echo of another surface keeps only its range and share.
    range_m[at] = np.where(found & np.isfinite(range_m[at]), echo[pick, lead], range_m[at])
    fraction[at] = np.where(found, share[pick, lead], 1.0)
    return range_m, fraction


def read_out(state: State, nuisance: Nuisance) -> dict[str, np.ndarray]:
    """Chance: lost returns, range noise, false early returns; then what the file holds."""
    returned = state.hit & (state.random("drop").random(state.hit.shape) >= state.drop)
    noise = state.random("ranging").normal(0, 1, (2, *state.hit.shape))
    r = np.where(state.hit, state.range_m, 0.0) + state.bias_m + nuisance.range_sd_m * noise[0] + state.sd_m * noise[1]
    intensity = np.clip(state.intensity, 0, 1)
    for number, (probability, early_m, early_i) in enumerate(state.early):
        there = state.random(f"early{number}").random(state.hit.shape) < probability
        there &= ((early_m < np.where(returned, r, np.inf)) | state.outshine) & (early_m > 0.3)
        r, intensity = np.where(there, early_m, r), np.where(there, early_i, intensity)
        returned = returned | there
    if state.round_m > 0:
        r = np.round(r / state.round_m) * state.round_m
    returned &= (r > 0.05) & (r < 200)
    return {"range": np.where(returned, r, 0.0), "intensity": np.where(returned, np.clip(intensity, 0, 1), 0.0)}
