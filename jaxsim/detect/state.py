"""Everything that the detector's training changes, as one pytree, and its optimiser."""

from __future__ import annotations

from functools import cache
from math import pi
from typing import Any

import jax
import jax.numpy as jnp
import optax
from flax import nnx, struct
from jaxtyping import Float

from jaxsim.config import DetectorExperiment, OneCycleConfig
from jaxsim.detect.layers import Statistic
from jaxsim.detect.network import VoxelRcnn
from jaxsim.frame import Array

Tree = Any


@struct.dataclass
class Network:
    """A network's values: nested dicts by attribute name, as the modules nest."""

    parameters: Tree
    statistics: Tree
    """Running means and variances of the batch norms."""


@struct.dataclass
class TrainState:
    """State of a run between two steps."""

    step: Array
    """int32: updates done."""
    network: Network
    optim: Tree


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
    return jax.tree.map(lambda leaf: leaf, _network_shapes(experiment))


@cache
def _network_shapes(experiment: DetectorExperiment) -> Network:
    return jax.eval_shape(lambda key: split(_make(experiment, key))[1], jax.random.key(0))


def create_state(experiment: DetectorExperiment, steps: int, seed: int) -> TrainState:
    """A fresh state for a training of so many steps; the same for the same seed."""
    return _compiled_create()(experiment, steps, jax.random.key(seed))


@cache
def _compiled_create() -> Any:
    # It runs once: on a CPU, LLVM would work on it several times as long as is saved.
    options = {"xla_backend_optimization_level": 0} if jax.default_backend() == "cpu" else None
    return jax.jit(_create, static_argnums=(0, 1), compiler_options=options)


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

    def init(parameters: Tree) -> Tree:
        zeros = jax.tree.map(jnp.zeros_like, parameters)
        return {"first": zeros, "second": zeros, "count": jnp.zeros((), jnp.int32)}

    def update(gradient: Tree, state: Tree, parameters: Tree) -> tuple[Tree, Tree]:
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
