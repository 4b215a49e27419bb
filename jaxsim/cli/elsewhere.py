"""A command on the workers of a cluster, each of which opens the run and the data set itself."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

from jaxsim.cluster import spread, with_absolute_paths
from jaxsim.simulate.sensor import LearnedSensor, load


@runtime_checkable
class Opens(Protocol):
    """Flags of a command whose work workers share."""

    def open(self, base: Path) -> Callable[[Any], Any]:
        """What does a piece of the work; `base` is the folder of who gave the command."""
        ...


@dataclass(frozen=True)
class Elsewhere:
    """The command on a worker of a cluster."""

    command: Opens
    base: Path
    """The current folder of who gave the command, from which its run may name files."""

    def open(self) -> Callable[[Any], Any]:
        """What does a piece of the work."""
        return self.command.open(self.base)


def on_cluster(items: Sequence[Any], *, address: str, command: Opens, by: str) -> Iterator[Any]:
    """What became of each piece of work, done by workers of the scheduler at `address`; `by` begins the messages."""
    job = with_absolute_paths(Elsewhere(command, Path.cwd()))
    return (done.result for done in spread(address, job, items, by=by))


def load_below(run: Path, base: Path) -> LearnedSensor:
    """The learned sensor of a run whose relative paths begin at `base`."""
    learned = load(run)
    return LearnedSensor(with_absolute_paths(learned.run, base), learned.params)
