"""Random streets: fronts at several distances, oblique walls, vehicles with slanted screens, poles, signs, trees."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from benchmarks.blind.hidden import world as w
from benchmarks.blind.hidden.world import Solid, World, box, cylinder, ellipsoid, prism


class Drive(NamedTuple):
    """One scene: its world and the vehicle's path through it."""

    world: World
    lane_m: float
    speed_m_s: float
    compass_rad: float  # of the street's x axis
    yaw_rad: float  # of the vehicle to the street at the first frame
    turn_rad_s: float
    start_s: float


def vehicle(x: float, y: float, yaw: float, kind: str, number: int) -> list[Solid]:
    """A car: body and a cabin with slanted front and rear screen; a truck: cab with slanted screen and a box."""
    if kind == "truck":
        tail = box((x - 1.2 * np.cos(yaw), y - 1.2 * np.sin(yaw)), (5.5, 2.4), 0.7, 3.4, yaw, w.TRUCK, number)
        cab = np.array([[1.7, 0.4], [3.6, 0.4], [3.6, 1.5], [3.1, 2.7], [1.7, 2.7]])
        return [tail, prism(cab, 2.3, (x, y), yaw, w.TRUCK, number)]
    body = np.array([[-2.1, 0.25], [2.1, 0.25], [2.15, 0.6], [1.9, 0.85], [-2.0, 0.95], [-2.15, 0.6]])
    cabin = np.array([[-1.7, 0.85], [1.2, 0.85], [0.35, 1.42], [-1.1, 1.45]])
    return [prism(body, 1.75, (x, y), yaw, w.CAR, number), prism(cabin, 1.5, (x, y), yaw, w.CAR, number)]


def tree(x: float, y: float, rng: np.random.Generator, number: int) -> list[Solid]:
    high = rng.uniform(1.6, 2.6)
    crown = rng.uniform([1.0, 1.0, 0.9], [2.2, 2.2, 2.0])
    trunk = cylinder((x, y), rng.uniform(0.1, 0.25), 0, high + 0.5, w.VEGETATION, number)
    return [trunk, ellipsoid(np.array([x, y, high + crown[2] * 0.7]), crown, w.VEGETATION, number)]


def person(x: float, y: float, rng: np.random.Generator, number: int) -> list[Solid]:
    tall = rng.uniform(1.55, 1.9)
    return [
        cylinder((x, y), rng.uniform(0.18, 0.28), 0, 0.82 * tall, w.PERSON, number),
        ellipsoid(np.array([x, y, 0.9 * tall]), np.array([0.11, 0.11, 0.14]), w.PERSON, number),
    ]


def sign(x: float, y: float, yaw: float, rng: np.random.Generator, number: int, post: int) -> list[Solid]:
    wide, tall, low = rng.uniform(0.6, 1.3), rng.uniform(0.6, 1.1), rng.uniform(0.4, 1.3)
    board = box((x, y), (0.04, wide), low, low + tall, yaw, w.SIGN, number)
    back = (x + 0.06 * np.cos(yaw), y + 0.06 * np.sin(yaw))
    return [board, cylinder(back, 0.03, 0, low + tall, w.POLE, post)]


def build_drive(rng: np.random.Generator) -> Drive:
    """Everything of one scene; ids of things start at 1 and are shuffled so that they carry no order."""
    road, walk = rng.uniform(4, 8), rng.uniform(2, 4)
    crossing = float(rng.uniform(18, 70) * rng.choice([-1, 1]))
    lane = float(rng.uniform(1.2, road - 1.5) * rng.choice([-1, 1]))
    solids: list[Solid] = []
    ids = iter(rng.permutation(np.arange(1, 900)).tolist())
    for side in (-1, 1):
        x = -110.0
        setback = rng.uniform(0.5, 9)
        while x < 115:
            long = rng.uniform(7, 24)
            setback = np.clip(setback + rng.normal(0, 2), 0.3, 14)
            middle = x + long / 2
            if abs(middle - crossing) > road + walk + long / 2 and rng.random() > 0.15:
                deep = rng.uniform(6, 12)
                y = side * (road + walk + setback + deep / 2)
                turn = rng.normal(0, 0.04)
                solids.append(box((middle, y), (long, deep), 0, rng.uniform(4, 15), turn, w.BUILDING, next(ids)))
            elif rng.random() < 0.6:
                far = (middle, side * rng.uniform(30, 85))
                turn = rng.uniform(-0.8, 0.8)
                solids.append(box(far, (rng.uniform(12, 30), 9.0), 0, rng.uniform(7, 20), turn, w.BUILDING, next(ids)))
            x += long + rng.uniform(0, 7)
        solids += _furniture(rng, side, road, walk, crossing, ids)
    for end in (-1, 1):
        if rng.random() < 0.7:
            far = (end * rng.uniform(70, 112), rng.uniform(-6, 6))
            turn = rng.uniform(-0.7, 0.7)
            solids.append(box(far, (8.0, rng.uniform(14, 40)), 0, rng.uniform(6, 18), turn, w.BUILDING, next(ids)))
    for _ in range(rng.integers(3, 7)):
        x, other = rng.uniform(-60, 70), -np.sign(lane) * rng.uniform(1.4, road - 1.2)
        ahead = rng.random() < 0.3
        y = lane if ahead else other
        x = x if abs(x) > 9 or not ahead else np.sign(x) * (9 + abs(x))
        if abs(y - lane) > 2.5 or ahead:
            kind = "truck" if rng.random() < 0.25 else "car"
            solids += vehicle(x, y, rng.normal(0, 0.04) + (0 if ahead else np.pi), kind, next(ids))
    solids = [s for s in solids if _clear(s, lane)]
    turning = rng.random() < 0.5
    return Drive(
        World(road, road + walk, crossing, solids),
        lane,
        float(rng.choice([0.0, rng.uniform(1, 20)], p=[0.1, 0.9])),
        float(rng.uniform(-np.pi, np.pi)),
        float(rng.uniform(-0.7, 0.7) if turning else rng.normal(0, 0.05)),
        float(rng.uniform(-0.3, 0.3) if turning else rng.normal(0, 0.02)),
        0.0,
    )


def _furniture(rng, side: int, road: float, walk: float, crossing: float, ids) -> list[Solid]:
    """Parked vehicles, poles, signs, people, trees and walls of one side of the street."""
    out: list[Solid] = []
    kerb, free = side * (road - 1.0), side * (road + walk)
    for x in np.arange(-45, 60, 7.5) + rng.uniform(-2, 2):
        if rng.random() < 0.55 and abs(x - crossing) > road + 5:
            kind = "truck" if rng.random() < 0.15 else "car"
            out += vehicle(x, kerb, rng.normal(0, 0.06) + rng.choice([0, np.pi]), kind, next(ids))
    for x in np.arange(-60, 80, 18.0) + rng.uniform(-6, 6):
        out.append(cylinder((x, side * (road + 0.4)), rng.uniform(0.07, 0.16), 0, 7.0, w.POLE, next(ids)))
    for _ in range(rng.integers(5, 9)):
        x = rng.uniform(-25, 45)
        out += sign(x, side * (road + rng.uniform(0.3, 1.2)), rng.normal(0, 0.35), rng, next(ids), next(ids))
    for _ in range(rng.integers(3, 7)):
        out += person(rng.uniform(-25, 35), side * (road + rng.uniform(0.3, walk)), rng, next(ids))
    for _ in range(rng.integers(3, 8)):
        out += tree(rng.uniform(-60, 80), free + side * rng.uniform(-0.5, 4), rng, next(ids))
    for _ in range(rng.integers(1, 4)):
        at = (rng.uniform(-40, 60), free + side * rng.uniform(1, 6))
        size = (rng.uniform(4, 14), 0.3)
        out.append(box(at, size, 0, rng.uniform(1.0, 2.6), rng.uniform(-1.2, 1.2), w.WALL, next(ids)))
    if rng.random() < 0.5:
        long, rise = rng.uniform(15, 30), rng.uniform(0.8, 2.5)
        bank = np.array([[0, 0], [long, 0], [long, rise]])
        out.append(prism(bank, 8.0, (rng.uniform(-20, 30), free + side * 6), side * 1.4, w.TERRAIN, 0))
    return out


def _clear(solid: Solid, lane: float) -> bool:
    """Keep the vehicle's own place free: nothing within 2.6 m of the stretch it drives over."""
    path = np.stack([np.linspace(-2, 12, 15), np.full(15, lane)], 1)
    gap = np.abs(solid.footprint[None] - path[:, None]).max(-1).min()
    low, high = solid.footprint.min(0), solid.footprint.max(0)
    over = ((path > low) & (path < high)).all(1).any()
    return bool(gap > 2.6) and not over


def pose(drive: Drive, seconds: float, height_m: float) -> tuple[np.ndarray, float]:
    """Sensor position (street frame) and yaw of the vehicle `seconds` after the scene's first frame."""
    yaw = drive.yaw_rad + drive.turn_rad_s * seconds
    step = drive.speed_m_s * seconds
    ahead = np.clip(step, 0, 10) * np.array([np.cos(drive.yaw_rad), 0.2 * np.sin(drive.yaw_rad), 0])
    return np.array([0.0, drive.lane_m, height_m]) + ahead, yaw
