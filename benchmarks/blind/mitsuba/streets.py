"""Where things stand: along a street or in a square. x forward, y left, z up; the sensor is above the origin."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.blind.mitsuba import materials as m
from benchmarks.blind.mitsuba import shapes
from benchmarks.blind.mitsuba.street import FENCE, ROAD, SIDEWALK, TERRAIN, WALL, Street
from benchmarks.blind.mitsuba.things import hedge, house, lamp, person, sign, tree, vehicle


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
