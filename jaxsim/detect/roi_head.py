"""The second stage: features pooled around proposals, a score and a better box for each.

Voxel query and voxel RoI pooling (Deng et al., AAAI 2021, 3.2; OpenPCDet's NeighborVoxelSAModuleMSG and
VoxelRCNNHead). Letters: q grid points of a sample, n voxels, s samples of a query, c channels.

Which proposals it learns from, and what, is as in OpenPCDet's ProposalTargetLayer and RoIHeadTemplate. A batch has r
proposals a sample, of which those that fill up the list are all 0.
"""

from __future__ import annotations

from functools import lru_cache, partial
from itertools import product

import jax
import jax.numpy as jnp
import numpy as np
from flax import nnx, struct
from jaxtyping import Bool, Float, Int

from jaxsim.config import BackboneConfig, RoiConfig, VoxelConfig
from jaxsim.detect.backbones import BOX, SparseScale
from jaxsim.detect.layers import BatchNorm, FullyConnected, Linear
from jaxsim.detect.sparse import Sites, Triple
from jaxsim.frame import Array
from jaxsim.geometry.boxes import iou_3d
from jaxsim.native import call, integers, takes


@struct.dataclass
class RoiTargets:
    """The proposals of a training step and what each learns."""

    rois: Array
    """(b, s, 7)."""
    boxes: Array
    """(b, s, 7): the object that a proposal overlaps most; 0 where there is none."""
    canonical: Array
    """(b, s, 7): that object seen from the proposal, its heading within a quarter turn."""
    score: Array
    """(b, s): score to learn, 0..1."""
    foreground: Array
    """bool (b, s): its box is regressed."""


def best_objects(
    rois: Float[Array, "r 7"], boxes: Float[Array, "g 7"], valid: Bool[Array, " g"]
) -> tuple[Float[Array, " r"], Int[Array, " r"]]:
    """Each proposal's largest 3D overlap with an object, and which one."""
    overlap = jnp.where(valid[None], iou_3d(rois, boxes), 0)
    return overlap.max(axis=1), overlap.argmax(axis=1).astype(jnp.int32)


def sample_rois(overlap: Float[Array, " r"], key: Array, config: RoiConfig) -> Int[Array, " s"]:
    """Numbers of the proposals to learn from: foreground at random without repeats, then hard, then easy background.

    Background is drawn with repeats, and so is foreground where there is no background.
    """
    count, r = config.rois, len(overlap)
    keys = jax.random.split(key, 4)
    # Good enough for either loss, as published: for the box's, or for a full score.
    foreground = overlap >= min(config.matched, config.score_range[1])
    easy = overlap < config.easy
    hard = (overlap < config.matched) & ~easy
    n_fore = foreground.sum(dtype=jnp.int32)
    n_hard = hard.sum(dtype=jnp.int32)
    n_easy = easy.sum(dtype=jnp.int32)

    with_background = n_hard + n_easy > 0
    share = min(round(config.foreground * count), count)
    # Foreground up to its share, background fills up, and of that `hard_share` is hard; where a kind is missing the
    # others take its part.
    fore = jnp.where(with_background, jnp.minimum(share, n_fore), jnp.where(n_fore > 0, count, 0))
    background = count - fore
    hard_share = jnp.minimum((background.astype(overlap.dtype) * config.hard_share).astype(jnp.int32), n_hard)
    from_hard = jnp.where(n_easy == 0, background, jnp.where(n_hard == 0, 0, hard_share))

    slot = jnp.arange(count, dtype=jnp.int32)
    # Chances are below 1, so that the foreground, in random order, sorts before all others.
    once = jnp.argsort(jnp.where(foreground, jax.random.uniform(keys[0], (r,)), 2.0)).astype(jnp.int32)
    again = _draw(foreground, keys[1], count)
    first = jnp.where(with_background, once[jnp.minimum(slot, r - 1)], again)
    rest = jnp.where(slot < fore + from_hard, _draw(hard, keys[2], count), _draw(easy, keys[3], count))
    return jnp.where(slot < fore, first, rest)


def _draw(mask: Bool[Array, " r"], key: Array, count: int) -> Int[Array, " s"]:
    """Places where the mask holds, drawn with repeats."""
    # The places where the mask holds come first; where it holds nowhere, what is drawn is not used.
    where = jnp.argsort(~mask, stable=True).astype(jnp.int32)
    return where[jax.random.randint(key, (count,), 0, jnp.maximum(mask.sum(dtype=jnp.int32), 1))]


def assign_rois(
    rois: Float[Array, "b r 7"],
    boxes: Float[Array, "b g 7"],
    valid: Bool[Array, "b g"],
    *,
    key: Array,
    config: RoiConfig,
) -> RoiTargets:
    """Draws the proposals of a step and says what they learn."""

    def of_sample(rois: Array, objects: tuple[Array, Array], key: Array) -> RoiTargets:
        boxes, valid = objects
        overlap, mine = best_objects(rois, boxes, valid)
        chosen = sample_rois(overlap, key, config)
        # Where nothing is labelled, the largest of no overlaps points at a box all the same.
        of_roi = jnp.where(valid.any(), boxes[mine], 0)
        return targets_of(rois[chosen], of_roi[chosen], overlap[chosen], config=config)

    return jax.vmap(of_sample)(rois, (boxes, valid), jax.random.split(key, len(rois)))


def targets_of(
    rois: Float[Array, "*b s 7"], boxes: Float[Array, "*b s 7"], overlap: Float[Array, "*b s"], *, config: RoiConfig
) -> RoiTargets:
    """What chosen proposals learn of their objects."""
    low, high = config.score_range
    return RoiTargets(
        rois=rois,
        boxes=boxes,
        canonical=seen_from_roi(boxes, rois),
        score=jnp.clip((overlap - low) / (high - low), 0, 1),
        foreground=overlap > config.matched,
    )


def seen_from_roi(boxes: Float[Array, "*b s 7"], rois: Float[Array, "*b s 7"]) -> Float[Array, "*b s 7"]:
    """Boxes in the frame of their proposals; a heading the other way round is turned about."""
    turn = rois[..., 6] % (2 * jnp.pi)
    centre = turn_about_z(boxes[..., :3] - rois[..., :3], -turn)
    heading = (boxes[..., 6] - turn) % (2 * jnp.pi)
    # Which end is the front is told by the first stage's direction alone.
    about = (heading > jnp.pi / 2) & (heading < 3 * jnp.pi / 2)
    heading = jnp.where(about, (heading + jnp.pi) % (2 * jnp.pi), heading)
    heading = jnp.where(heading > jnp.pi, heading - 2 * jnp.pi, heading)
    heading = jnp.clip(heading, -jnp.pi / 2, jnp.pi / 2)
    return jnp.concatenate([centre, boxes[..., 3:6], heading[..., None]], axis=-1)


def from_roi(boxes: Float[Array, "*b s 7"], rois: Float[Array, "*b s 7"]) -> Float[Array, "*b s 7"]:
    """Boxes in the frames of their proposals back in `velo`: middles turned and moved, headings added."""
    centre = turn_about_z(boxes[..., :3], rois[..., 6]) + rois[..., :3]
    return jnp.concatenate([centre, boxes[..., 3:6], boxes[..., 6:] + rois[..., 6:]], axis=-1)


def turn_about_z(xyz: Float[Array, "*b 3"], angle_rad: Float[Array, "*b"]) -> Float[Array, "*b 3"]:
    """Points turned counter-clockwise about z."""
    cos, sin = jnp.cos(angle_rad), jnp.sin(angle_rad)
    x, y = xyz[..., 0], xyz[..., 1]
    return jnp.stack([cos * x - sin * y, sin * x + cos * y, xyz[..., 2]], axis=-1)


def _cell_offsets(grid: int) -> Float[np.ndarray, "g 3"]:
    """Middles of grid x grid x grid cells of a box of length 1 about its middle; x slowest, z fastest."""
    return (np.stack(np.meshgrid(*[np.arange(grid)] * 3, indexing="ij"), -1).reshape(-1, 3) + 0.5) / grid - 0.5


def grid_points(rois: Float[Array, "*b r 7"], grid: int) -> Float[Array, "*b r g 3"]:
    """Middles of grid x grid x grid cells of each proposal, in `velo`; x slowest, z fastest."""
    offset = jnp.asarray(_cell_offsets(grid), rois.dtype).reshape((1,) * (rois.ndim - 1) + (-1, 3))
    local = offset * rois[..., None, 3:6]
    heading = jnp.broadcast_to(rois[..., None, 6], local.shape[:-1])
    return turn_about_z(local, heading) + rois[..., None, :3]


def cell_of(xyz: Float[Array, "q 3"], voxels: VoxelConfig, stride: int) -> Int[Array, "q 3"]:
    """Cell (z, y, x) that a point lies in, which may be outside the grid."""
    low = jnp.asarray(voxels.range_m[:3], jnp.float32)
    size = jnp.asarray(voxels.size_m, jnp.float32)
    size = jax.lax.optimization_barrier(jnp.broadcast_to(size, xyz.shape))  # a true division, see voxelize
    fine = jnp.floor((xyz - low[None]) / size).astype(jnp.int32)
    return (fine // stride)[:, ::-1]


def cell_centres(zyx: Int[Array, "*n 3"], voxels: VoxelConfig, stride: int) -> Float[Array, "*n 3"]:
    """Middles (x, y, z in metres) of cells."""
    lift = (1,) * (zyx.ndim - 1) + (3,)
    low = jnp.asarray(voxels.range_m[:3], jnp.float32).reshape(lift)
    size = jnp.asarray(voxels.size_m, jnp.float32).reshape(lift)
    return (zyx[..., ::-1].astype(jnp.float32) + 0.5) * (size * stride) + low


@lru_cache
def _rows_in_reach(reach: int, radius_m: float, cell_m: tuple[float, float, float]) -> Int[np.ndarray, "k 2"]:
    """Offsets (dz, dy) that can hold a cell within the radius of a point anywhere in the middle cell.

    Leaving out the others changes no answer: their cells are all too far.
    """
    near = [
        (dz, dy)
        for dz, dy in product(range(-reach, reach + 1), repeat=2)
        if (max(abs(dz) - 0.5, 0) * cell_m[2]) ** 2 + (max(abs(dy) - 0.5, 0) * cell_m[1]) ** 2
        # A thousandth more: rounding must not lose a cell that the query itself would call near.
        <= (1.001 * radius_m) ** 2
    ]
    return np.array(near, np.int32)


def _numbers(
    shape: Triple, lines: Int[np.ndarray, "k 2"], *, size_m: tuple[float, ...], low_m: tuple[float, ...]
) -> dict[str, np.ndarray]:
    """What the C++ is told of a query: the grid along z, y, x, the lines to look at, a cell's sides, a corner."""
    return {
        "shape": np.array(shape, np.int64),
        "lines": lines.astype(np.int64).reshape(-1),
        "size": np.array(size_m, np.float32),
        "corner": np.array(low_m, np.float32),
    }


def voxel_query(
    sites: Sites, xyz: Float[Array, "q 3"], voxels: VoxelConfig, *, stride: int, radius_m: float, config: RoiConfig
) -> tuple[Int[Array, "q s"], Bool[Array, " q"]]:
    """Rows of the first active voxels within the radius of each point, and whether there is any.

    Looked at are the cells up to `reach` away along each axis, z slowest, x fastest; what lacks repeats the first.
    """
    planes, rows, columns = sites.shape
    reach, count = config.reach, config.samples
    cell = cell_of(xyz, voxels, stride)
    size = tuple(float(s * stride) for s in voxels.size_m)
    lines = _rows_in_reach(reach, radius_m, size)
    if takes(sites.key, xyz, cell):
        result = integers(len(xyz), count), integers(len(xyz))
        about = _numbers(sites.shape, lines, size_m=size, low_m=voxels.range_m[:3])
        given = sites.key, jax.lax.stop_gradient(xyz), cell
        index, found = call("query", result, *given, **about, reach=reach, radius_squared=float(radius_m**2))
        return index, found > 0
    x = cell[:, 2]
    left, right = jnp.maximum(x - reach, 0), jnp.minimum(x + reach, columns - 1)
    slots = jnp.arange(count, dtype=jnp.int32)[None]

    def look(state: tuple[Array, Array], offset: Array) -> tuple[tuple[Array, Array], None]:
        neighbours, taken = state
        z, y = cell[:, 0] + offset[0], cell[:, 1] + offset[1]
        inside = (z >= 0) & (z < planes) & (y >= 0) & (y < rows) & (left <= right)
        start = jnp.where(inside, (z * rows + y) * columns, 0)
        # Keys rise along x, so that a row of cells is one stretch of the sites, found by one search.
        at = jnp.searchsorted(sites.key, start + left).astype(jnp.int32)
        for k in range(2 * reach + 1):  # a row's sites follow one another
            key = sites.key.at[at + k].get(mode="fill", fill_value=-1)
            column = key - start
            met = jnp.stack([z, y, column], axis=-1)
            off = xyz - cell_centres(met, voxels, stride)
            near = inside & (column >= left) & (column <= right) & ((off * off).sum(axis=-1) <= radius_m**2)
            # Into the next free slot; once all are taken, `taken` names none.
            neighbours = jnp.where(near[:, None] & (slots == taken[:, None]), (at + k)[:, None], neighbours)
            taken = taken + near.astype(jnp.int32)
        return (neighbours, taken), None

    none = jnp.zeros((len(xyz), count), jnp.int32), jnp.zeros(len(xyz), jnp.int32)
    (neighbours, taken), _ = jax.lax.scan(look, none, jnp.asarray(lines))
    return jnp.where(slots < taken[:, None], neighbours, neighbours[:, :1]), taken > 0


class VoxelPool(nnx.Module):
    """Pools one stride's voxel features at grid points: a point sees its voxels' features and their offsets."""

    def __init__(self, in_channels: int, width: int, *, rngs: nnx.Rngs):
        self.of_features, self.features_norm = Linear(in_channels, width, bias=False, rngs=rngs), BatchNorm(width)
        self.of_offset, self.offset_norm = Linear(3, width, bias=False, rngs=rngs), BatchNorm(width)
        self.out, self.out_norm = Linear(width, width, bias=False, rngs=rngs), BatchNorm(width)
        for layer in (self.of_features, self.of_offset, self.out):
            fan_in = layer.kernel[...].shape[0]  # He's normal values, as published
            layer.kernel[...] = (2 / fan_in) ** 0.5 * jax.random.normal(rngs.params(), layer.kernel[...].shape)

    def __call__(
        self,
        scale: SparseScale,
        xyz: Float[Array, "b q 3"],
        *,
        radius_m: float,
        voxels: VoxelConfig,
        config: RoiConfig,
        train: bool,
    ) -> Float[Array, "b q c"]:
        sites = scale.sites
        query = partial(voxel_query, voxels=voxels, stride=scale.stride, radius_m=radius_m, config=config)
        index, any_near = jax.vmap(query)(sites, jax.lax.stop_gradient(xyz))
        features = self.features_norm(self.of_features(scale.features), sites.valid, train=train)
        # A point without a voxel sees features and offset 0.
        near = any_near[..., None, None].astype(features.dtype)
        grouped = jax.vmap(lambda f, i: f[i])(features, index) * near
        centres = jax.vmap(lambda s, i: s[i])(cell_centres(sites.zyx, voxels, scale.stride), index)
        offset = (centres - xyz[:, :, None]) * near
        together = jax.nn.relu(grouped + self.offset_norm(self.of_offset(offset), train=train))
        return jax.nn.relu(self.out_norm(self.out(_pooled(together)), train=train))


def _pooled(grouped: Float[Array, "b q s c"]) -> Float[Array, "b q c"]:
    """The maximum over a query's samples; its gradient goes to the first of them.

    By its place: the gradient of `max` looks for the samples that equal the maximum, and finds none where XLA computes
    a sample twice and rounds it otherwise.
    """
    strongest = jnp.argmax(grouped, axis=2, keepdims=True)
    largest = jnp.arange(grouped.shape[2]).reshape(1, 1, -1, 1) == strongest
    return jnp.where(largest, grouped, 0).sum(axis=2)


class VoxelRoiHead(nnx.Module):
    """Score and box of each proposal from the voxel features inside and around it."""

    def __init__(self, config: RoiConfig, backbone: BackboneConfig, *, rngs: nnx.Rngs):
        self.config = config
        self.pools = nnx.List([VoxelPool(c, config.width, rngs=rngs) for c in backbone.widths[1:]])
        pooled, last = config.grid**3 * config.width * len(self.pools), config.layers[-1]
        self.shared = FullyConnected(pooled, config.layers, config.dropout, rngs=rngs)
        self.of_cls = FullyConnected(last, config.layers, config.dropout, rngs=rngs)
        self.of_box = FullyConnected(last, config.layers, config.dropout, rngs=rngs)
        self.cls, self.box = Linear(last, 1, rngs=rngs), Linear(last, BOX, rngs=rngs)
        for layer, deviation in ((self.cls, config.score_deviation), (self.box, 0.001)):
            layer.kernel[...] = deviation * jax.random.normal(rngs.params(), layer.kernel[...].shape)
            layer.bias[...] = jnp.zeros_like(layer.bias[...])

    def __call__(
        self, scales: list[SparseScale], rois: Float[Array, "b r 7"], voxels: VoxelConfig, *, key: Array | None
    ) -> tuple[Float[Array, "b r"], Float[Array, "b r 7"]]:
        """Logits and encoded boxes; with a key as in training."""
        b, r, _ = rois.shape
        points, train = grid_points(rois, self.config.grid).reshape(b, -1, 3), key is not None
        pooled = [
            pool(scale, points, radius_m=radius, voxels=voxels, config=self.config, train=train)
            for pool, scale, radius in zip(self.pools, scales, self.config.radii_m, strict=True)
        ]
        keys = [None] * 3 if key is None else list(jax.random.split(key, 3))
        shared = self.shared(jnp.concatenate(pooled, axis=-1).reshape(b, r, -1), key=keys[0])
        cls, box = self.cls(self.of_cls(shared, key=keys[1])), self.box(self.of_box(shared, key=keys[2]))
        return cls[..., 0], box
