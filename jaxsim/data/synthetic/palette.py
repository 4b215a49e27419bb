"""What things are painted with: colour and reflectance at 905 nm, drawn together.

Colours are linear RGB. Reflectances follow general knowledge of the near infrared: leaves and most dyes are bright
there whatever their colour, asphalt dark, carbon-black paint dark, other black paints not; the figures are orders
of magnitude, chosen so that colour tells part of the reflectance and class another part.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from jaxsim.data.cityscapes import IDS
from jaxsim.data.synthetic.solids import Look

_Rgb = tuple[float, float, float]


class Paint(NamedTuple):
    """A colour as the camera sees it and as the LiDAR does."""

    rgb: _Rgb
    nir: float
    gloss: float = 0.0
    absorbing: float = 0.0


def look_of(class_name: str, paint: Paint, second: Paint | None = None, **more: Any) -> Look:
    """A solid of a Cityscapes class in one paint or two; `more` are further fields, gloss and absorption among them."""
    two: dict[str, Any] = {} if second is None else {"rgb2": second.rgb, "nir2": second.nir}
    return Look(IDS[class_name], paint.rgb, paint.nir, **two, **more)


def srgb(code: str) -> _Rgb:
    """Linear colour of a web colour: `srgb("d8d4cc")`."""
    red = float((int(code[0:2], 16) / 255) ** 2.2)
    green = float((int(code[2:4], 16) / 255) ** 2.2)
    blue = float((int(code[4:6], 16) / 255) ** 2.2)
    return red, green, blue


# Colour, reflectance, share of the cars, absorbing.
_CAR_PAINTS = (
    ("e9e9e6", 0.62, 0.21, 0.0),  # white
    ("b7babd", 0.50, 0.17, 0.0),  # silver
    ("6d7176", 0.37, 0.15, 0.0),  # grey
    ("34373b", 0.24, 0.09, 0.0),  # anthracite
    ("15161a", 0.05, 0.09, 1.0),  # carbon black
    ("1f1712", 0.19, 0.05, 0.0),  # black to the eye alone
    ("8e1a1c", 0.46, 0.08, 0.0),  # red
    ("22386e", 0.27, 0.08, 0.0),  # blue
    ("3f6fa8", 0.38, 0.03, 0.0),  # light blue
    ("22462f", 0.28, 0.02, 0.0),  # green
    ("b9a27c", 0.56, 0.02, 0.0),  # beige
)
_WALLS = ("e6ddc8", "d9c7a3", "cfcac2", "efe9df", "c9a98b", "b5b1ab", "d7b9a0", "a9b0a8", "e0cf9f", "bfb2a2")
_BRICKS = ("8a4b39", "9c5a44", "74463a", "a5705a", "6d5a4e")
_ROOFS = ("6a3b2e", "7d4a3a", "4a4745", "5a5654", "8a5a45")
_CLOTHES = ("22252c", "2e3f63", "7a2328", "d8d4cc", "4e5a48", "8c8579", "c2a23a", "35414f", "5c3a52", "b85f3c")
_SKINS = ("d9a88a", "b9805e", "8a5a3e", "e6bfa2")


def luminance(rgb: _Rgb) -> float:
    """Luminance of a linear colour, 0..1 (Rec. 709)."""
    return 0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2]


def vary(rng: np.random.Generator, rgb: _Rgb, spread: float) -> _Rgb:
    """The colour made brighter or darker, and slightly of another hue."""
    bright = np.exp(rng.normal(0.0, spread))
    red, green, blue = np.clip(np.asarray(rgb) * bright * np.exp(rng.normal(0.0, 0.2 * spread, 3)), 0.004, 0.92)
    return float(red), float(green), float(blue)


def _jitter(rng: np.random.Generator, value: float, spread: float) -> float:
    return float(np.clip(value * np.exp(rng.normal(0.0, spread)), 0.02, 0.9))


def car_paint(rng: np.random.Generator) -> Paint:
    """A car's colour, as often as cars have it."""
    share = np.array([p[2] for p in _CAR_PAINTS])
    code, nir, _, absorbing = _CAR_PAINTS[rng.choice(len(_CAR_PAINTS), p=share / share.sum())]
    return Paint(vary(rng, srgb(code), 0.10), _jitter(rng, nir, 0.05), 0.06, absorbing)


def wall(rng: np.random.Generator, *, brick: bool) -> Paint:
    """A house's wall, of bricks or plastered."""
    rgb = vary(rng, srgb(str(rng.choice(_BRICKS if brick else _WALLS))), 0.16)
    base = 0.26 + 0.7 * luminance(rgb) if brick else 0.30 + 0.36 * luminance(rgb)
    return Paint(rgb, _jitter(rng, base, 0.05))


def roof(rng: np.random.Generator) -> Paint:
    """A roof's tiles."""
    rgb = vary(rng, srgb(str(rng.choice(_ROOFS))), 0.15)
    return Paint(rgb, _jitter(rng, 0.16 + 1.0 * luminance(rgb), 0.05))


def cloth(rng: np.random.Generator) -> Paint:
    """Dyes absorb what the eye sees and little at 905 nm."""
    rgb = vary(rng, srgb(str(rng.choice(_CLOTHES))), 0.2)
    return Paint(rgb, _jitter(rng, 0.30 + 0.4 * luminance(rgb), 0.07))


def skin(rng: np.random.Generator) -> Paint:
    """A person's skin: brighter in the near infrared than it looks."""
    return Paint(srgb(str(rng.choice(_SKINS))), _jitter(rng, 0.5, 0.05))


def leaves(rng: np.random.Generator) -> tuple[Paint, Paint]:
    """Two greens of one plant."""
    green = vary(rng, srgb(str(rng.choice(("4d6b2a", "5a7a32", "3c5a2c", "6b7d35")))), 0.15)
    nir = 0.36 + 1.2 * luminance(green)
    lighter = vary(rng, (green[0] * 1.6, green[1] * 1.5, green[2] * 1.2), 0.05)
    return Paint(green, _jitter(rng, nir, 0.05)), Paint(lighter, _jitter(rng, nir * 1.15, 0.03))


BARK = Paint(srgb("5d4c3c"), 0.34)
METAL = Paint(srgb("8c9092"), 0.38, 0.03)
DARK_METAL = Paint(srgb("3b4442"), 0.22, 0.02)
TYRE = Paint(srgb("1d1d1e"), 0.07)
RIM = Paint(srgb("a9adb1"), 0.5, 0.06)
RED_LAMP = Paint(srgb("8c1216"), 0.6, 0.08)
