"""What an effect is to the generator: a plan made for one case, with hooks and the true parameters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from benchmarks.blind.hidden.frames import Hook, RayHook
from benchmarks.blind.hidden.laws import About


@dataclass
class Plan:
    """Hooks of one planted effect and its parameters in the catalogue's terms (lists are vectors)."""

    parameters: dict[str, Any]
    rays: list[RayHook] = field(default_factory=list)
    hooks: list[tuple[str, Hook]] = field(default_factory=list)


Maker = Callable[[float, np.random.Generator, About], Plan]


class Effect(NamedTuple):
    """A row of the vocabulary: channels it may change, what `amount` measures, minimal relevant amount, cap."""

    make: Maker
    channels: tuple[str, ...]
    amount: str
    floor: float
    cap: float = np.inf


def at(stage: str, hook: Hook, **parameters: Any) -> Plan:
    """A plan of one hook."""
    return Plan(parameters, hooks=[(stage, hook)])


def sign_of(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def centred(rng: np.random.Generator, size: int, sd: float) -> np.ndarray:
    """Normal values of exactly zero mean and that standard deviation: a level belongs to the other parameters."""
    x = rng.normal(0, 1, size)
    x = x - x.mean()
    return sd * x / max(x.std(), 1e-9)


def as_list(x: np.ndarray) -> list[float]:
    return [float(v) for v in x]
