"""Rooms with flat floors and walls, cast exactly from any place: what a registration is tried on."""

from functools import cache

import numpy as np
from scipy.spatial.transform import Rotation

from jaxsim.discover.model.evidence import Measured
from jaxsim.discover.read import Comparison
from jaxsim.discover.read.registration import Registration
from jaxsim.discover.read.search import register
from jaxsim.effects.scan import scan_of
from jaxsim.frame import PolarGrid, PolarImage

HEIGHT_M = 1.7
GRID = PolarGrid(
    (np.pi - (np.arange(180) + 0.5) * 2 * np.pi / 180).astype(np.float32),
    np.linspace(0.05, -0.4, 24).astype(np.float32),
    np.zeros(24, np.float32),
)


def rooms(count: int, seed: int = 0):
    """Distances of the walls ahead, behind, left and right of each room, m; all as high as can be seen."""
    return np.random.default_rng(seed).uniform((12, 12, 4, 4), (30, 30, 12, 12), (count, 4))


STILL = (0.0,) * 6
NAMES = tuple(f"s{k}" for k in range(12))


def seen(
    room, pose=STILL, *, noise_m: float = 0.0, rng=None, strangers: float = 0.0, lift: float = 0.0, driven: float = 0.0
) -> PolarImage:
    """A room from a moved (m) and turned (rotation vector) sensor whose beams point higher by `lift` (rad) and that
    drives so many metres during the scan; a share of the columns shows something else."""
    rng = rng or np.random.default_rng(0)
    a, e = np.asarray(GRID.azimuth_rad, float)[None, :], np.asarray(GRID.elevation_rad, float)[:, None] + lift
    d = np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e) + 0 * a], axis=-1)
    d = d @ Rotation.from_rotvec(np.array(pose[3:], float)).as_matrix().T
    ahead, behind, left, right = room
    x = pose[0] + driven * ((np.arange(180) + 0.5) / 180 - 0.5)[None, :]
    with np.errstate(divide="ignore"):
        walls = [
            np.where(d[..., 0] > 0, ahead - x, -behind - x) / d[..., 0],
            np.where(d[..., 1] > 0, left - pose[1], -right - pose[1]) / d[..., 1],
            np.where(d[..., 2] < 0, (-HEIGHT_M - pose[2]) / np.minimum(d[..., 2], -1e-9), np.inf),
        ]
    range_m = np.min(walls, axis=0) + rng.normal(0, noise_m, d.shape[:2]) * (noise_m > 0)
    other = rng.random(range_m.shape[1]) < strangers
    range_m = np.where(other[None, :], np.minimum(range_m, rng.uniform(3, 9)), range_m)
    return PolarImage(range_m.astype(np.float32), np.full(range_m.shape, 0.3, np.float32), np.ones(range_m.shape, bool))


def measured_of(theirs) -> Measured:
    """Measured frames, stacked."""
    return Measured(
        *(np.stack([getattr(image, part) for image in theirs]) for part in ("range_m", "intensity", "valid"))
    )


def registered(ours, theirs, names) -> Registration:
    """The registration of simulated and measured rooms."""
    measured = measured_of(theirs)
    return register(scan_of(GRID, ours), measured.range_m, measured.valid, scenes=names)


def comparison(poses, **more) -> Comparison:
    """Rooms that are seen from these poses, and registered: once, whichever tests ask for them."""
    poses = np.broadcast_to(np.asarray(poses, float), (len(NAMES), 6))
    return _compared(tuple(map(tuple, poses.tolist())), **more)


@cache
def _compared(poses: tuple[tuple[float, ...], ...], **more) -> Comparison:
    rng = np.random.default_rng(2)
    streets = rooms(len(NAMES))
    ours = [seen(room) for room in streets]
    theirs = [seen(r, p, noise_m=0.02, rng=rng, **more) for r, p in zip(streets, poses, strict=True)]
    scan = scan_of(GRID, ours)
    return Comparison(scan, measured_of(theirs), NAMES, NAMES, registration=registered(ours, theirs, NAMES))


def off_m(one: Comparison) -> float:
    both = one.scan.hit & one.measured.valid
    return float(np.median(np.abs(one.scan.range_m - one.measured.range_m)[both]))
