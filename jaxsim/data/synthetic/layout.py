"""Lays out one street: its shape, its weather, and what stands where; `traffic` has who parks, drives and walks.

A street's middle is y = c x^2 / 2 in `world`; traffic keeps right. A place along it is (x, aside): aside is measured
to the left of the middle. A drive takes a second: the ego car starts at x = 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jaxsim.data.synthetic import surroundings
from jaxsim.data.synthetic.light import Light
from jaxsim.data.synthetic.scene import FROM_M, TO_M, Parts, Plan, Thing, gather
from jaxsim.data.synthetic.street import SIDE_STREETS, Street
from jaxsim.data.synthetic.traffic import STATISTICS, Statistics, drive_along, park_along, park_in_side_streets, walk


@dataclass(frozen=True)
class Drive:
    """One street with everything on it, at time 0."""

    street: Street
    light: Light
    things: tuple[Thing, ...]
    parts: Parts
    ego_aside_m: float
    ego_speed_mps: float


def lay_out(seed: int, drive: int, streets: str = "town") -> Drive:
    """The street of a drive: a function of its arguments alone. `streets` is one of STATISTICS."""
    statistics, rng = STATISTICS[streets], np.random.default_rng([seed, drive])
    plan = Plan(rng, _street(rng, statistics))
    light = _light(rng)
    speed = float(rng.uniform(3.0, 12.0))
    width = float(plan.street.half_width_m)
    parking = float(plan.street.parking) > 0.5
    lane = width - (2.25 if parking else 0.0)
    # Traffic keeps right, where aside is negative.
    ego = -0.5 * lane
    urban = rng.random() < statistics.urban
    _houses(plan, urban=bool(urban))
    _posts(plan)
    _greenery(plan, density=float(rng.uniform(0.2, 1.0)))
    if parking:
        park_along(plan, statistics)
    else:
        park_in_side_streets(plan, statistics)
    drive_along(plan, statistics, lane_m=lane, ego_mps=speed)
    walk(plan, urban=bool(urban))
    things = tuple(plan.things)
    return Drive(plan.street, light, things, gather(things), ego, speed)


def _street(rng: np.random.Generator, statistics: Statistics) -> Street:
    parking = rng.random() < statistics.parking
    half = rng.uniform(3.1, 3.7) + (2.2 if parking else 0.0) + (rng.random() < 0.2) * 0.8
    sides = np.array([rng.uniform(16, 60), rng.uniform(62, 120)])
    exists = rng.random(SIDE_STREETS) < 0.6
    numbers = {
        "curvature": rng.normal(0.0, 6e-4),
        "half_width_m": half,
        "kerb_m": rng.uniform(0.09, 0.15),
        "pavement_m": rng.uniform(1.8, 3.6),
        "parking": float(parking),
        "side_x_m": sides,
        "side_half_m": np.where(exists, rng.uniform(2.6, 3.6, SIDE_STREETS), -1.0),
        "side_towards": rng.choice([-1.0, 1.0], SIDE_STREETS),
        "crossing_x_m": rng.uniform(12, 50) if rng.random() < 0.45 else -500.0,
        "wear": rng.uniform(0.0, 1.0),
        "tone": rng.uniform(0.0, 1.0),
        "green": float(rng.random() < 0.55),
        "seed": float(rng.integers(1 << 16)),
    }
    return Street(**{name: np.asarray(value, np.float32) for name, value in numbers.items()})


def _light(rng: np.random.Generator) -> Light:
    cloud = float(rng.uniform() ** 1.5)
    azimuth, elevation = rng.uniform(0, 2 * np.pi), np.deg2rad(rng.uniform(28, 62))
    sun = np.array([np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)])
    # A closed cover of cloud takes the sun away and leaves a bright grey sky.
    strength = 3.2 * (1.0 - 0.9 * max(0.0, (cloud - 0.45) / 0.55))
    grey = 0.15 + 0.85 * cloud
    zenith = np.array([0.13, 0.30, 0.72]) * (1 - grey) + np.array([0.72, 0.76, 0.82]) * grey
    horizon = np.array([0.62, 0.76, 0.92]) * (1 - grey) + np.array([0.86, 0.88, 0.9]) * grey
    values = {
        "sun": sun,
        "sun_rgb": strength * np.array([1.0, 0.93, 0.82]),
        "zenith_rgb": zenith,
        "horizon_rgb": horizon,
        "cloud": cloud,
        "haze_m": rng.uniform(350, 1500),
        "exposure": rng.uniform(0.85, 1.1) * (1.05 + 0.5 * max(0.0, cloud - 0.5)),
        "seed": float(rng.integers(1 << 16)),
    }
    return Light(**{name: np.asarray(value, np.float32) for name, value in values.items()})


def _houses(plan: Plan, *, urban: bool) -> None:
    rng, street = plan.rng, plan.street
    setback = float(rng.uniform(0.0, 1.5) if urban else rng.uniform(3.0, 8.0))
    shops = urban and rng.random() < 0.5
    for side in (-1, 1):
        front = float(street.half_width_m) + float(street.pavement_m) + setback
        x = FROM_M + float(rng.uniform(0, 8))
        floors = int(rng.integers(2, 5)) if urban else int(rng.integers(1, 3))
        while x < TO_M:
            length = float(rng.uniform(9, 17))
            middle = x + length / 2
            x += length + (0.0 if urban and rng.random() < 0.8 else float(rng.uniform(2.5, 9.0)))
            if not plan.clear_of_sides(middle, side, length / 2 + 1.8) or rng.random() < (0.04 if urban else 0.15):
                continue
            storeys = max(1, floors + int(rng.integers(-1, 2)))
            back = float(rng.uniform(0.0, 0.5) if urban else rng.uniform(0.0, 2.0))
            model, depth = surroundings.house(rng, length=length - 0.02, floors=storeys, shops=bool(shops))
            plan.place((middle, side * (front + back + depth / 2)), model)
        if setback > 2.5:
            _borders(plan, side, float(street.half_width_m) + float(street.pavement_m) + 0.4)
    for _ in range(14):
        spot = (float(rng.uniform(-40, 130)), float(rng.choice([-1, 1]) * rng.uniform(34, 70)))
        if rng.random() < 0.35:
            model, _ = surroundings.house(rng, length=12.0, floors=int(rng.integers(1, 4)), shops=False)
            plan.place(spot, model, turn=float(rng.uniform(0, 3)))
        else:
            plan.place(spot, surroundings.tree(rng))
    # The street does not end in nothing: something stands at its far end.
    for off in (-34.0, -20.0, -7.0, 6.0, 19.0, 33.0):
        far = TO_M + float(rng.uniform(8, 30))
        if rng.random() < 0.5:
            model, _ = surroundings.house(rng, length=12.0, floors=int(rng.integers(1, 4)), shops=False)
            plan.place((far, off), model, turn=np.pi / 2)
        else:
            plan.place((far, off), surroundings.tree(rng))


def _borders(plan: Plan, side: int, off: float) -> None:
    """Hedges, fences and gaps between the gardens and the pavement."""
    rng, x = plan.rng, FROM_M + 10
    while x < TO_M - 40:
        length = float(rng.uniform(5, 14))
        middle, kind = x + length / 2, rng.random()
        x += length + float(rng.uniform(1.0, 4.0))
        if kind > 0.75 or not plan.clear_of_sides(middle, side, length / 2 + 1.0):
            continue
        model = surroundings.hedge(rng, length) if kind < 0.4 else surroundings.fence(rng, length)
        plan.place((middle, side * off), model)


def _posts(plan: Plan) -> None:
    rng, half = plan.rng, float(plan.street.half_width_m)
    spacing, phase = float(rng.uniform(22, 34)), float(rng.uniform(0, 20))
    lamp = surroundings.lamp_post(rng)
    for i, x in enumerate(np.arange(FROM_M + phase, TO_M, spacing)):
        side = 1 if i % 2 else -1
        if plan.clear_of_sides(x, side, 1.5):
            # The arm of a post on the left reaches to the right.
            plan.place((float(x), side * (half + 0.5)), lamp, turn=np.pi if side > 0 else 0.0)
    for _ in range(int(rng.integers(3, 9))):
        x, side = float(rng.uniform(-30, 90)), int(rng.choice([-1, 1]))
        if plan.clear_of_sides(x, side, 1.0):
            # Signs look at the traffic that passes them on its right.
            turn = (np.pi if side < 0 else 0.0) + float(rng.normal(0, 0.06))
            plan.place((x, side * (half + float(rng.uniform(0.45, 0.8)))), surroundings.sign(rng), turn=turn)
    if rng.random() < 0.3:
        side, start = int(rng.choice([-1, 1])), float(rng.uniform(6, 40))
        for x in np.arange(start, start + 14, 1.6):
            if plan.clear_of_sides(float(x), side, 1.0):
                plan.place((float(x), side * (half + 0.35)), surroundings.bollard())


def _greenery(plan: Plan, *, density: float) -> None:
    rng, street = plan.rng, plan.street
    half, pavement = float(street.half_width_m), float(street.pavement_m)
    for side in (-1, 1):
        if rng.random() < 0.55 * density + 0.15:
            x, spacing = FROM_M + float(rng.uniform(0, 10)), float(rng.uniform(9, 18))
            while x < TO_M:
                if plan.clear_of_sides(x, side, 2.5):
                    plan.place((x, side * (half + 0.9)), surroundings.tree(rng), turn=float(rng.uniform(0, 6)))
                x += spacing * float(rng.uniform(0.8, 1.4))
        for _ in range(int(rng.integers(2, 9) * density)):
            x = float(rng.uniform(FROM_M, TO_M))
            if plan.clear_of_sides(x, side, 2.0) and float(street.green) > 0.5:
                off = side * (half + pavement + float(rng.uniform(1.0, 3.0)))
                plan.place((x, off), surroundings.bush(rng))
