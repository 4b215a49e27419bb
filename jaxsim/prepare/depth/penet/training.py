"""PENet's training in three stages: both branches, then the refinement on top of them, then everything; and the frames
that it learns from.

Hu et al. 2021, section IV; losses, rates and augmentation of JUGGHM/PENet_ICRA2021 `main.py`, `helper.py`,
`dataloaders/kitti_loader.py`. What differs: the flip turns the camera too, crops move its principal point by what they
cut off (`exact` coordinates), the joint stage keeps the backbone's rate at a tenth of the rest, which the published
schedule overwrites, and the refinement is trained in the form in which it runs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any, Literal

import jax
import jax.numpy as jnp
import numpy as np
import optax
from flax import nnx, struct
from jax import Array
from jaxtyping import Float

from jaxsim.config import DepthExperiment, Norms, Part, PenetConfig, Stage
from jaxsim.files import placed
from jaxsim.frame import DepthFrame, Frame
from jaxsim.geometry import pad_cloud
from jaxsim.geometry.camera import crop_depth_frame, cut_depth_frame
from jaxsim.prepare.depth import sparse_depth
from jaxsim.prepare.depth.ip_basic import fill_in_multiscale
from jaxsim.prepare.depth.penet import check_crop
from jaxsim.prepare.depth.penet.layers import Mode
from jaxsim.prepare.depth.penet.network import Backbone
from jaxsim.prepare.depth.penet.published import create, definition
from jaxsim.weights import RUNNING, Values

_Loss = Literal["square", "huber"]
TRUTH_REACH_M = 120.0
"""True depth beyond a LiDAR's reach is left out, as no sweep could tell it; it would rule a squared error."""


def depth_frame(frame: Frame, crop: tuple[int, int]) -> DepthFrame:
    """A renderer's frame, its bottom rows and middle columns: the sweep's points in the image, and the rendered depth.

    Raises ValueError where the frame has no cloud or no depth, or is smaller than the crop.
    """
    view, cloud = frame.camera, frame.cloud
    if cloud is None or view.depth_m is None or view.depth_valid is None:
        raise ValueError(
            f"depth: {frame.name} has {'no LiDAR sweep' if cloud is None else 'no true depth'}; depth completion "
            "learns from frames that have both (the embedded world; KITTI's depth completion set, --depth-root)"
        )
    sparse_m, given = jax.device_get(sparse_depth(pad_cloud(cloud), view.camera, view.rgb.shape[:2]))
    known = np.asarray(view.depth_valid) & (np.asarray(view.depth_m) < TRUTH_REACH_M)
    whole = DepthFrame(view.rgb, sparse_m, given, view.depth_m, known, view.camera.intrinsics)
    with placed(f"depth: {frame.name}", then="lower --image-crop"):
        return crop_depth_frame(whole, crop)


def where_backed(frame: DepthFrame) -> DepthFrame:
    """The frame (host), its truth known only where the sweep's points back a pixel, as in KITTI's set: above the top
    line nothing says how far a facade is, and no completed depth is used there (`Penet`)."""
    backed = fill_in_multiscale(np.asarray(frame.sparse_m), np.asarray(frame.given))[1]
    return replace(frame, known=frame.known & backed)


def augment_frame(frame: DepthFrame, stage: Stage, config: PenetConfig, *, rng: np.random.Generator) -> DepthFrame:
    """A frame (host) cropped, mirrored and recoloured at random, its intrinsics with it.

    Raises ValueError where the stage's crop is larger than the frame.
    """
    rows, columns = frame.sparse_m.shape
    if stage.crop[0] > rows or stage.crop[1] > columns:
        raise ValueError(
            f"penet: the frame has {rows} x {columns} pixels, the {stage.part} stage crops {stage.crop[0]} x "
            f"{stage.crop[1]} out of it; lower that crop (penet.stages), or raise --image-crop"
        )
    top = int(rng.integers(0, rows - stage.crop[0] + 1))
    left = int(rng.integers(0, columns - stage.crop[1] + 1))
    part = cut_depth_frame(frame, top, left, size=stage.crop)
    if config.flip and rng.random() < 0.5:
        # Pixel centres are whole numbers: the mirror of u is w - 1 - u.
        part.intrinsics[0, 2] = stage.crop[1] - 1 - part.intrinsics[0, 2]
        rasters = (part.rgb, part.sparse_m, part.given, part.truth_m, part.known)
        part = DepthFrame(*[raster[:, ::-1] for raster in rasters], intrinsics=part.intrinsics)
    if config.jitter:
        part = replace(part, rgb=_recoloured(part.rgb, 1 + config.jitter * rng.uniform(-1, 1, 3)))
    return part


def _recoloured(rgb: np.ndarray, factors: np.ndarray) -> np.ndarray:
    """Brightness, contrast, saturation times these."""
    brightness, contrast, saturation = np.asarray(factors, np.float32)
    x = rgb.astype(np.float32) * brightness
    # Contrast about the image's mean, saturation about each pixel's grey.
    x = x.mean() + (x - x.mean()) * contrast
    grey = (x @ np.array([0.299, 0.587, 0.114], np.float32))[..., None]
    return np.clip(np.round(grey + (x - grey) * saturation), 0, 255).astype(np.uint8)


class Batches:
    """All batches of a training, stage after stage: batch k depends on (seed, k) alone, so a resumed run sees what an
    uninterrupted one would."""

    def __init__(self, frames: Sequence[DepthFrame], config: PenetConfig, seed: int):
        """Raises ValueError where the frames do not fill a batch of some stage."""
        for stage in config.stages:
            if len(frames) < stage.batch:
                raise ValueError(
                    f"penet: {len(frames)} training frames do not fill the {stage.part} stage's batch of {stage.batch}"
                )
        self.frames = frames
        self.config = config
        self.seed = seed
        # An epoch's last, smaller batch is left out.
        self.steps = [len(frames) // stage.batch for stage in config.stages]
        self.ends = np.cumsum([stage.epochs * n for stage, n in zip(config.stages, self.steps, strict=True)])

    def __len__(self) -> int:
        return int(self.ends[-1])

    def place(self, k: int) -> tuple[int, int, int]:
        """Number of the stage that batch k belongs to, epoch of the stage, and place in the epoch; from 0."""
        number = int(np.searchsorted(self.ends, k, side="right"))
        within = k - (int(self.ends[number - 1]) if number else 0)
        return number, *divmod(within, self.steps[number])

    def __getitem__(self, k: int) -> DepthFrame:
        number, epoch, index = self.place(k)
        stage = self.config.stages[number]
        of_epoch = [self.seed, number, epoch]
        order = np.random.default_rng(of_epoch).permutation(len(self.frames))
        chosen = [int(i) for i in order[index * stage.batch : (index + 1) * stage.batch]]
        parts = [
            augment_frame(self.frames[i], stage, self.config, rng=np.random.default_rng([*of_epoch, i])) for i in chosen
        ]
        return jax.tree.map(lambda *column: np.stack(column), *parts)


def check_sizes(experiment: DepthExperiment) -> None:
    """Raises ValueError where the network cannot take a crop, or a stage's is larger than the image's: of any stage,
    before the first begins."""
    check_crop(experiment.image_crop, "--image-crop")
    for number, stage in enumerate(experiment.penet.stages):
        flag = f"--penet.stages.{number}.crop"
        check_crop(stage.crop, flag)
        if stage.crop[0] > experiment.image_crop[0] or stage.crop[1] > experiment.image_crop[1]:
            raise ValueError(
                f"penet: the {stage.part} stage cuts {stage.crop[0]} x {stage.crop[1]} pixels out of images of "
                f"{experiment.image_crop[0]} x {experiment.image_crop[1]}; lower {flag}, or raise --image-crop"
            )


@struct.dataclass
class PenetState:
    """All that training changes."""

    step: Any
    """int32: updates done, over all stages. Checkpoints are read into it from leaves that are no arrays yet."""
    values: Values
    optim: Any


def optimiser(config: PenetConfig) -> optax.GradientTransformation:
    """Adam with decay in the gradient; the rate is applied by the step."""
    return optax.chain(
        optax.add_decayed_weights(config.weight_decay),
        optax.scale_by_adam(b1=config.betas[0], b2=config.betas[1], eps=1e-8),
    )


def create_state(config: PenetConfig, seed: int) -> PenetState:
    """A fresh state; the same for the same seed."""
    values = create(config.width, seed)
    if config.start_m:
        for name in ("rgb_decoder_output", "decoder_layer6"):
            # Channel 0 is depth: both heads begin at `start_m`, spread by as much.
            norm = values["backbone"][name]["norm"]
            norm["bias"][0], norm["weight"][0] = config.start_m, config.start_m
    values = jax.tree.map(jnp.asarray, values)
    return PenetState(jnp.zeros((), jnp.int32), values, optimiser(config).init(values))


def begin_stage(state: PenetState, config: PenetConfig) -> PenetState:
    """The optimiser anew, as each of the published stages is a training of its own."""
    return PenetState(state.step, state.values, optimiser(config).init(state.values))


def rate(config: PenetConfig, stage: Stage, epoch: int) -> float:
    """Learning rate in an epoch (0, 1, ...) of a stage."""
    # The last step of the staircase that has begun.
    shares = [share for start, share in stage.falls if epoch >= start]
    return config.lr * (shares[-1] if shares else 1.0)


def branch_weight(epoch: int) -> float:
    """Weight of each branch's own loss; what both leave of 1 is the fused depth's."""
    return 0.2 if epoch <= 1 else 0.05 if epoch <= 3 else 0.0


def masked_error(guess_m: Array, batch: DepthFrame, loss: _Loss = "square") -> Array:
    """Mean squared error, m², over pixels whose depth is known; Huber's takes 2|e| - 1 where an error e exceeds 1 m."""
    off = jnp.abs(guess_m - batch.truth_m)
    error = off**2 if loss == "square" else jnp.where(off < 1, off**2, 2 * off - 1)
    return jnp.where(batch.known, error, 0.0).sum() / jnp.maximum(batch.known.sum(dtype=jnp.float32), 1.0)


def branches_error(seen: Backbone, batch: DepthFrame, weight: Array, *, loss: _Loss) -> Array:
    """The loss of `branches`: `weight` is that of each branch's own error, what is left of 1 the fused depth's."""
    # The branches' own errors keep either from leaving all to the other while both are young.
    apart = masked_error(seen.colour, batch, loss) + masked_error(seen.depth, batch, loss)
    return (1 - 2 * weight) * masked_error(seen.fused, batch, loss) + weight * apart


@partial(jax.jit, static_argnames=("config", "part", "norms"), donate_argnames="state")
def train_step(
    state: PenetState,
    batch: DepthFrame,
    lr: Array,
    *,
    weight: Array,
    config: PenetConfig,
    part: Part,
    norms: Norms = "batch",
) -> tuple[PenetState, dict[str, Array]]:
    """One update at this rate; `weight` is that of each branch's own loss (in `branches` alone).

    A batch that is cut over devices is one batch all the same: its loss and its norms' statistics are those of all
    its items (the published program, in `DataParallel`, has each device's own statistics).
    """
    frozen = definition(config.width, "exact")
    train: Mode = {"batch": True, "renorm": "renorm", "stored": False}[norms]

    def loss_of(values: Values) -> tuple[Array, tuple[Values, Array]]:
        network = nnx.merge(frozen, values)
        seen = network.coarse(batch.rgb, batch.sparse_m, batch.given, intrinsics=batch.intrinsics, train=train)
        if part == "branches":
            guess = seen.fused
            loss = branches_error(seen, batch, weight, loss=config.loss)
        else:
            guess = network.refine(seen, batch.sparse_m, batch.given, train=train)
            loss = masked_error(guess, batch, config.loss)
        return loss, (nnx.to_pure_dict(nnx.state(network)), masked_error(guess, batch))

    (loss, (after, square)), gradient = jax.value_and_grad(loss_of, has_aux=True)(state.values)
    change, optim = optimiser(config).update(gradient, state.optim, state.values)

    # Shares of the rate: each of the first two stages moves its own part alone.
    of_backbone = {"branches": 1.0, "refinement": 0.0, "joint": config.backbone_lr}[part]
    of_rest = {"branches": 0.0, "refinement": 1.0, "joint": 1.0}[part]

    def updated(path: Any, old: Array, *news: Array) -> Array:
        """Statistics are what the batches were; parameters move where the stage lets them."""
        new, delta = news
        if path[-1].key in RUNNING:
            return new
        share = of_backbone if path[0].key == "backbone" else of_rest
        # Not 0 times a change: a part that stands still stays the same whatever its gradient is, NaN too.
        return old - lr * share * delta if share else old

    values = jax.tree.map_with_path(updated, state.values, after, change)
    metrics = {"loss/depth": loss, "rmse_m": jnp.sqrt(square), "grad_norm": optax.tree.norm(gradient), "lr": lr}
    metrics["finite"] = jnp.isfinite(loss) & jnp.isfinite(metrics["grad_norm"])
    return PenetState(state.step + 1, values, optim), metrics


@partial(jax.jit, static_argnames=("config", "part"))
def predict(values: Values, batch: DepthFrame, *, config: PenetConfig, part: Part) -> Float[Array, "b h w"]:
    """Dense depth after a stage: of the fused branches, or refined."""
    network = nnx.merge(definition(config.width, "exact"), values)
    seen = network.coarse(batch.rgb, batch.sparse_m, batch.given, intrinsics=batch.intrinsics, train=False)
    return seen.fused if part == "branches" else network.refine(seen, batch.sparse_m, batch.given, train=False)
