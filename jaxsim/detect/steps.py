"""The detector's training step and the detector itself as jitted functions of plain pytrees."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jax.sharding import Mesh, NamedSharding

from jaxsim.config import DetectorExperiment
from jaxsim.detect.network import Detections
from jaxsim.detect.state import Network, TrainState, definition_of, join, one_cycle, optimiser, split
from jaxsim.devices import WHOLE

Array = Any
Metrics = dict[str, Array]


def make_train_step(
    experiment: DetectorExperiment, steps: int, *, mesh: Mesh | None = None
) -> Callable[[TrainState, dict[str, Array]], tuple[TrainState, Metrics]]:
    """Jitted (state, batch) -> (state, metrics) of a training of so many steps; the given state is donated.

    A batch is one of `SceneBatches`. Metrics are scalars: `loss/...` of each weighted term and `loss/total`; `lr`,
    `grad_norm`, `finite`, and `dropped/...`: points, voxels and sites of each stage left out for want of room, of the
    sample that lost most. On a `mesh` the batch is cut over the devices; batch norms and losses are those of the whole
    batch. Proposals and dropout are drawn from (run.seed, step).
    """
    definition, adam = definition_of(experiment), optimiser(experiment.optim, steps)

    def loss(parameters: Any, statistics: Any, batch: dict[str, Array], key: Array) -> tuple[Array, Any]:
        detector = join(definition, Network(parameters, statistics))
        terms, dropped = detector.losses(batch["points"], batch["valid"], batch["objects"], batch["is_object"], key)
        return sum(terms.values()), (terms, split(detector)[1].statistics, dropped)

    def train_step(state: TrainState, batch: dict[str, Array], seed: Array) -> tuple[TrainState, Metrics]:
        key = jax.random.fold_in(jax.random.wrap_key_data(seed), state.step)
        network = state.network
        (total, (terms, statistics, dropped)), gradient = jax.value_and_grad(loss, has_aux=True)(
            network.parameters, network.statistics, batch, key
        )
        updates, optim = adam.update(gradient, state.optim, network.parameters)
        metrics = {f"loss/{name}": term for name, term in terms.items()}
        metrics |= {"loss/total": total, "grad_norm": optax.tree.norm(gradient)}
        metrics["lr"], _ = one_cycle(experiment.optim, steps, state.step)
        metrics["finite"] = jnp.stack([jnp.isfinite(value) for value in metrics.values()]).all()
        dropped = {"points": batch["dropped_points"], **dropped}
        metrics |= {f"dropped/{name}": count.max() for name, count in dropped.items()}
        trained = Network(optax.apply_updates(network.parameters, updates), statistics)
        state = TrainState(state.step + 1, trained, optim)
        if mesh is not None:
            state = jax.lax.with_sharding_constraint(state, NamedSharding(mesh, WHOLE))
        return state, metrics

    jitted = jax.jit(train_step, donate_argnums=0)
    # an argument: as a constant it would have every seed compile a program of its own
    seed = np.asarray(jax.random.key_data(jax.random.key(experiment.run.seed)))
    return lambda state, batch: jitted(state, batch, seed)


@cache
def make_detect(
    experiment: DetectorExperiment,
) -> Callable[[Network, Array, Array], tuple[Detections, dict[str, Array]]]:
    """Jitted (network, points (b, p, 4), valid (b, p)) -> detections, and the voxels and sites left out."""
    definition = definition_of(experiment)
    return jax.jit(lambda network, points, valid: join(definition, network).detect(points, valid))
