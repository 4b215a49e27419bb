"""What stands along a street, houses, trees, hedges, posts and signs, and who uses it: cars of several shapes, vans and
trucks; pedestrians and cyclists.

A car is a lower body with bonnet and tail, a cabin of glass with a roof, and four wheels; people are made of long and
round balls. x forward, origin on the road beneath the middle.
"""

from __future__ import annotations

from dataclasses import dataclass

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


@dataclass(frozen=True)
class CarShape:
    """Side view of a car, metres; x of the cabin's corners as shares of half the length."""

    length: float
    width: float
    height: float
    belt: float
    """Height of the windows' lower edge."""
    bonnet: float
    """Height of the bonnet's front edge."""
    tail: float
    """Height of the tail's rear edge."""
    screen: tuple[float, float]
    """Windscreen: x of its foot and of its head."""
    rear: tuple[float, float]
    """Rear window: x of its head and of its foot."""
    kind: str = "Car"


CAR_SHAPES = {
    "hatchback": CarShape(4.05, 1.76, 1.48, 0.95, 0.72, 0.93, (0.52, 0.12), (-0.70, -0.97)),
    "saloon": CarShape(4.65, 1.82, 1.45, 0.94, 0.72, 0.90, (0.42, 0.08), (-0.42, -0.74)),
    "estate": CarShape(4.70, 1.82, 1.49, 0.95, 0.73, 0.93, (0.42, 0.08), (-0.82, -0.98)),
    "suv": CarShape(4.55, 1.88, 1.70, 1.08, 0.92, 1.05, (0.46, 0.14), (-0.78, -0.97)),
    "van": CarShape(5.00, 1.96, 2.05, 1.15, 0.98, 1.12, (0.74, 0.42), (-0.95, -0.99), "Van"),
}


def plane(through: tuple[float, float], other: tuple[float, float]) -> tuple[float, float, float, float]:
    """Plane across the car through two points (x, z) of its side view; what lies below it is kept."""
    dx, dz = other[0] - through[0], other[1] - through[1]
    normal = (-dz, dx) if dx > 0 else (dz, -dx)
    return normal[0], 0.0, normal[1], normal[0] * through[0] + normal[1] * through[1]


def car(rng: np.random.Generator, shape: CarShape) -> tuple[Model, tuple[float, float, float]]:
    """A car of that shape, slightly varied, and its length, width, height."""
    # One model differs from the next of its kind by a few per cent.
    scale = rng.normal(1.0, 0.025, 3).clip(0.94, 1.06)
    length, width, height = np.multiply((shape.length, shape.width, shape.height), scale)
    belt, bonnet, tail = np.multiply((shape.belt, shape.bonnet, shape.tail), scale[2])
    half, wide = length / 2, width / 2
    foot, head = np.multiply(shape.screen, half)
    rear_head, rear_foot = np.multiply(shape.rear, half)
    paint = palette.car_paint(rng)
    radius = float(rng.uniform(0.30, 0.34)) * (1.08 if shape.height > 1.6 else 1.0)
    axle = 0.30 * length
    size = (half, wide, height)
    seed = int(rng.integers(1 << 20))

    shared = {"half_m": size, "seed": seed, "gloss": paint.gloss, "absorbing": paint.absorbing}
    body = look_of("car", paint, palette.RED_LAMP, pattern=Pattern.CAR_BODY, extra=(axle, radius), **shared)
    pillar = (belt, 0.5 * (head + rear_head))
    cabin = look_of("car", paint, palette.RED_LAMP, pattern=Pattern.CAR_CABIN, extra=pillar, **shared)
    model = Model()
    lean = 0.10
    model.box(
        (-half, -wide, 0.19),
        (half, wide, belt),
        body,
        cuts=(
            plane((half, bonnet), (foot, belt)),
            plane((rear_foot, belt), (-half - 0.02, tail - 0.03)),
            # Flanks lean in towards the belt, corners are cut: a box would reflect like a wall.
            (0.0, 1.0, 0.45, wide + 0.45 * 0.72 * belt),
            (0.0, -1.0, 0.45, wide + 0.45 * 0.72 * belt),
            (1.0, 0.8, 0.0, half + 0.8 * (wide - 0.32)),
            (1.0, -0.8, 0.0, half + 0.8 * (wide - 0.32)),
        ),
    )
    # As wide as the leaning flanks are at the belt.
    inner = wide - 0.45 * 0.28 * belt
    model.box(
        (rear_foot - 0.02, -inner, belt - 0.05),
        (foot + 0.02, inner, height),
        cabin,
        cuts=(
            plane((foot, belt), (head, height)),
            plane((rear_head, height), (rear_foot, belt)),
            (0.0, 1.0, 0.32, inner + 0.32 * belt),
            (0.0, -1.0, 0.32, inner + 0.32 * belt),
            (0.0, lean, 1.0, lean * 0.6 * inner + height),
            (0.0, -lean, 1.0, lean * 0.6 * inner + height),
        ),
    )
    _wheels(model, "car", (axle, -axle), radius=radius, wide=wide)
    return model, (float(length), float(width), float(height))


def _wheels(model: Model, class_name: str, axles: tuple[float, ...], *, radius: float, wide: float) -> None:
    for x in axles:
        look = look_of(class_name, palette.TYRE, palette.RIM, pattern=Pattern.WHEEL, extra=(abs(x), radius))
        for side in (-1, 1):
            model.cylinder((x, side * (wide - 0.22), radius), (x, side * wide, radius), look, radius=radius)


def truck(rng: np.random.Generator) -> tuple[Model, tuple[float, float, float]]:
    """A delivery lorry: cab, box, chassis, wheels; and its length, width, height."""
    length = rng.uniform(6.5, 9.5)
    width = rng.uniform(2.3, 2.5)
    height = rng.uniform(2.9, 3.5)
    half, wide = length / 2, width / 2
    cab_end, cab_height = half - rng.uniform(1.8, 2.1), rng.uniform(2.3, 2.6)
    paint, box = palette.car_paint(rng), palette.wall(rng, brick=False)
    band = palette.car_paint(rng)
    model = Model()
    cab = look_of(
        "truck",
        paint,
        pattern=Pattern.CAR_CABIN,
        half_m=(half, wide, cab_height - 0.15),
        extra=(1.35, (cab_end + half) / 2),
        gloss=0.05,
        absorbing=paint.absorbing,
    )
    model.box(
        (cab_end, -wide + 0.05, 0.45),
        (half, wide - 0.05, cab_height),
        cab,
        cuts=(
            plane((half, 1.3), (half - 0.28, cab_height)),
            (1.0, 0.7, 0.0, half + 0.7 * (wide - 0.25)),
            (1.0, -0.7, 0.0, half + 0.7 * (wide - 0.25)),
        ),
    )
    seed = int(rng.integers(1 << 20))
    model.box(
        (-half, -wide, 0.95),
        (cab_end - 0.15, wide, height),
        look_of("truck", box, band, pattern=Pattern.TRUCK_BOX, half_m=(half, wide, height), seed=seed),
    )
    model.box((-half + 0.1, -0.75, 0.5), (half - 0.4, 0.75, 0.96), look_of("truck", palette.DARK_METAL))
    _wheels(model, "truck", (half - 1.2, -half + 1.6), radius=0.46, wide=wide - 0.02)
    return model, (float(length), float(width), float(height))


def _dress(rng: np.random.Generator, class_name: str) -> dict[str, Look]:
    hair = palette.vary(rng, palette.srgb(str(rng.choice(("2a2019", "5a4028", "8d7350", "b9b3a8")))), 0.1)
    looks = {"coat": palette.cloth(rng), "trousers": palette.cloth(rng), "skin": palette.skin(rng)}
    dressed = {name: look_of(class_name, paint) for name, paint in looks.items()}
    dressed["hair"] = look_of(class_name, palette.Paint(hair, 0.25))
    dressed["shoes"] = look_of(class_name, palette.Paint(palette.TYRE.rgb, 0.15))
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
    dress = _dress(rng, "person")
    model = Model()
    for side in (-1, 1):
        foot = side * stride
        knee = (0.4 * foot + 0.04, side * 0.095, 0.27 * h)
        model.limb((0.0, side * 0.085, 0.53 * h), knee, dress["trousers"], radius=0.085 * stout)
        model.limb((knee[0], knee[1], 0.31 * h), (foot, side * 0.1, 0.03 * h), dress["trousers"], radius=0.065 * stout)
        model.ball((foot + 0.06, side * 0.1, 0.035), (0.14, 0.05, 0.04), dress["shoes"])
        # Arms swing against the legs.
        hand = (-0.7 * foot + 0.05, side * 0.26 * stout, 0.47 * h)
        model.limb((0.0, side * 0.2 * stout, 0.82 * h), hand, dress["coat"], radius=0.058 * stout)
    model.ball((0.0, 0.0, 0.67 * h), (0.13 * stout, 0.205 * stout, 0.195 * h), dress["coat"])
    model.limb((0.0, 0.0, 0.48 * h), (0.0, 0.0, 0.7 * h), dress["coat"], radius=0.16 * stout)
    model.cylinder((0.0, 0.0, 0.82 * h), (0.0, 0.0, 0.88 * h), dress["skin"], radius=0.05)
    _head(model, (0.015, 0.0, h - 0.14 * size), size, dress=dress)
    return model, (2 * stride + 0.44, 0.64 * stout, h + 0.02)


def cyclist(rng: np.random.Generator) -> tuple[Model, tuple[float, float, float]]:
    """A rider on a bicycle, and length, width, height of the box."""
    dress = _dress(rng, "rider")
    paint = palette.car_paint(rng)
    frame = look_of("bicycle", paint, gloss=0.05)
    tyre = look_of("bicycle", palette.TYRE)
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
