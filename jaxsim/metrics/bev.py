"""Bird's-eye-view histograms of clouds, and the distances between two sets of them.

Three published programs, whose values are not comparable: the definition's name belongs to the score.

    lidargen   LiDARGen (Zyrianov et al. 2022), metrics/histogram: the cloud is first put into a 64 x 1024 range
               image and taken back at its cells' upper-left corners, ranges beyond 63 m at 63 m; 3 < range < 70 m;
               MMD over the spectral norm of the difference of two histograms
    r2dm       R2DM (Nakashima and Kurazume 2024), metrics/bev.py: straight from the points, 3 < range < 70 m; MMD
               over the Euclidean norm
    lidm       LiDAR-Diffusion (Ran et al. 2024), lidm/eval: cells of 5 cm within 50 m, 1 where a scan has a point

lidargen and r2dm count points in 100 x 100 cells over 80 m to each side. The JSD is SciPy's `jensenshannon`: the
root of the divergence, natural logarithm. The MMD has a Gaussian kernel of sigma 0.5 over histograms of sum 1 and
is the biased mean over all pairs; distances are far below sigma, so 1 - kernel is computed, not the kernel.
"""

from __future__ import annotations

from collections.abc import Iterable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from jaxsim.frame import Array
from jaxsim.geometry.polar import scatter_nearest
from jaxsim.products import einsum
from jaxsim.progress import Progress

HALF_M, BINS = 80.0, 100
NEAREST_M, FARTHEST_M = 3.0, 70.0
SCAN_ROWS, SCAN_COLUMNS = 64, 1024
UP_RAD, DOWN_RAD = np.deg2rad(3.0), np.deg2rad(25.0)
SIGMA = 0.5
LIDM_HALF_M = 50.0
LIDM_CELL_M = 0.05
LANCZOS = 32
"""Directions in which the spectral norm of a 100 x 100 matrix is looked for ..."""
UNSURE = 1e-5
"""... and the share of it that it may be off by; beyond, all singular values are computed."""
FEW = 100
"""Matrices at once below which all singular values are computed, too: compiling what looks for the largest takes longer
than it saves, of sets of fewer histograms than these."""


@jax.jit
def spherical_image(
    xyz_m: Float[Array, "*b n 3"], valid: Bool[Array, "*b n"]
) -> tuple[Float[Array, "*b 64 1024"], Bool[Array, "*b 64 1024"], Int[Array, "*b 64 1024"]]:
    """The nearest range in each cell of a 64 x 1024 image over +3 to -25 degrees, where there is one, and its point.

    semantic-kitti-api `laserscan.py`: points above or below go to the first or last row.
    """
    x = xyz_m[..., 0]
    y = xyz_m[..., 1]
    z = xyz_m[..., 2]
    range_m = jnp.sqrt(x * x + y * y + z * z)
    seen = valid & jnp.isfinite(range_m) & (range_m > 0)
    pitch = jnp.arcsin(jnp.where(seen, z / jnp.where(seen, range_m, 1.0), 0.0))
    # Columns begin behind the sensor, at an azimuth of pi, and turn right; rows begin at UP_RAD.
    column = jnp.floor(0.5 * (1.0 - jnp.arctan2(y, x) / jnp.pi) * SCAN_COLUMNS)
    row = jnp.floor((1.0 - (pitch + DOWN_RAD) / (UP_RAD + DOWN_RAD)) * SCAN_ROWS)
    row = jnp.where(seen, jnp.clip(row, 0, SCAN_ROWS - 1), 0.0).astype(jnp.int32)
    column = jnp.where(seen, jnp.clip(column, 0, SCAN_COLUMNS - 1), 0.0).astype(jnp.int32)
    index, filled = scatter_nearest(range_m, row, column, inside=seen, shape=(SCAN_ROWS, SCAN_COLUMNS))
    flat = index.reshape(*index.shape[:-2], -1)
    nearest = jnp.take_along_axis(range_m, flat, axis=-1).reshape(index.shape)
    return jnp.where(filled, nearest, 0.0), filled, index


def _directions() -> Float[np.ndarray, "64 1024 3"]:
    """Directions of the corners of LiDARGen's cells."""
    # This yaw grows to the right, against `velo`'s azimuth: hence the minus of y.
    yaw = np.pi * (np.arange(SCAN_COLUMNS) / SCAN_COLUMNS * 2 - 1)
    pitch = (1 - np.arange(SCAN_ROWS) / SCAN_ROWS) * (UP_RAD + DOWN_RAD) - DOWN_RAD
    x = np.cos(yaw)[None] * np.cos(pitch)[:, None]
    y = -np.sin(yaw)[None] * np.cos(pitch)[:, None]
    z = np.broadcast_to(np.sin(pitch)[:, None], (SCAN_ROWS, SCAN_COLUMNS))
    return np.stack([x, y, z], axis=-1).astype(np.float32)


@jax.jit
def lidargen_points(
    range_m: Float[Array, "*b 64 1024"], filled: Bool[Array, "*b 64 1024"]
) -> tuple[Float[Array, "*b n 3"], Bool[Array, "*b n"]]:
    """The cloud that LiDARGen takes its histogram of: logarithmic ranges up to 63 m at the cells' corners."""
    # The program's own constants: its images hold log2(range + 1) / 6, so 63 m is 1.
    log = jnp.clip(jnp.log2(range_m + 0.0001 + 1.0) / 6, 0.0, 1.0)
    depth = jnp.exp2(6 * log) - 1
    rays = jnp.asarray(_directions())
    rays = rays.reshape((1,) * (depth.ndim - 2) + rays.shape)
    xyz = (jnp.broadcast_to(rays, (*depth.shape, 3)) * depth[..., None]).reshape(*depth.shape[:-2], -1, 3)
    return xyz, filled.reshape(*filled.shape[:-2], -1)


@jax.jit
def cell_counts(xyz_m: Float[Array, "*b n 3"], valid: Bool[Array, "*b n"]) -> Float[Array, "*b 100 100"]:
    """Points in each cell (x, then y) of those between 3 and 70 m."""
    range_m = jnp.sqrt((xyz_m * xyz_m).sum(-1))
    at = jnp.floor((xyz_m[..., :2] + HALF_M) * (BINS / (2 * HALF_M)))
    inside = valid & (range_m > NEAREST_M) & (range_m < FARTHEST_M) & ((at >= 0) & (at < BINS)).all(-1)
    # One cell beyond the table takes what is left out: `drop` loses it.
    cell = jnp.where(inside, at[..., 0] * BINS + at[..., 1], float(BINS * BINS)).astype(jnp.int32)

    def one(cell: Array) -> Array:
        return jnp.zeros(BINS * BINS, jnp.float32).at[cell].add(1.0, mode="drop")

    histogram = jax.vmap(one)(cell.reshape(-1, cell.shape[-1]))
    return histogram.reshape(*cell.shape[:-1], BINS, BINS)


@jax.jit
def lidargen_counts(xyz_m: Float[Array, "*b n 3"], valid: Bool[Array, "*b n"]) -> Float[Array, "*b 100 100"]:
    """`cell_counts` of the cloud as LiDARGen's range image has it."""
    range_m, filled, _ = spherical_image(xyz_m, valid)
    return cell_counts(*lidargen_points(range_m, filled))


COUNTS = {"lidargen": lidargen_counts, "r2dm": cell_counts}
"""Definition -> clouds to histograms."""


def jensen_shannon(p: Float[np.ndarray, "*shape"], q: Float[np.ndarray, "*shape"]) -> float:
    """Root of the Jensen-Shannon divergence (natural logarithm) of two histograms, each scaled to sum 1.

    Raises ValueError where one is empty.
    """
    if not (p.sum() > 0 and q.sum() > 0):
        raise ValueError("jsd: a histogram is empty; no point of a set lies within the definition's ranges")
    p = np.asarray(p, np.float64).ravel() / np.sum(p, dtype=np.float64)
    q = np.asarray(q, np.float64).ravel() / np.sum(q, dtype=np.float64)
    middle = (p + q) / 2
    # 0 ln 0 is 0: empty cells add nothing.
    parts = (np.sum(h[h > 0] * np.log(h[h > 0] / middle[h > 0])) for h in (p, q))
    # Of two equal histograms rounding may leave less than 0.
    return float(np.sqrt(max(sum(parts) / 2, 0.0)))


def _scaled(histograms: Float[np.ndarray, "n r c"]) -> Float[np.ndarray, "n r c"]:
    sums = histograms.sum((1, 2), keepdims=True)
    if not (sums > 0).all():
        raise ValueError("mmd: a cloud has no point within the definition's ranges; leave it out")
    return histograms / sums


@jax.jit
def _spectral_squares(difference: Float[Array, "n r c"]) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """Largest eigenvalue of D' D of each D, which is its spectral norm squared, by Lanczos' method with every direction
    kept orthogonal to those before; and how far off it may be. Half the time of all singular values."""
    count, _, columns = difference.shape
    # Always the same start: equal histograms score alike.
    start = jax.random.normal(jax.random.key(0), (columns,))
    along = [jnp.tile(start / jnp.linalg.norm(start), (count, 1))]
    diagonal = []
    beside = []
    for _ in range(min(LANCZOS, columns)):
        v, basis = along[-1], jnp.stack(along, 1)
        w = einsum("nrc,nc->nr", difference, v)
        w = einsum("nrc,nr->nc", difference, w)
        diagonal.append((v * w).sum(-1))
        for _ in range(2):  # once leaves what rounding has left
            w = w - einsum("nkc,nk->nc", basis, einsum("nkc,nc->nk", basis, w))
        beside.append(jnp.linalg.norm(w, axis=-1))
        along.append(w / jnp.maximum(beside[-1], 1e-20)[:, None])
    off = jnp.stack(beside[:-1], -1)
    tridiagonal = jax.vmap(lambda d, e: jnp.diag(d) + jnp.diag(e, 1) + jnp.diag(e, -1))(jnp.stack(diagonal, -1), off)
    values, vectors = jnp.linalg.eigh(tridiagonal)
    return values[:, -1], beside[-1] * jnp.abs(vectors[:, -1, -1])


def _norms_squared(difference: Float[np.ndarray, "n r c"]) -> Float[np.ndarray, " n"]:
    # Scaled by 100, squares of tiny shares stay far from float32's smallest numbers.
    scaled = (100 * difference).astype(np.float32)
    if len(scaled) < FEW:
        return np.linalg.norm(scaled, 2, axis=(1, 2)).astype(np.float64) ** 2 / 1e4
    largest, doubt = _spectral_squares(scaled)
    squares = np.array(largest, np.float64)
    off = np.array(doubt, np.float64)
    for k in np.flatnonzero(off > UNSURE * squares):
        squares[k] = np.linalg.norm(scaled[k], 2) ** 2
    return squares / 1e4


def _spectral(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    squares = np.zeros((len(a), len(b)))
    shown = {"desc": "comparing histograms", "unit": "row", "leave": False}
    if a is not b:
        for k in Progress(range(len(a)), **shown):
            squares[k] = _norms_squared(a[k] - b)
        return squares
    # Each and the k-th after it, round the set: every pair once.
    each = np.arange(len(a))
    for k in Progress(range(1, len(a) // 2 + 1), **shown):
        other = (each + k) % len(a)
        squares[each, other] = squares[other, each] = _norms_squared(a - a[other])
    return squares


def _euclidean(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    x = a.reshape(len(a), -1).astype(np.float64)
    y = b.reshape(len(b), -1).astype(np.float64)
    # |x - y|^2 = |x|^2 + |y|^2 - 2 x'y: a matrix product instead of n m differences of 10 000 cells.
    return (x * x).sum(1)[:, None] + (y * y).sum(1)[None] - 2 * x @ y.T


SQUARED_DISTANCES = {"lidargen": _spectral, "r2dm": _euclidean}
"""Definition -> squared distances between all histograms of two sets."""


def mmd(a: Float[np.ndarray, "n r c"], b: Float[np.ndarray, "m r c"], *, definition: str) -> float:
    """Squared maximum mean discrepancy of two sets of histograms (counts); memory n x m."""
    if definition not in SQUARED_DISTANCES:
        raise ValueError(f"mmd: no definition {definition!r}; known: {', '.join(SQUARED_DISTANCES)}")
    squares = SQUARED_DISTANCES[definition]
    a, b = _scaled(np.asarray(a, np.float64)), _scaled(np.asarray(b, np.float64))

    def lost(x: np.ndarray, y: np.ndarray) -> float:
        # 1 - exp(-d^2 / 2 sigma^2) without the loss of digits: the kernel itself is nearly 1.
        return float(np.mean(-np.expm1(-np.maximum(squares(x, y), 0) / (2 * SIGMA**2))))

    # mean k(a, a) + mean k(b, b) - 2 mean k(a, b), where k = 1 - lost.
    return 2 * lost(a, b) - lost(a, a) - lost(b, b)


def lidm_occupancy(clouds: Iterable[Float[np.ndarray, "_n 3"]]) -> Float[np.ndarray, "2000 2000"]:
    """How many of the clouds have a point in each 5-cm cell within 50 m."""
    half = round(LIDM_HALF_M / LIDM_CELL_M)
    total = np.zeros((2 * half) ** 2, np.float32)
    for cloud in clouds:
        inside = cloud[(np.abs(cloud[:, :2]) < LIDM_HALF_M).all(1), :2]
        # Just below 50 m the quotient may round up, in float32, to a cell that is not there.
        cells = np.clip(np.floor(inside / np.float32(LIDM_CELL_M)).astype(int) + half, 0, 2 * half - 1)
        # Occupied or not: of many points in a cell one counts.
        total[np.unique(cells[:, 0] * 2 * half + cells[:, 1])] += 1
    return total.reshape(2 * half, 2 * half)
