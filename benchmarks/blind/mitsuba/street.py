"""A street: shapes with their classes, their objects and their materials."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import mitsuba as mi
import numpy as np

from benchmarks.blind.mitsuba.materials import Material

ROAD, SIDEWALK, BUILDING, WALL, FENCE, POLE, LIGHT, SIGN = 7, 8, 11, 12, 13, 17, 19, 20
VEGETATION, TERRAIN, SKY, PERSON, CAR, TRUCK, BUS = 21, 22, 23, 24, 26, 27, 28
VEHICLES = (CAR, TRUCK, BUS)

ALBEDO = {
    ROAD: 0.16, SIDEWALK: 0.28, BUILDING: 0.36, WALL: 0.3, FENCE: 0.32, SIGN: 0.5, LIGHT: 0.4, VEGETATION: 0.5,
    TERRAIN: 0.34, PERSON: 0.3, CAR: 0.3, TRUCK: 0.45, BUS: 0.4,
}  # fmt: skip
"""Near-infrared albedo, in the middle of each class."""


@dataclass
class Street:
    """Shapes with, in the same order, their class, their object's number (0 none) and their material."""

    rng: np.random.Generator
    lobe: float
    """How much brighter than its base a car's coat is, head on."""
    shapes: list[Any] = field(default_factory=list)
    semantic: list[int] = field(default_factory=list)
    instance: list[int] = field(default_factory=list)
    material: list[Material] = field(default_factory=list)
    objects: int = 0
    shelf: dict[Any, list[Material]] = field(default_factory=dict)

    def one_of(self, kind: Any, make: Callable[[], Material], count: int = 1) -> Material:
        """A material of the kind, one of `count` that are made once: coats take Mitsuba a tenth of a second each."""
        if kind not in self.shelf:
            self.shelf[kind] = [make() for _ in range(count)]
        return self.shelf[kind][self.rng.integers(count)]

    def add(self, shape: Any, semantic: int, instance: int, material: Material) -> None:
        self.shapes.append(shape)
        self.semantic.append(semantic)
        self.instance.append(instance)
        self.material.append(material)

    def new(self) -> int:
        """The number of another object."""
        self.objects += 1
        return self.objects

    def level(self, semantic: int, spread: float = 0.25) -> float:
        """An albedo of the class, lognormal."""
        return float(ALBEDO[semantic] * np.exp(self.rng.normal(0, spread)))

    def scene(self) -> Any:
        """All shapes as a scene of Mitsuba; a shape's id is its number."""
        return mi.load_dict({"type": "scene", **{str(k): shape for k, shape in enumerate(self.shapes)}})
