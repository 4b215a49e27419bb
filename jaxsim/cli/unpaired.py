"""Which flags of `jaxsim discover` do not go with --unpaired."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

NOT_UNPAIRED = {
    "run": "but a run's frames are simulated on the measured streets; give --measured and --simulated instead of it",
    "lambert": "which has the measured streets; leave it out",
    "every_frame": "which judges what was named frame by frame; leave it out",
    "nulls": "which exchanges scenes between the sides to see what chance does; leave one of them out",
    "effects_from": "which tells effects of the catalogue alone; leave it out",
    "effects": "which compares the frames as they are; leave it out, or simulate the frames with them "
    "(`jaxsim simulate --effects`)",
}
"""Flags that do not go with --unpaired, and why."""


def check_unpaired(flags: Mapping[str, Any]) -> None:
    """Raises ValueError for the first flag of NOT_UNPAIRED that came with --unpaired."""
    for flag, why in NOT_UNPAIRED.items():
        if flags["unpaired"] and flags[flag]:
            name = "a run" if flag == "run" else f"--{flag.replace('_', '-')}"
            raise ValueError(f"discover: {name} came with --unpaired, {why}")
