"""PENet's training in three stages: both branches, then the refinement on top of them, then everything.

Hu et al. 2021, section IV; losses, rates and augmentation of JUGGHM/PENet_ICRA2021 `main.py`, `helper.py`,
`dataloaders/kitti_loader.py`. What differs: the flip turns the camera too, crops move its principal point by what they
cut off (`exact` coordinates), the joint stage keeps the backbone's rate at a tenth of the rest, which the published
schedule overwrites, and the refinement is trained in the form in which it runs.
"""

from __future__ import annotations

from functools import partial
from typing import Any, Literal

import jax
import jax.numpy as jnp
import optax
from flax import nnx, struct
from jax import Array
from jaxtyping import Float

from jaxsim.config import DepthExperiment, Norms, Part, PenetConfig, Stage
from jaxsim.frame import DepthFrame
from jaxsim.prepare.depth.penet import check_crop
from jaxsim.prepare.depth.penet.layers import Mode
from jaxsim.prepare.depth.penet.network import Backbone
from jaxsim.prepare.depth.penet.published import create, definition
from jaxsim.weights import RUNNING, Values

_Loss = Literal["square", "huber"]


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
        rgb = batch.rgb.astype(jnp.float32)
        seen = network.coarse(rgb, batch.sparse_m, batch.given, intrinsics=batch.intrinsics, train=train)
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
    rgb = batch.rgb.astype(jnp.float32)
    seen = network.coarse(rgb, batch.sparse_m, batch.given, intrinsics=batch.intrinsics, train=False)
    return seen.fused if part == "branches" else network.refine(seen, batch.sparse_m, batch.given, train=False)
