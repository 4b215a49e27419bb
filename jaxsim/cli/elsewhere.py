"""A command on the workers of a cluster, each of which opens the run and the data set itself."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jaxsim.cluster import check_scheduler, spread, with_absolute_paths
from jaxsim.simulate.learned_sensor import LearnedSensor, load


class OnWorkers:
    """Flags of a command whose work workers of a cluster may share."""

    cluster: str | None
    """Address of their scheduler; none: the work is done here."""

    def maker(self, load_run: Callable[[Path], LearnedSensor]) -> Callable[[Any], Any]:
        """What does a piece of the work, with the learned sensor of a run."""
        raise NotImplementedError


@dataclass(frozen=True)
class Elsewhere:
    """The command on a worker of a cluster."""

    command: OnWorkers
    base: Path
    """The current folder of who gave the command, from which its run may name files."""

    def open(self) -> Callable[[Any], Any]:
        """What does a piece of the work."""
        return self.command.maker(self.load)

    def load(self, run: Path) -> LearnedSensor:
        """The learned sensor of a run whose relative paths begin at `base`."""
        learned = load(run)
        return LearnedSensor(with_absolute_paths(learned.run, self.base), learned.params)


def on_cluster(command: OnWorkers, *, by: str) -> Callable[[Sequence[Any]], Iterator[Any]] | None:
    """What has pieces of a command's work done by the workers of its cluster, and gives what became of each; None where
    it names no cluster. `by` begins the messages. Raises ValueError where the cluster does not answer."""
    address = command.cluster
    if not address:
        return None
    check_scheduler(address, by=by)
    job = with_absolute_paths(Elsewhere(command, Path.cwd()))
    return lambda items: (done.result for done in spread(address, job, items, by=by))
