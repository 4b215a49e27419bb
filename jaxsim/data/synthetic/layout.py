"""Lays out one street: its shape, its weather, and what stands where; and its traffic, who parks, drives and walks
there, and how often: two towns that differ in this, not in materials or light.

A street's middle is y = c x^2 / 2 in `world`; traffic keeps right. A place along it is (x, aside): aside is measured to
the left of the middle. A drive takes a second: the ego car starts at x = 0.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from jaxsim.data.synthetic import things
from jaxsim.data.synthetic.light import Light
from jaxsim.data.synthetic.solids import FROM_M, TO_M, Parts, Plan, Thing, gather_solids
from jaxsim.data.synthetic.street import SIDE_STREETS, Street
from jaxsim.data.synthetic.things import CAR_SHAPES, car, cyclist, pedestrian, truck


@dataclass(frozen=True)
class StreetStatistics:
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
    wet: float = 0.0
    """About the share of the road on which water stands."""


AFTER_RAIN = 0.4
_SUBURB = StreetStatistics(
    parking=0.35,
    parked=(0.3, 0.7),
    urban=0.15,
    ahead=0.7,
    oncoming=0.6,
    trucks=0.2,
    bodies=(0.15, 0.3, 0.1, 0.35, 0.1),
)
STATISTICS = {
    "town": StreetStatistics(),
    "suburb": _SUBURB,
    "wet_town": StreetStatistics(wet=AFTER_RAIN),
    "wet_suburb": replace(_SUBURB, wet=AFTER_RAIN),
}
"""By the name that `DataConfig.streets` takes."""


def _vehicle(rng: np.random.Generator, statistics: StreetStatistics, *, trucks: float):
    """A model, its size and KITTI's name of it."""
    if rng.random() < trucks:
        return (*truck(rng), "Truck")
    names = list(CAR_SHAPES)
    shape = CAR_SHAPES[names[rng.choice(len(names), p=statistics.bodies)]]
    return (*car(rng, shape), shape.kind)


def park_along(plan: Plan, statistics: StreetStatistics) -> None:
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


def park_in_side_streets(plan: Plan, statistics: StreetStatistics) -> None:
    """Parks a car in every side street."""
    rng, street = plan.rng, plan.street
    for i in range(SIDE_STREETS):
        if street.side_half_m[i] > 0:
            model, size, kind = _vehicle(rng, statistics, trucks=0.0)
            off = float(street.side_towards[i]) * (float(street.half_width_m) + float(rng.uniform(7, 12)))
            x = float(street.side_x_m[i] + street.side_half_m[i]) - 1.2
            plan.place((x, off), model, turn=np.pi / 2, kind=kind, size_m=size, z_m=0.0)


def drive_along(plan: Plan, statistics: StreetStatistics, *, lane_m: float, ego_mps: float) -> None:
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
    return Drive(plan.street, light, things, gather_solids(things), ego, speed)


def _street(rng: np.random.Generator, statistics: StreetStatistics) -> Street:
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
        "wet": statistics.wet,
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
            model, depth = things.house(rng, length=length - 0.02, floors=storeys, shops=bool(shops))
            plan.place((middle, side * (front + back + depth / 2)), model)
        if setback > 2.5:
            _borders(plan, side, float(street.half_width_m) + float(street.pavement_m) + 0.4)
    for _ in range(14):
        spot = (float(rng.uniform(-40, 130)), float(rng.choice([-1, 1]) * rng.uniform(34, 70)))
        if rng.random() < 0.35:
            model, _ = things.house(rng, length=12.0, floors=int(rng.integers(1, 4)), shops=False)
            plan.place(spot, model, turn=float(rng.uniform(0, 3)))
        else:
            plan.place(spot, things.tree(rng))
    # The street does not end in nothing: something stands at its far end.
    for off in (-34.0, -20.0, -7.0, 6.0, 19.0, 33.0):
        far = TO_M + float(rng.uniform(8, 30))
        if rng.random() < 0.5:
            model, _ = things.house(rng, length=12.0, floors=int(rng.integers(1, 4)), shops=False)
            plan.place((far, off), model, turn=np.pi / 2)
        else:
            plan.place((far, off), things.tree(rng))


def _borders(plan: Plan, side: int, off: float) -> None:
    """Hedges, fences and gaps between the gardens and the pavement."""
    rng, x = plan.rng, FROM_M + 10
    while x < TO_M - 40:
        length = float(rng.uniform(5, 14))
        middle, kind = x + length / 2, rng.random()
        x += length + float(rng.uniform(1.0, 4.0))
        if kind > 0.75 or not plan.clear_of_sides(middle, side, length / 2 + 1.0):
            continue
        model = things.hedge(rng, length) if kind < 0.4 else things.fence(rng, length)
        plan.place((middle, side * off), model)


def _posts(plan: Plan) -> None:
    rng, half = plan.rng, float(plan.street.half_width_m)
    spacing, phase = float(rng.uniform(22, 34)), float(rng.uniform(0, 20))
    lamp = things.lamp_post(rng)
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
            plan.place((x, side * (half + float(rng.uniform(0.45, 0.8)))), things.sign(rng), turn=turn)
    if rng.random() < 0.3:
        side, start = int(rng.choice([-1, 1])), float(rng.uniform(6, 40))
        for x in np.arange(start, start + 14, 1.6):
            if plan.clear_of_sides(float(x), side, 1.0):
                plan.place((float(x), side * (half + 0.35)), things.bollard())


def _greenery(plan: Plan, *, density: float) -> None:
    rng, street = plan.rng, plan.street
    half, pavement = float(street.half_width_m), float(street.pavement_m)
    for side in (-1, 1):
        if rng.random() < 0.55 * density + 0.15:
            x, spacing = FROM_M + float(rng.uniform(0, 10)), float(rng.uniform(9, 18))
            while x < TO_M:
                if plan.clear_of_sides(x, side, 2.5):
                    plan.place((x, side * (half + 0.9)), things.tree(rng), turn=float(rng.uniform(0, 6)))
                x += spacing * float(rng.uniform(0.8, 1.4))
        for _ in range(int(rng.integers(2, 9) * density)):
            x = float(rng.uniform(FROM_M, TO_M))
            if plan.clear_of_sides(x, side, 2.0) and float(street.green) > 0.5:
                off = side * (half + pavement + float(rng.uniform(1.0, 3.0)))
                plan.place((x, off), things.bush(rng))
