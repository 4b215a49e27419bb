"""What stands along a street: houses, trees, hedges, posts and signs."""

from __future__ import annotations

import numpy as np

from jaxsim.data.synthetic import palette
from jaxsim.data.synthetic.materials import FLOOR_M
from jaxsim.data.synthetic.palette import look_of
from jaxsim.data.synthetic.solids import Look, Model, Pattern


def house(rng: np.random.Generator, *, length: float, floors: int, shops: bool) -> tuple[Model, float]:
    """A house whose fronts run along x, about its middle; and its depth."""
    brick = bool(rng.random() < 0.35)
    depth, eaves = float(rng.uniform(8.0, 12.0)), floors * FLOOR_M + float(rng.uniform(0.3, 0.7))
    wall, roof = palette.wall(rng, brick=brick), palette.roof(rng)
    bay = length / max(1, round(length / rng.uniform(2.4, 3.6)))
    style = float(rng.uniform(0.72, 1.0) if shops else rng.uniform(0.0, 0.69))
    seed = 2 * int(rng.integers(1 << 18)) + brick
    size = (length / 2, depth / 2, eaves)
    look = look_of("building", wall, roof, pattern=Pattern.FACADE, half_m=size, seed=seed, extra=(bay, style))
    model = Model()
    half, pitched = length / 2, bool(rng.random() < (0.55 if floors > 3 else 0.9))
    if not pitched:
        model.box((-half, -depth / 2, 0.0), (half, depth / 2, eaves + 0.4), look)
        return model, depth
    slope = float(np.tan(np.deg2rad(rng.uniform(28, 45))))
    cuts = [(0.0, side * slope, 1.0, eaves + slope * depth / 2) for side in (-1.0, 1.0)]
    if rng.random() < 0.3:
        cuts += [(side * slope, 0.0, 1.0, eaves + slope * half) for side in (-1.0, 1.0)]
    ridge = eaves + slope * depth / 2
    model.box((-half, -depth / 2, 0.0), (half, depth / 2, ridge), look, cuts=cuts)
    if rng.random() < 0.7:
        x, y = rng.uniform(-0.6, 0.6) * half, rng.uniform(-0.2, 0.2) * depth
        pot = look_of("building", roof)
        model.box((x - 0.35, y - 0.3, eaves), (x + 0.35, y + 0.3, ridge + 0.8), pot)
    return model, depth


def _leaf_look(rng: np.random.Generator) -> Look:
    dark, light = palette.leaves(rng)
    return look_of("vegetation", dark, light, pattern=Pattern.LEAF)


def tree(rng: np.random.Generator) -> Model:
    """A trunk with limbs under a crown of several balls; sometimes a conifer."""
    model, look = Model(), _leaf_look(rng)
    bark = look_of("vegetation", palette.Paint(palette.vary(rng, palette.BARK.rgb, 0.2), palette.BARK.nir))
    height, path = float(rng.uniform(5.0, 11.0)), float(rng.uniform(0.7, 1.3))
    if rng.random() < 0.15:
        model.cylinder((0, 0, 0), (0, 0, 0.3 * height), bark, radius=0.16)
        for share, width in ((0.25, 0.24), (0.45, 0.19), (0.65, 0.13), (0.85, 0.07)):
            radii = (width * height, width * height, 0.2 * height)
            model.crown((0, 0, share * height), radii, look, path_m=path)
        return model
    fork = height * float(rng.uniform(0.28, 0.4))
    radius = 0.018 * height + 0.05
    model.cylinder((0, 0, 0), (0, 0, 1.15 * fork), bark, radius=radius)
    spread = height * float(rng.uniform(0.17, 0.26))
    count = int(rng.integers(6, 10))
    # Balls of leaves all round, the first on top.
    turn = rng.uniform(0, 2 * np.pi)
    for i in range(count):
        angle = turn + 2 * np.pi * i / (count - 1)
        out = 0.0 if i == 0 else spread * rng.uniform(0.45, 1.05)
        up = height * (0.8 if i == 0 else rng.uniform(0.48, 0.8))
        x, y = out * np.cos(angle), out * np.sin(angle)
        size = spread * rng.uniform(0.5, 0.9)
        model.crown((x, y, up), (size, size, 0.85 * size), look, path_m=path)
        if 0 < i < 4:
            model.cylinder((0, 0, fork), (x * 0.8, y * 0.8, up), bark, radius=0.4 * radius)
    return model


def bush(rng: np.random.Generator) -> Model:
    """One to three balls of leaves."""
    model, look = Model(), _leaf_look(rng)
    for _ in range(int(rng.integers(1, 4))):
        r = float(rng.uniform(0.4, 0.9))
        x, y = rng.uniform(-0.6, 0.6, 2)
        model.crown((x, y, 0.6 * r), (r, r, 0.8 * r), look, path_m=0.15)
    return model


def hedge(rng: np.random.Generator, length: float) -> Model:
    """A hedge of this length along x."""
    model = Model()
    height = float(rng.uniform(0.9, 1.9))
    model.box((-length / 2, -0.3, 0.0), (length / 2, 0.3, height), _leaf_look(rng))
    return model


def fence(rng: np.random.Generator, length: float) -> Model:
    """A board fence or a low wall."""
    model = Model()
    paint = palette.wall(rng, brick=bool(rng.random() < 0.4))
    height = float(rng.uniform(0.6, 1.5))
    model.box((-length / 2, -0.07, 0.0), (length / 2, 0.07, height), look_of("fence", paint))
    return model


def lamp_post(rng: np.random.Generator) -> Model:
    """A post whose arm reaches along +y, over the road."""
    model = Model()
    paint = palette.METAL if rng.random() < 0.6 else palette.DARK_METAL
    look = look_of("pole", paint, gloss=paint.gloss)
    height = float(rng.uniform(5.5, 8.0))
    model.cylinder((0, 0, 0), (0, 0, height), look, radius=0.065)
    model.cylinder((0, 0, 0), (0, 0, 1.1), look, radius=0.09)
    model.cylinder((0, 0, height - 0.1), (0, 1.3, height + 0.15), look, radius=0.04)
    model.box((-0.13, 1.2, height + 0.08), (0.13, 1.8, height + 0.22), look)
    return model


def bollard() -> Model:
    """A bollard of dark metal."""
    model = Model()
    model.cylinder((0, 0, 0), (0, 0, 0.95), look_of("pole", palette.DARK_METAL), radius=0.06)
    return model


_SIGNS = (
    # Shape, sheet, rim.
    (0.0, "e4e4e0", "a3161b"),
    (0.0, "1d4e9e", "e4e4e0"),
    (1.0, "e4e4e0", "a3161b"),
    (2.0, "1d4e9e", "e4e4e0"),
    (2.0, "d9b21f", "e4e4e0"),
)


def sign(rng: np.random.Generator) -> Model:
    """A sheet on a post, looking along +x."""
    model = Model()
    shape, sheet, rim = _SIGNS[int(rng.integers(len(_SIGNS)))]
    height, r = float(rng.uniform(2.2, 2.6)), float(rng.uniform(0.3, 0.42))
    look = look_of(
        "traffic sign",
        palette.Paint(palette.srgb(sheet), 0.6),
        palette.Paint(palette.srgb(rim), 0.6),
        pattern=Pattern.SIGN,
        half_m=(0.02, r, r),
        extra=(shape, 0.22 * r if shape < 1.5 else 0.03),
        axis_z_m=height,
    )
    model.cylinder((0, 0, 0), (0, 0, height + 0.8 * r), look_of("pole", palette.METAL), radius=0.035)
    if shape < 0.5:
        model.cylinder((0.04, 0, height), (0.06, 0, height), look, radius=r)
    elif shape < 1.5:
        slant = [(0.0, side * 0.866, 0.5, 0.5 * height + 0.5 * r) for side in (-1, 1)]
        model.box((0.04, -r, height - 0.5 * r), (0.06, r, height + r), look, cuts=slant)
    else:
        model.box((0.04, -r, height - r), (0.06, r, height + r), look)
    return model
