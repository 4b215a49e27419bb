"""Pedestrians and cyclists, of long and round balls."""

from __future__ import annotations

import numpy as np

from jaxsim.data.synthetic import palette
from jaxsim.data.synthetic.solids import Look, Model, Pattern

PERSON = 24
RIDER = 25
BICYCLE = 33


def _dress(rng: np.random.Generator, semantic: int) -> dict[str, Look]:
    hair = palette.vary(rng, palette.srgb(str(rng.choice(("2a2019", "5a4028", "8d7350", "b9b3a8")))), 0.1)
    looks = {"coat": palette.cloth(rng), "trousers": palette.cloth(rng), "skin": palette.skin(rng)}
    dressed = {name: Look(semantic, paint.rgb, paint.nir) for name, paint in looks.items()}
    dressed["hair"] = Look(semantic, hair, 0.25)
    dressed["shoes"] = Look(semantic, palette.TYRE.rgb, 0.15)
    return dressed


def _head(model: Model, at: tuple[float, float, float], size: float, *, dress: dict[str, Look]) -> None:
    x, y, z = at
    model.ball((x, y, z), (0.105 * size, 0.085 * size, 0.13 * size), dress["skin"])
    model.ball((x - 0.02, y, z + 0.035 * size), (0.105 * size, 0.095 * size, 0.115 * size), dress["hair"])


def pedestrian(rng: np.random.Generator) -> tuple[Model, tuple[float, float, float]]:
    """A person in mid step, and length, width, height of the box."""
    h = float(rng.uniform(1.55, 1.9))
    size = h / 1.75
    stride = float(rng.uniform(0.05, 0.28))
    stout = float(rng.uniform(0.9, 1.25))
    dress = _dress(rng, PERSON)
    model = Model()
    for side in (-1, 1):
        foot = side * stride
        knee = (0.4 * foot + 0.04, side * 0.095, 0.27 * h)
        model.limb((0.0, side * 0.085, 0.53 * h), knee, dress["trousers"], radius=0.085 * stout)
        model.limb((knee[0], knee[1], 0.31 * h), (foot, side * 0.1, 0.03 * h), dress["trousers"], radius=0.065 * stout)
        model.ball((foot + 0.06, side * 0.1, 0.035), (0.14, 0.05, 0.04), dress["shoes"])
        hand = (-0.7 * foot + 0.05, side * 0.26 * stout, 0.47 * h)
        model.limb((0.0, side * 0.2 * stout, 0.82 * h), hand, dress["coat"], radius=0.058 * stout)
    model.ball((0.0, 0.0, 0.67 * h), (0.13 * stout, 0.205 * stout, 0.195 * h), dress["coat"])
    model.limb((0.0, 0.0, 0.48 * h), (0.0, 0.0, 0.7 * h), dress["coat"], radius=0.16 * stout)
    model.cylinder((0.0, 0.0, 0.82 * h), (0.0, 0.0, 0.88 * h), dress["skin"], radius=0.05)
    _head(model, (0.015, 0.0, h - 0.14 * size), size, dress=dress)
    return model, (2 * stride + 0.44, 0.64 * stout, h + 0.02)


def cyclist(rng: np.random.Generator) -> tuple[Model, tuple[float, float, float]]:
    """A rider on a bicycle, and length, width, height of the box."""
    dress = _dress(rng, RIDER)
    paint = palette.car_paint(rng)
    frame = Look(BICYCLE, paint.rgb, paint.nir, gloss=0.05)
    tyre = Look(BICYCLE, palette.TYRE.rgb, palette.TYRE.nir, Pattern.PLAIN)
    model = Model()
    for x in (-0.52, 0.52):
        model.cylinder((x, -0.02, 0.34), (x, 0.02, 0.34), tyre, radius=0.34, bore=0.88)
        model.cylinder((x, -0.05, 0.34), (x, 0.05, 0.34), frame, radius=0.035)
    saddle = (-0.2, 0.0, 0.93)
    pedals = (-0.08, 0.0, 0.3)
    bar = (0.4, 0.0, 1.02)
    tubes = (
        (saddle, pedals),
        (pedals, (0.38, 0.0, 0.82)),
        ((-0.17, 0.0, 0.82), (0.38, 0.0, 0.85)),
        (pedals, (-0.52, 0.0, 0.34)),
        ((-0.17, 0.0, 0.82), (-0.52, 0.0, 0.34)),
        (bar, (0.52, 0.0, 0.34)),
        ((0.38, -0.27, 1.03), (0.38, 0.27, 1.03)),
    )
    for start, end in tubes:
        model.cylinder(start, end, frame, radius=0.02)
    turn = float(rng.uniform(-0.9, 0.9))
    shoulder = (0.14, 0.0, 1.43)
    model.limb((-0.22, 0.0, 0.95), (shoulder[0] + 0.03, 0.0, 1.52), dress["coat"], radius=0.17)
    for side in (-1, 1):
        foot = (-0.08 + 0.15 * np.sin(turn) * side, side * 0.11, 0.32 + 0.15 * np.cos(turn) * side)
        knee = (0.24, side * 0.12, foot[2] + 0.42)
        model.limb((-0.2, side * 0.1, 0.98), (knee[0] + 0.05, knee[1], knee[2]), dress["trousers"], radius=0.085)
        model.limb((knee[0], knee[1], knee[2] + 0.05), foot, dress["trousers"], radius=0.062)
        model.ball((foot[0] + 0.05, foot[1], foot[2] - 0.02), (0.13, 0.045, 0.045), dress["shoes"])
        elbow = (0.27, side * 0.28, 1.2)
        model.limb((shoulder[0], side * 0.19, shoulder[2] + 0.02), elbow, dress["coat"], radius=0.055)
        model.limb(elbow, (0.38, side * 0.24, 1.05), dress["skin"], radius=0.05)
    _head(model, (0.24, 0.0, 1.66), 1.0, dress=dress)
    return model, (1.78, 0.72, 1.82)
