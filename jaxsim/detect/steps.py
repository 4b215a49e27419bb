"""Everything that the detector's training changes, as one pytree, with its optimiser; the training step and the
detector itself as jitted functions of plain pytrees; and what training left out for want of room.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from math import pi
from typing import Any

import jax
import jax.numpy as jnp
import optax
from flax import nnx, struct
from jax.sharding import Mesh, NamedSharding
from jaxtyping import Float, PyTree

from jaxsim.compilation import compiled_to_run_once
from jaxsim.config import DetectorExperiment, OneCycleConfig
from jaxsim.detect.layers import Statistic
from jaxsim.detect.network import Detections, VoxelRcnn
from jaxsim.devices import WHOLE
from jaxsim.frame import Array

PREFIX = "dropped/"
REMEDIES = {
    "points": "--voxels.max-points",
    "voxels": "--voxels.max-voxels-train",
    "conv2": "--voxels.growth",
    "conv3": "--voxels.growth",
    "conv4": "--voxels.growth",
    "out": "--voxels.growth",
}
"""Which flag makes room for what."""


@struct.dataclass
class Network:
    """A network's values: nested dicts by attribute name, as the modules nest."""

    parameters: PyTree
    statistics: PyTree
    """Running means and variances of the batch norms."""


@struct.dataclass
class TrainState:
    """State of a run between two steps."""

    step: Array
    """int32: updates done."""
    network: Network
    optim: PyTree


def split(module: nnx.Module) -> tuple[Any, Network]:
    """Definition and values of a module."""
    definition, parameters, statistics = nnx.split(module, nnx.Param, Statistic)
    return definition, Network(nnx.to_pure_dict(parameters), nnx.to_pure_dict(statistics))


def join(definition: Any, network: Network) -> Any:
    """The module of a definition with these values."""
    return nnx.merge(definition, network.parameters, network.statistics)


def _make(experiment: DetectorExperiment, key: Array | int) -> VoxelRcnn:
    return VoxelRcnn(experiment.detector, experiment.voxels, rngs=nnx.Rngs(key))


def definition_of(experiment: DetectorExperiment) -> Any:
    """The detector without values."""
    return nnx.graphdef(nnx.eval_shape(lambda: _make(experiment, 0)))


def network_shapes(experiment: DetectorExperiment) -> Network:
    """Shapes and types of a network's values."""
    # A copy: dicts from a cache are shared by all who ask.
    return jax.tree.map(lambda leaf: leaf, _network_shapes(experiment))


@cache
def _network_shapes(experiment: DetectorExperiment) -> Network:
    return jax.eval_shape(lambda key: split(_make(experiment, key))[1], jax.random.key(0))


def create_state(experiment: DetectorExperiment, steps: int, seed: int) -> TrainState:
    """A fresh state for a training of so many steps; the same for the same seed."""
    return compiled_to_run_once(_create, (0, 1))(experiment, steps, jax.random.key(seed))


def _create(experiment: DetectorExperiment, steps: int, key: Array) -> TrainState:
    _, network = split(_make(experiment, key))
    adam = optimiser(experiment.optim, steps)
    return TrainState(jnp.zeros((), jnp.int32), network, adam.init(network.parameters))


def one_cycle(config: OneCycleConfig, steps: int, step: Array) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Rate and first beta of update `step` of `steps` (fastai's one-cycle policy, OpenPCDet's `OneCycle`).

    Half cosines: the rate from lr / div_factor up to lr in the first `pct_start` of the steps and down to 1e-4 of
    where it began; the first beta down and up again.
    """
    low = config.lr / config.div_factor
    high_beta, low_beta = config.momenta
    turn = int(steps * config.pct_start)
    rising = jnp.asarray(step) < turn
    share = jnp.where(rising, step / max(turn, 1), (step - turn) / max(steps - turn, 1))
    down = (1 + jnp.cos(pi * share)) / 2  # 1 to 0
    rate = jnp.where(rising, config.lr + (low - config.lr) * down, low * 1e-4 + (config.lr - low * 1e-4) * down)
    beta = jnp.where(rising, low_beta + (high_beta - low_beta) * down, high_beta + (low_beta - high_beta) * down)
    return rate, beta


def optimiser(config: OneCycleConfig, steps: int) -> optax.GradientTransformation:
    """Clipping by norm, then Adam with the cycle above and decoupled decay of every parameter, before the update."""

    def init(parameters: PyTree) -> PyTree:
        zeros = jax.tree.map(jnp.zeros_like, parameters)
        return {"first": zeros, "second": zeros, "count": jnp.zeros((), jnp.int32)}

    def update(gradient: PyTree, state: PyTree, parameters: PyTree) -> tuple[PyTree, PyTree]:
        rate, beta = one_cycle(config, steps, state["count"])
        norm = optax.tree.norm(gradient)
        gradient = jax.tree.map(lambda g: g * jnp.minimum(1.0, config.clip / (norm + 1e-6)), gradient)
        count = state["count"] + 1
        first = jax.tree.map(lambda m, g: beta * m + (1 - beta) * g, state["first"], gradient)
        second = jax.tree.map(lambda v, g: config.beta2 * v + (1 - config.beta2) * g * g, state["second"], gradient)
        # PyTorch corrects by the beta of this step to the power of the count, whatever the betas before it were.
        first_scale = 1 / (1 - beta ** count.astype(jnp.float32))
        second_scale = 1 / (1 - config.beta2 ** count.astype(jnp.float32))
        updates = jax.tree.map(
            lambda p, m, v: (
                -rate * (config.weight_decay * p) - rate * m * first_scale / (jnp.sqrt(v * second_scale) + 1e-8)
            ),
            parameters,
            first,
            second,
        )
        return updates, {"first": first, "second": second, "count": count}

    return optax.GradientTransformation(init, update)  # type: ignore[arg-type]


def make_train_step(
    experiment: DetectorExperiment, steps: int, *, mesh: Mesh | None = None
) -> Callable[[TrainState, dict[str, Array]], tuple[TrainState, dict[str, Array]]]:
    """Jitted (state, batch) -> (state, metrics) of a training of so many steps; the given state is donated.

    A batch is one of `SceneBatches`. Metrics are scalars: `loss/...` of each weighted term and `loss/total`; `lr`,
    `grad_norm`, `finite`, and `dropped/...`: points, voxels and sites of each stage left out for want of room, of the
    sample that lost most. On a `mesh` the batch is cut over the devices; batch norms and losses are those of the whole
    batch. Proposals and dropout are drawn from (run.seed, step).
    """
    definition, adam = definition_of(experiment), optimiser(experiment.optim, steps)

    def train_step(state: TrainState, batch: dict[str, Array], seed: Array) -> tuple[TrainState, dict[str, Array]]:
        # Of the step alone: a resumed run draws what an unstopped one would have drawn.
        key = jax.random.fold_in(jax.random.wrap_key_data(seed), state.step)
        network = state.network
        given = {name: batch[name] for name in ("points", "valid", "objects", "is_object")}

        def loss(parameters: Any) -> tuple[Array, Any]:
            detector = join(definition, Network(parameters, network.statistics))
            terms, dropped = detector.losses(**given, key=key)
            return sum(terms.values()), (terms, split(detector)[1].statistics, dropped)

        (total, (terms, statistics, dropped)), gradient = jax.value_and_grad(loss, has_aux=True)(network.parameters)
        updates, optim = adam.update(gradient, state.optim, network.parameters)
        metrics = {f"loss/{name}": term for name, term in terms.items()}
        metrics |= {"loss/total": total, "grad_norm": optax.tree.norm(gradient)}
        metrics["lr"], _ = one_cycle(experiment.optim, steps, state.step)
        metrics["finite"] = jnp.stack([jnp.isfinite(value) for value in metrics.values()]).all()
        dropped = {"points": batch["dropped_points"], **dropped}
        metrics |= {f"{PREFIX}{name}": count.max() for name, count in dropped.items()}
        trained = Network(optax.apply_updates(network.parameters, updates), statistics)
        state = TrainState(state.step + 1, trained, optim)
        if mesh is not None:
            # Whole on every device, as it came in: in another layout the next step would be compiled anew.
            state = jax.lax.with_sharding_constraint(state, NamedSharding(mesh, WHOLE))
        return state, metrics

    jitted = jax.jit(train_step, donate_argnums=0)
    # an argument: as a constant it would have every seed compile a program of its own
    seed = jax.device_get(jax.random.key_data(jax.random.key(experiment.run.seed)))
    return lambda state, batch: jitted(state, batch, seed)


@cache
def make_detect(
    experiment: DetectorExperiment,
) -> Callable[[Network, Array, Array], tuple[Detections, dict[str, Array]]]:
    """Jitted (network, points (b, p, 4), valid (b, p)) -> detections, and the voxels and sites left out."""
    definition = definition_of(experiment)
    return jax.jit(lambda network, points, valid: join(definition, network).detect(points, valid))


class LeftOut:
    """The most that one scene lost, by what it lost: since the log's last line, and in all steps seen."""

    def __init__(self) -> None:
        self.recent: dict[str, int] = {}
        self.worst: dict[str, int] = {}
        self.steps, self.seen = 0, 0

    def see(self, metrics: Mapping[str, Any]) -> None:
        """Counts the `dropped/...` of one step; other metrics say nothing here."""
        counts = jax.device_get({name: value for name, value in metrics.items() if name.startswith(PREFIX)})
        lost = {name.removeprefix(PREFIX): int(count) for name, count in counts.items()}
        self.seen += 1
        self.steps += any(lost.values())
        for name, count in lost.items():
            self.recent[name] = max(self.recent.get(name, 0), count)
            self.worst[name] = max(self.worst.get(name, 0), count)

    def take(self) -> dict[str, float]:
        """The `dropped/...` of a line of the log: the most since the line before."""
        taken, self.recent = {f"{PREFIX}{name}": float(count) for name, count in self.recent.items()}, {}
        return taken

    def words(self) -> str:
        """What was lost and which flags help; empty where nothing was."""
        lost = {name: count for name, count in self.worst.items() if count}
        if not lost:
            return ""
        most = ", ".join(f"{count} of {name}" for name, count in lost.items())
        flags = ", ".join(dict.fromkeys(REMEDIES[name] for name in lost))
        return f"no room for all of a scene in {self.steps} of {self.seen} steps; most left out: {most}; raise {flags}"
