"""A value with its interval, and how a verdict's parts become JSON."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from jaxsim.effects.region import Region


@dataclass(frozen=True)
class Interval:
    """A value and its 90 % interval."""

    value: float
    low: float
    high: float
    unit: str


def plain(value: Any) -> Any:
    """A part of a verdict as JSON has it: six digits, and null for what is not finite."""
    if isinstance(value, Region):
        return value.to_json()
    if hasattr(value, "__dataclass_fields__"):
        return {name: plain(getattr(value, name)) for name in value.__dataclass_fields__}
    if isinstance(value, dict):
        return {name: plain(one) for name, one in value.items()}
    if isinstance(value, tuple) and value and all(isinstance(one, Interval) for one in value):
        # A vector: one list for each part of its intervals.
        parts = {name: [plain(getattr(one, name)) for one in value] for name in ("value", "low", "high")}
        return {**parts, "unit": value[0].unit}
    if isinstance(value, (list, tuple)):
        return [plain(one) for one in value]
    if isinstance(value, (np.floating, float)):
        return float(f"{float(value):.6g}") if np.isfinite(value) else None
    return value.item() if isinstance(value, np.generic) else value
