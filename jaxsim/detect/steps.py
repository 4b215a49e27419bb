"""The detector's training step and the detector itself as jitted functions of plain pytrees; and what training left
out for want of room."""

from __future__ import annotations

from collections.abc import Callable, Mapping
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
from jaxsim.frame import Array

Metrics = dict[str, Array]
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

    def train_step(state: TrainState, batch: dict[str, Array], seed: Array) -> tuple[TrainState, Metrics]:
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
    seed = np.asarray(jax.random.key_data(jax.random.key(experiment.run.seed)))
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
