"""Where surfaces stand: a street or a square. x forward, y left, z up; the sensor is above the origin."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import mitsuba as mi
import numpy as np

from benchmarks.blind.mitsuba import materials as m
from benchmarks.blind.mitsuba import shapes
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


def make_street(rng: np.random.Generator, lobe: float) -> Street:
    """A street or a square, drawn; `lobe` is what `materials.lacquer` calls strength."""
    street = Street(rng, lobe)
    (square if rng.random() < 0.35 else lane)(street)
    return street


def lane(s: Street) -> None:
    """A road with pavements, a row of houses on each side, parked and moving vehicles."""
    rng, half, walk = s.rng, s.rng.uniform(4.5, 8), s.rng.uniform(2, 4.5)
    asphalt = m.matte(m.noise_texture(rng, s.level(ROAD), 0.15, (60, 4)), 0.9)
    s.add(shapes.ground((0, 0), (260, 2 * half), 0.0), ROAD, 0, asphalt)
    grass = m.lambert(m.noise_texture(rng, s.level(TERRAIN), 0.25, (60, 60)))
    s.add(shapes.ground((0, 0), (400, 400), -0.05), TERRAIN, 0, grass)
    flags = m.matte(m.check_texture(s.level(SIDEWALK), s.level(SIDEWALK), (160, 3)), 0.8)
    paint = m.plastic(m.even(0.7), 0.45)
    for side in (-1, 1):
        s.add(shapes.box((0, side * (half + walk / 2)), (260, walk, 0.14), 0.0), SIDEWALK, 0, flags)
        s.add(shapes.ground((0, side * (half - 0.4)), (260, 0.15), 0.004), ROAD, 0, paint)
        row_of_houses(s, side, half + walk + rng.uniform(0.3, 3))
        x = rng.uniform(-60, -50)
        while x < 60:
            if rng.random() < 0.6 and abs(x) > 5:
                vehicle(s, (x, side * (half - 1.4)), rng.normal(0, 0.03) + (np.pi if side > 0 else 0))
            x += rng.uniform(5.5, 11)
        furniture(s, side, half, walk)
    for x in np.arange(-58, 58, 6.0):
        s.add(shapes.ground((x, 0), (3, 0.15), 0.004), ROAD, 0, paint)
    for x in (rng.uniform(9, 35), rng.uniform(-35, -9)):
        vehicle(s, (x, rng.choice([-1, 1]) * half * 0.3), rng.normal(0, 0.15))


def square(s: Street) -> None:
    """Paving within four rows of houses, with people, trees, a fountain and some vans."""
    rng, half = s.rng, s.rng.uniform(14, 28)
    tiles = m.matte(m.check_texture(s.level(ROAD), s.level(ROAD), (70, 70)), 0.85)
    s.add(shapes.ground((0, 0), (2 * half, 2 * half), 0.0), ROAD, 0, tiles)
    stone = m.matte(m.noise_texture(rng, s.level(SIDEWALK), 0.12, (50, 50)), 0.8)
    s.add(shapes.ground((0, 0), (400, 400), -0.02), SIDEWALK, 0, stone)
    for side in (-1, 1):
        row_of_houses(s, side, half + rng.uniform(2, 5))
        for x in rng.uniform(-half, half, 2):
            tree(s, (x, side * (half - 1)))
        across = side * rng.uniform(45, 80)
        house(s, (across, rng.normal(0, 4)), (14, 40, rng.uniform(8, 20)), np.pi if across > 0 else 0.0)
    basin = s.new()
    at = rng.uniform(7, 12) * np.array([1, rng.choice([-1, 1])]) * rng.choice([-1, 1], 2)
    marble = m.matte(m.noise_texture(rng, s.level(WALL), 0.1, (8, 1)), 0.6)
    s.add(shapes.pole((*at, 0), (*at, 0.7), 2.2), WALL, basin, marble)
    s.add(shapes.disc((*at, 0.69), 2.2, None), WALL, basin, m.matte(m.even(0.2), 0.5))
    s.add(shapes.ball((*at, 1.3), 0.7), WALL, basin, marble)
    for _ in range(int(rng.integers(6, 14))):
        free_spot(s, person, half - 2)
    for _ in range(int(rng.integers(2, 7))):
        free_spot(s, lambda street, xy: vehicle(street, xy, street.rng.uniform(-np.pi, np.pi)), half - 2)
    for k in range(8):
        lamp(s, (half * 0.8 * np.cos(k * np.pi / 4 + 0.3), half * 0.8 * np.sin(k * np.pi / 4 + 0.3)))


def free_spot(s: Street, thing: Any, reach_m: float) -> None:
    """Puts a thing somewhere, but not on the sensor's car."""
    at = s.rng.uniform(-reach_m, reach_m, 2)
    if np.hypot(*at) > 5:
        thing(s, tuple(at))


def row_of_houses(s: Street, side: int, away_m: float) -> None:
    """Houses along y = side * away_m that face the road, with some gaps that a wall or a hedge closes."""
    x, rng = -110.0, s.rng
    while x < 110:
        width, gap = rng.uniform(9, 24), rng.uniform(3, 9) if rng.random() < 0.3 else 0.0
        depth, back = 12.0, rng.uniform(0, 1.5)
        house(
            s,
            (x + width / 2, side * (away_m + back + depth / 2)),
            (width, depth, rng.uniform(5, 18)),
            -side * np.pi / 2,
        )
        if gap and rng.random() < 0.5:
            wall = m.matte(m.check_texture(s.level(WALL), s.level(WALL), (gap * 2, 8)), 0.8)
            s.add(shapes.box((x + width + gap / 2, side * (away_m + 1)), (gap, 0.3, 2.2), 0), WALL, s.new(), wall)
        elif gap:
            hedge(s, (x + width + gap / 2, side * (away_m + 1)), gap)
        x += width + gap


def house(s: Street, centre: tuple[float, float], size: tuple[float, float, float], facing_rad: float) -> None:
    """A cube with a wall of plaster or brick and rows of dark panes on its front."""
    rng, number = s.rng, s.new()
    level, wide = s.level(BUILDING), size[0] if abs(np.cos(facing_rad)) < 0.5 else size[1]
    if rng.random() < 0.5:
        texture = m.check_texture(level, level * rng.uniform(0.7, 0.9), (wide * 2, size[2] * 4))
    else:
        texture = m.noise_texture(rng, level, rng.uniform(0.08, 0.2), (wide / 4, size[2] / 4))
    s.add(shapes.box(centre, size, 0), BUILDING, number, m.matte(texture, rng.uniform(0.6, 1.0)))
    out = np.array([np.cos(facing_rad), np.sin(facing_rad)])
    along = np.array([-out[1], out[0]])
    front = np.array(centre) + out * ((size[1] if wide == size[0] else size[0]) / 2 + 0.02)
    glass = s.one_of("glass", lambda: m.plastic(m.even(rng.uniform(0.05, 0.12)), rng.uniform(0.3, 0.45)), 2)
    for floor in np.arange(1.9, size[2] - 1.2, 3.1):
        for t in np.arange(-wide / 2 + 1.6, wide / 2 - 1.0, 2.8):
            at = front + t * along
            s.add(shapes.pane((at[0], at[1], floor), (1.3, 1.5), facing_rad), BUILDING, number, glass)


def vehicle(s: Street, centre: tuple[float, float], yaw_rad: float) -> None:
    """A car, or in one of seven cases a van or a bus: a rounded body and cabin, panes, four wheels."""
    rng, draw = s.rng, s.rng.random()
    kind = CAR if draw < 0.85 else TRUCK if draw < 0.95 else BUS
    long, wide, high = {CAR: (4.4, 1.8, 0.95), TRUCK: (7.0, 2.3, 2.6), BUS: (11.0, 2.5, 2.7)}[kind]
    number, paint = s.new(), m.lacquer(s.level(kind, 0.4), s.lobe * rng.uniform(0.8, 1.2))
    turn = np.array([[np.cos(yaw_rad), -np.sin(yaw_rad)], [np.sin(yaw_rad), np.cos(yaw_rad)]])
    s.add(shapes.body((*centre, 0.3 + high / 2), (long, wide, high), yaw_rad), kind, number, paint)
    if kind == CAR:
        at = np.array(centre) + turn @ [-0.3, 0]
        s.add(shapes.body((*at, 1.3), (2.3, 1.55, 0.7), yaw_rad), kind, number, paint)
    tyre = m.lambert(m.even(0.06))
    for ahead in (-0.3, 0.3):
        for side in (-1, 1):
            hub = np.array(centre) + turn @ [ahead * long, side * (wide / 2 - 0.15)]
            rim = np.array(centre) + turn @ [ahead * long, side * (wide / 2 + 0.02)]
            s.add(shapes.pole((*hub, 0.32), (*rim, 0.32), 0.32), kind, number, tyre)
            s.add(shapes.disc((*rim, 0.32), 0.32, yaw_rad + side * np.pi / 2), kind, number, tyre)


def furniture(s: Street, side: int, half: float, walk: float) -> None:
    """Lamps, signs, trees, bins and people on a pavement."""
    rng = s.rng
    for x in np.arange(-70, 70, rng.uniform(16, 26)):
        lamp(s, (x, side * (half + 0.5)))
    for x in rng.uniform(-45, 45, int(rng.integers(1, 4))):
        sign(s, (x, side * (half + 0.6)), rng.choice([0.0, np.pi]))
    for x in rng.uniform(-60, 60, int(rng.integers(2, 8))):
        tree(s, (x, side * (half + walk * 0.6)))
    for x in rng.uniform(-30, 30, int(rng.integers(2, 8))):
        person(s, (x, side * (half + walk * 0.4)))
    if rng.random() < 0.5:
        x, number, steel = rng.uniform(-40, 20), s.new(), m.metal(0.5)
        s.add(shapes.box((x + 8, side * (half + 0.25)), (16, 0.06, 0.35), 0.6), FENCE, number, steel)


def lamp(s: Street, at: tuple[float, float]) -> None:
    number = s.new()
    s.add(shapes.pole((*at, 0), (*at, 5.5), 0.09), POLE, number, m.metal(0.45))
    s.add(shapes.ball((*at, 5.6), 0.28), LIGHT, number, m.lacquer(s.level(LIGHT), 0.3))


def sign(s: Street, at: tuple[float, float], facing_rad: float) -> None:
    number, out = s.new(), np.array([np.cos(facing_rad), np.sin(facing_rad)]) * 0.06
    s.add(shapes.pole((*at, 0), (*at, 2.4), 0.04), POLE, number, m.metal(0.5))
    face = m.lacquer(s.level(SIGN), 0.2)
    s.add(shapes.disc((at[0] + out[0], at[1] + out[1], 2.1), 0.4, facing_rad), SIGN, number, face)


def tree(s: Street, at: tuple[float, float]) -> None:
    rng, number, high = s.rng, s.new(), s.rng.uniform(2.2, 3.2)
    bark = m.matte(m.noise_texture(rng, 0.25, 0.2, (2, 6)), 0.95)
    s.add(shapes.pole((*at, 0), (*at, high), rng.uniform(0.1, 0.25)), VEGETATION, number, bark)
    wide = rng.uniform(1.2, 2.4)
    leaves = m.lambert(m.even(s.level(VEGETATION)))
    s.add(shapes.crown(rng, (*at, high + 0.8 * wide), (wide, wide, wide * 1.1)), VEGETATION, number, leaves)


def hedge(s: Street, at: tuple[float, float], long_m: float) -> None:
    leaves = m.lambert(m.even(s.level(VEGETATION)))
    s.add(shapes.crown(s.rng, (*at, 0.9), (long_m / 2, 0.8, 1.0)), VEGETATION, s.new(), leaves)


def person(s: Street, at: tuple[float, float]) -> None:
    number, coat = s.new(), m.cloth(m.even(s.level(PERSON, 0.4)))
    s.add(shapes.pole((*at, 0), (*at, 0.85), 0.16), PERSON, number, m.cloth(m.even(s.level(PERSON, 0.4))))
    s.add(shapes.body((*at, 1.15), (0.35, 0.5, 0.7), s.rng.uniform(-np.pi, np.pi)), PERSON, number, coat)
    s.add(shapes.ball((*at, 1.63), 0.13), PERSON, number, m.cloth(m.even(0.4)))
