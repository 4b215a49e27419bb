"""What training left out for want of room, counted at every step, whichever steps are logged."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import jax

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
