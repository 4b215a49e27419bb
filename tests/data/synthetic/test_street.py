"""The ground of a street."""

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxsim.data.synthetic.street import (
    WET_NIR,
    WET_RGB,
    Street,
    cast_ground,
    ground_course,
    ground_surface,
    past_kerb,
)
from tests.data.synthetic.made_raycast import bundle

RAYS = 400


def a_street(wet: float = 0.0) -> Street:
    sides = {"side_x_m": [15.0, 40.0], "side_half_m": [3.0, -1.0], "side_towards": [1.0, -1.0]}
    measures = {"curvature": 4e-4, "half_width_m": 4.0, "kerb_m": 0.12, "pavement_m": 2.0, "parking": 0.0}
    looks = {"crossing_x_m": -500.0, "wear": 0.5, "tone": 0.5, "green": 1.0, "seed": 1.0, "wet": wet}
    numbers = {**sides, **measures, **looks}
    return Street(**{name: np.asarray(value, np.float32) for name, value in numbers.items()})


def slow_past_kerb(x: float, y: float, street: Street) -> float:
    slope = float(street.curvature) * x
    off = (y - 0.5 * slope * x) / np.hypot(1.0, slope)
    distance = abs(off) - float(street.half_width_m)
    for where, half, towards in zip(street.side_x_m, street.side_half_m, street.side_towards, strict=True):
        if half > 0:
            side = max(abs(x - where) - half, -towards * off)
            overlap = max(3.0 - abs(distance - side), 0.0) / 3.0
            distance = min(distance, side) - overlap**2 * 3.0 / 4
    return float(distance)


def test_the_ground_is_met_where_a_march_along_the_ray_goes_under_it() -> None:
    street, rng = a_street(), np.random.default_rng(0)
    eye = np.array([0.0, -2.0, 1.9])
    target = np.stack([rng.uniform(2, 40, RAYS), rng.uniform(-9, 12, RAYS), np.zeros(RAYS)], axis=1)
    aim = target - eye
    aim = aim / np.linalg.norm(aim, axis=1, keepdims=True)
    t, meets, face = (np.asarray(v)[0] for v in cast_ground(street, *bundle(eye, aim)))
    assert meets.all()
    assert 0 < face.sum() < RAYS / 2
    for i in range(0, RAYS, 4):
        s = t[i] - 0.5
        for _ in range(200):
            x, y, z = eye + s * aim[i]
            if z <= (0.12 if slow_past_kerb(x, y, street) >= 0 else 0.0):
                break
            s += 0.005
        assert s == pytest.approx(t[i], abs=0.06 if face[i] else 0.012)


@settings(max_examples=30, deadline=None)
@given(st.floats(-60, 120), st.floats(-12, 12))
def test_past_kerb_is_the_distance_beyond_the_kerb(x: float, y: float) -> None:
    street = a_street()
    fast = past_kerb(street, jnp.float32(x), jnp.float32(y))
    assert float(fast) == pytest.approx(slow_past_kerb(x, y, street), abs=1e-3)


def test_rays_that_rise_never_meet_the_ground() -> None:
    eye, aim = np.array([0.0, 0.0, 1.7]), np.array([[1.0, 0.0, 0.0], [1.0, 0.0, 0.3]])
    _, meets, _ = cast_ground(a_street(), *bundle(eye, aim))
    assert not np.asarray(meets).any()


def test_water_lies_on_a_share_of_the_road_and_takes_light_at_both_wavelengths() -> None:
    x, y = np.meshgrid(np.linspace(-20, 60, 400, dtype=np.float32), np.linspace(-8, 8, 160, dtype=np.float32))
    at = tuple(jnp.asarray(c) for c in (x, y, 0 * x))
    rest = {"pixel_m": jnp.full(x.shape, 0.05, jnp.float32), "course": ground_course(a_street(), at)}
    dry = ground_surface(a_street(), at, jnp.zeros(x.shape, bool), **rest)
    rained = ground_surface(a_street(0.4), at, jnp.zeros(x.shape, bool), **rest)
    road = np.asarray(dry.semantic == 7)
    wet = np.asarray(rained.wet)
    assert not np.asarray(dry.wet).any()
    assert 0.3 < wet[road].mean() < 0.5
    assert not wet[~road].any()
    np.testing.assert_allclose(np.asarray(rained.nir)[wet], WET_NIR * np.asarray(dry.nir)[wet], rtol=1e-5)
    np.testing.assert_allclose(np.asarray(rained.rgb)[:, wet], WET_RGB * np.asarray(dry.rgb)[:, wet], rtol=1e-5)
    np.testing.assert_array_equal(np.asarray(rained.nir)[~wet], np.asarray(dry.nir)[~wet])
    # Paint is brighter than the asphalt that it lies on.
    marking = np.asarray(dry.marking)
    assert 0.002 < marking[road].mean() < 0.2
    assert np.asarray(dry.nir)[marking].min() > np.median(np.asarray(dry.nir)[road & ~marking])
