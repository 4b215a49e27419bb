"""Checkpoints of a run, by step (orbax)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import orbax.checkpoint as ocp


class Checkpoints:
    """The training state, and the network that is used, by step (orbax).

    Plain arrays are written, whole: a checkpoint says nothing of the devices that made it, and fits any others. Of
    several processes one alone uses it.
    """

    def __init__(self, folder: Path, *, keep: int = 2):
        path, me = (folder / "checkpoints").resolve(), jax.process_index()
        path.mkdir(parents=True, exist_ok=True)
        options = ocp.CheckpointManagerOptions(
            max_to_keep=keep,
            create=False,  # orbax would wait for the other processes there
            enable_async_checkpointing=False,  # written before the call returns: what is announced exists
            multiprocessing_options=ocp.options.MultiprocessingOptions(primary_host=me, active_processes={me}),
        )
        self.manager = ocp.CheckpointManager(path, options=options)

    @property
    def latest(self) -> int | None:
        return self.manager.latest_step()

    @property
    def steps(self) -> list[int]:
        """Steps that are kept, rising."""
        return sorted(self.manager.all_steps())

    def save(self, step: int, **items: Any) -> None:
        """Keeps trees of arrays by name; one of them is `state`."""
        saved = {name: ocp.args.StandardSave(jax.tree.map(np.asarray, tree)) for name, tree in items.items()}
        self.manager.save(step, args=ocp.args.Composite(**saved), force=True)

    def restore(self, item: str, like: Any, *, step: int | None = None) -> Any:
        """An item of a step (by default the latest), in the structure of `like` (arrays or their shapes)."""
        step = self.latest if step is None else step
        if step is None:
            raise ValueError(f"run: no checkpoint in {self.manager.directory}; the training has not saved one yet")
        wanted = jax.tree.map(lambda x: np.broadcast_to(np.zeros((), x.dtype), x.shape), like)
        items = ocp.args.Composite(**{item: ocp.args.StandardRestore(wanted)})
        return jax.tree.map(jnp.asarray, self.manager.restore(step, args=items)[item])
