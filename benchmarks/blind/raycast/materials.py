"""Materials: Cityscapes class, albedo in the near infrared, and a texture in space."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from benchmarks.blind.raycast.chance import cell_value, value_noise

Texture = Callable[[np.ndarray, int], np.ndarray]
"""(*n, 3) points in m and a salt to nats about the material's albedo, of standard deviation about 1."""


def plain(point: np.ndarray, salt: int) -> np.ndarray:
    return 0.3 * value_noise(point, 1.2, salt)


def grain(point: np.ndarray, salt: int) -> np.ndarray:
    return 0.6 * value_noise(point, 0.12, salt) + 0.8 * value_noise(point, 0.7, salt + 1)


def mottled(point: np.ndarray, salt: int) -> np.ndarray:
    return 0.7 * value_noise(point, 0.35, salt) + 0.7 * value_noise(point, 1.6, salt + 1)


def panels(point: np.ndarray, salt: int) -> np.ndarray:
    """Panels of 1.5 m, each with a tone of its own, and dark joints."""
    cell = np.floor(point / 1.5 + 0.13)
    joint = (np.abs(point / 1.5 + 0.13 - cell - 0.5) > 0.48).any(-1)
    return 1.2 * cell_value(cell, salt) - 1.0 * joint + 0.4 * value_noise(point, 0.3, salt + 1)


def stripes(point: np.ndarray, salt: int) -> np.ndarray:
    """Corrugations and planks: stripes of 0.6 m along one axis."""
    return 1.2 * np.sin(2 * np.pi * point[..., 0] / 0.6) + 0.5 * value_noise(point, 0.5, salt)


def lanes(point: np.ndarray, salt: int) -> np.ndarray:
    """Asphalt with wheel tracks and painted lines every 3.75 m, dashed but for the outermost."""
    y = np.abs(point[..., 1])
    from_line = np.abs((y - 1.5 + 1.875) % 3.75 - 1.875)
    solid = (np.abs(y - 1.5) < 0.3) | (np.abs(y - 12.75) < 0.3)
    paint = (from_line < 0.08) & (y > 1) & (y < 13) & (solid | (point[..., 0] % 12 < 6))
    return np.where(paint, 4.0, 0.0) + 0.7 * grain(point, salt) - 0.5 * np.cos(2 * np.pi * y / 1.875)


class Material(NamedTuple):
    """albedo: of the simulator's table; hue: colour to the camera, which says nothing of the infrared."""

    semantic: int
    albedo: float
    texture: Texture
    hue: tuple[int, int, int]


MATERIALS = {
    "asphalt": Material(7, 0.14, lanes, (70, 70, 75)),
    "concrete": Material(12, 0.32, panels, (150, 150, 145)),
    "rail": Material(14, 0.34, plain, (130, 135, 140)),
    "grass": Material(22, 0.36, mottled, (80, 120, 60)),
    "leaves": Material(21, 0.44, mottled, (60, 100, 50)),
    "gantry": Material(17, 0.3, plain, (120, 120, 120)),
    "sign": Material(20, 0.38, plain, (40, 70, 160)),
    "lacquer": Material(26, 0.24, plain, (140, 40, 40)),
    "tarpaulin": Material(27, 0.4, stripes, (170, 160, 120)),
    "floor": Material(6, 0.26, panels, (120, 118, 110)),
    "plaster": Material(12, 0.48, mottled, (200, 198, 190)),
    "sheeting": Material(11, 0.36, stripes, (170, 175, 180)),
    "pillar": Material(17, 0.3, grain, (180, 160, 60)),
    "rack": Material(13, 0.22, plain, (40, 60, 150)),
    "carton": Material(5, 0.42, grain, (170, 130, 80)),
    "forklift": Material(27, 0.3, plain, (200, 150, 30)),
    "cloth": Material(24, 0.28, mottled, (60, 60, 110)),
}
NAMES = tuple(MATERIALS)


def texture_of(material: np.ndarray, point: np.ndarray, salt: int) -> np.ndarray:
    """Texture (nats, sd about 1) at points (n, 3) on materials (n,), numbers into NAMES; 0 where it is -1."""
    out = np.zeros(len(material))
    for number, name in enumerate(NAMES):
        at = material == number
        if at.any():
            out[at] = MATERIALS[name].texture(point[at], salt + 10 * number)
    return out
