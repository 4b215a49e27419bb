"""What stands in a street: houses, vehicles, lamps, signs, trees, people; m, yaw and facing in rad about z."""

from __future__ import annotations

import numpy as np

from benchmarks.blind.mitsuba import materials as m
from benchmarks.blind.mitsuba import shapes
from benchmarks.blind.mitsuba.street import (
    BUILDING,
    BUS,
    CAR,
    LIGHT,
    PERSON,
    POLE,
    SIGN,
    TRUCK,
    VEGETATION,
    Street,
)


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
    number, paint = s.new(), m.lacquer(s.level(kind, 0.4), s.lobe * rng.uniform(0.8, 1.2), rng.uniform(0.18, 0.3))
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


def lamp(s: Street, at: tuple[float, float]) -> None:
    number = s.new()
    s.add(shapes.pole((*at, 0), (*at, 5.5), 0.09), POLE, number, m.metal(0.45))
    s.add(shapes.ball((*at, 5.6), 0.28), LIGHT, number, m.lacquer(s.level(LIGHT), 0.3, 0.3))


def sign(s: Street, at: tuple[float, float], facing_rad: float) -> None:
    number, out = s.new(), np.array([np.cos(facing_rad), np.sin(facing_rad)]) * 0.06
    s.add(shapes.pole((*at, 0), (*at, 2.4), 0.04), POLE, number, m.metal(0.5))
    face = m.lacquer(s.level(SIGN), 0.2, 0.3)
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
