"""What differs between any simulator and any sensor with no effect hidden; drawn anew for every case."""

from __future__ import annotations

import zlib
from dataclasses import asdict, dataclass

import numpy as np

from benchmarks.blind.hidden import world as w

# Near-infrared reflectance of the simulator's table, by Cityscapes id.
REFLECTANCE = {
    w.ROAD: 0.14, w.SIDEWALK: 0.24, w.BUILDING: 0.33, w.WALL: 0.28, w.FENCE: 0.25, w.POLE: 0.3, w.LIGHT: 0.3,
    w.SIGN: 0.32, w.VEGETATION: 0.42, w.TERRAIN: 0.3, w.PERSON: 0.26, w.RIDER: 0.26, w.CAR: 0.22, w.TRUCK: 0.38,
    w.BUS: 0.35, w.MOTORCYCLE: 0.2, w.BICYCLE: 0.2,
}  # fmt: skip
LEVELS = ("exact", "default", "misspecified")


@dataclass(frozen=True)
class Nuisance:
    """Standard deviations and shares; lengths in m, angles in rad, gains in nats."""

    instance_sd: float
    texture_sd: float
    normals_sd_rad: float
    pose_rad: float
    pose_m: float
    wrong_label: float
    table_sd: float
    gain: float
    range_sd_m: float
    intensity_sd: float
    drop: float
    edge_drop: float
    glass: float

    def as_dict(self) -> dict[str, float]:
        return asdict(self)


def draw_nuisance(rng: np.random.Generator, level: str) -> Nuisance:
    """Low end with exact geometry ('exact'), the whole band ('default') or the high end ('misspecified').

    Raises:
        ValueError: the level is none of LEVELS.
    """
    if level not in LEVELS:
        raise ValueError(f"nuisance {level!r} is not known; choose one of {', '.join(LEVELS)}")

    def of(low: float, high: float) -> float:
        share = {"exact": 0.2 * rng.random(), "default": rng.random(), "misspecified": 0.8 + 0.2 * rng.random()}
        return low + (high - low) * share[level]

    exact, high = level == "exact", level == "misspecified"
    degree = np.pi / 180
    return Nuisance(
        instance_sd=of(0.10, 0.25),
        texture_sd=of(0.05, 0.20),
        normals_sd_rad=0.0 if exact else of(1.0, 4.0) * degree,
        pose_rad=0.0 if exact else of(0.02, 0.05) * degree,
        pose_m=0.0 if exact else of(0.01, 0.02),
        wrong_label=0.0 if exact else of(0.0, 0.05),
        table_sd=0.2,
        gain=float(rng.normal(0, 0.15)),
        range_sd_m=of(0.01, 0.02),
        intensity_sd=of(0.03, 0.08),
        drop=of(0.001, 0.005),
        edge_drop=of(0.002, 0.01),
        glass=0.6 if high else 1.0,
    )


def stream(entropy: tuple[int, ...], *tags: str | int) -> np.random.Generator:
    """Random numbers that depend on the case and on what they are for, not on what was drawn before."""
    return np.random.default_rng([*entropy, *(zlib.crc32(str(t).encode()) for t in tags)])


def place_noise(point: np.ndarray, cell_m: float, salt: int) -> np.ndarray:
    """Standard normal value of the cell of space (cell_m wide) that each point lies in."""
    cell = np.floor(point / cell_m + 0.37).astype(np.int64)  # the shift keeps the road off a cell's border
    mix = cell @ np.array([73856093, 19349663, 83492791]) + np.int64(salt)
    mix = mix.astype(np.uint64)
    uniform = []
    for step in (1, 2):
        h = mix * np.uint64(0x9E3779B97F4A7C15) + np.uint64(step * 0xBF58476D1CE4E5B9 % 2**64)
        h ^= h >> np.uint64(31)
        h *= np.uint64(0x94D049BB133111EB)
        h ^= h >> np.uint64(29)
        uniform.append((h >> np.uint64(11)).astype(float) / 2.0**53)
    return np.sqrt(-2 * np.log(np.maximum(uniform[0], 1e-12))) * np.cos(2 * np.pi * uniform[1])


class Surfaces:
    """True reflectance of one scene: class table with its error, spread of instances, patches of ground, texture."""

    def __init__(self, entropy: tuple[int, ...], nuisance: Nuisance, scene: int):
        rng = stream(entropy, "table")
        self.nuisance = nuisance
        self.true_table = np.zeros(64)
        self.table = np.zeros(64)
        for kind, value in REFLECTANCE.items():
            self.table[kind] = value
            self.true_table[kind] = value * np.exp(rng.normal(0, nuisance.table_sd))
        rng = stream(entropy, "instances", scene)
        self.spread = np.exp(rng.normal(0, nuisance.instance_sd, 1000))
        self.salt = int(rng.integers(1 << 31))
        self.stuff = rng.normal(0, nuisance.instance_sd * 0.5, 64)

    def texture(self, point: np.ndarray) -> np.ndarray:
        """Texture at the points (n, 3), nats about the surface's level."""
        return self.nuisance.texture_sd * place_noise(point, 0.25, self.salt + 1)

    def reflectance(self, point: np.ndarray, semantic: np.ndarray, instance: np.ndarray) -> np.ndarray:
        """True reflectance at the points (n, 3), without the sensor's gain."""
        n = self.nuisance
        patch = 0.8 * n.instance_sd * place_noise(point, 5.0, self.salt) + self.stuff[semantic]
        spread = np.where(instance > 0, self.spread[instance], np.exp(patch))
        texture = np.exp(self.texture(point))
        glass = np.where((semantic == w.CAR) & (point[:, 2] > 0.97), n.glass, 1.0)
        return self.true_table[semantic] * spread * texture * glass
