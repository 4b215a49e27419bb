"""Who parks, drives and walks in a street, and how often: two towns that differ in this, not in materials or light."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jaxsim.data.synthetic.road_users import CAR_SHAPES, car, cyclist, pedestrian, truck
from jaxsim.data.synthetic.scene import FROM_M, Plan
from jaxsim.data.synthetic.street import SIDE_STREETS


@dataclass(frozen=True)
class Statistics:
    """Chances and shares that a street is drawn with."""

    parking: float = 0.65
    """Chance that cars park along the street."""
    parked: tuple[float, float] = (0.45, 0.9)
    """Share of the places that is taken, from and to."""
    urban: float = 0.5
    """Chance of tall houses without front gardens, and of many people."""
    ahead: float = 0.6
    """Chance of a vehicle in each gap of the car's own lane."""
    oncoming: float = 0.45
    """The same of the other lane."""
    trucks: float = 0.12
    """Share of trucks in the traffic."""
    bodies: tuple[float, ...] = (0.3, 0.2, 0.16, 0.2, 0.14)
    """Shares of hatchbacks, saloons, estates, SUVs and vans (in the order of CAR_SHAPES)."""


STATISTICS = {
    "town": Statistics(),
    "suburb": Statistics(
        parking=0.35,
        parked=(0.3, 0.7),
        urban=0.15,
        ahead=0.7,
        oncoming=0.6,
        trucks=0.2,
        bodies=(0.15, 0.3, 0.1, 0.35, 0.1),
    ),
}
"""By the name that `DataConfig.streets` takes."""


def _vehicle(rng: np.random.Generator, statistics: Statistics, *, trucks: float):
    """A model, its size and KITTI's name of it."""
    if rng.random() < trucks:
        return (*truck(rng), "Truck")
    names = list(CAR_SHAPES)
    shape = CAR_SHAPES[names[rng.choice(len(names), p=statistics.bodies)]]
    return (*car(rng, shape), shape.kind)


def park_along(plan: Plan, statistics: Statistics) -> None:
    """Parks cars along both kerbs, clear of side streets and of the crossing."""
    rng, half = plan.rng, float(plan.street.half_width_m)
    share = float(rng.uniform(*statistics.parked))
    for side in (-1, 1):
        x = FROM_M + 15 + float(rng.uniform(0, 4))
        while x < 95:
            model, size, kind = _vehicle(rng, statistics, trucks=0.04)
            middle = x + size[0] / 2
            x += size[0] + float(rng.uniform(0.7, 1.8))
            free = plan.clear_of_sides(middle, side, 4.5 + size[0] / 2)
            free = free and abs(middle - float(plan.street.crossing_x_m)) > 4.5 + size[0] / 2
            if free and rng.random() < share:
                off = side * (half - 0.25 - size[1] / 2 - float(rng.uniform(0, 0.15)))
                turn = (0.0 if side < 0 else np.pi) + float(rng.normal(0, 0.015))
                turn += np.pi * (rng.random() < 0.12)
                plan.place((middle, off), model, turn=turn, kind=kind, size_m=size)


def park_in_side_streets(plan: Plan, statistics: Statistics) -> None:
    """Parks a car in every side street."""
    rng, street = plan.rng, plan.street
    for i in range(SIDE_STREETS):
        if street.side_half_m[i] > 0:
            model, size, kind = _vehicle(rng, statistics, trucks=0.0)
            off = float(street.side_towards[i]) * (float(street.half_width_m) + float(rng.uniform(7, 12)))
            x = float(street.side_x_m[i] + street.side_half_m[i]) - 1.2
            plan.place((x, off), model, turn=np.pi / 2, kind=kind, size_m=size, z_m=0.0)


def drive_along(plan: Plan, statistics: Statistics, *, lane_m: float, ego_mps: float) -> None:
    """Vehicles ahead of the ego car and behind it, oncoming ones, and cyclists; lanes are `lane_m` wide."""
    rng = plan.rng
    ahead = float(rng.uniform(9, 26)) + ego_mps
    while ahead < 100:
        if rng.random() < statistics.ahead:
            model, size, kind = _vehicle(rng, statistics, trucks=statistics.trucks)
            speed = max(0.0, ego_mps + float(rng.normal(0, 0.8)))
            spot = (ahead, -lane_m / 2 + float(rng.normal(0, 0.12)))
            plan.place(spot, model, kind=kind, size_m=size, speed_mps=speed)
        ahead += float(rng.uniform(14, 35))
    behind = -float(rng.uniform(14, 40))
    if rng.random() < 0.5:
        model, size, kind = _vehicle(rng, statistics, trucks=0.1)
        plan.place((behind, -lane_m / 2), model, kind=kind, size_m=size, speed_mps=ego_mps)
    x, speed = -50.0 + float(rng.uniform(0, 25)), float(rng.uniform(5, 13))
    while x < 120:
        if rng.random() < statistics.oncoming:
            model, size, kind = _vehicle(rng, statistics, trucks=statistics.trucks)
            spot = (x, lane_m / 2 + float(rng.normal(0, 0.12)))
            plan.place(spot, model, turn=np.pi, kind=kind, size_m=size, speed_mps=-speed)
        x += float(rng.uniform(13, 32))
    for side in (-1, 1):
        if rng.random() < 0.45:
            # Beside the ego car's lane, far enough ahead of it; or on the left, anywhere.
            x = float(rng.uniform(14, 45) if side < 0 else rng.uniform(-20, 60))
            model, size = cyclist(rng)
            off = side * (lane_m - 0.45)
            speed = side * -float(rng.uniform(3.5, 6.0))
            # Whatever shares the strip must stay clear for the whole second.
            spaces = [abs(t.x_m - x) for t in plan.things if t.kind and abs(t.aside_m - off) < 2.0]
            if min(spaces, default=99.0) > 12.0:
                turn = 0.0 if side < 0 else np.pi
                plan.place((x, off), model, turn=turn, kind="Cyclist", size_m=size, speed_mps=speed)


def walk(plan: Plan, *, urban: bool) -> None:
    """Pedestrians on the pavements and on the zebra crossing."""
    rng, street = plan.rng, plan.street
    half, pavement = float(street.half_width_m), float(street.pavement_m)
    for _ in range(int(rng.integers(2, 15 if urban else 7))):
        side, x = int(rng.choice([-1, 1])), float(rng.uniform(-25, 70))
        along = 1 if rng.random() < 0.5 else -1
        off = side * (half + float(rng.uniform(1.3, max(1.5, pavement - 0.3))))
        if plan.clear_of_sides(x, side, 1.5):
            model, size = pedestrian(rng)
            speed = along * float(rng.uniform(0.8, 1.6))
            turn = 0.0 if along > 0 else np.pi
            plan.place((x, off), model, turn=turn, kind="Pedestrian", size_m=size, speed_mps=speed)
    crossing = float(street.crossing_x_m)
    if crossing > 14:
        for _ in range(int(rng.integers(0, 3))):
            off = float(rng.uniform(-0.9, 0.9)) * half
            model, size = pedestrian(rng)
            turn = float(rng.choice([-1, 1])) * np.pi / 2
            spot = (crossing + float(rng.uniform(-1.2, 1.2)), off)
            plan.place(spot, model, turn=turn, kind="Pedestrian", size_m=size)
