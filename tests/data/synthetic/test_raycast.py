"""The ray caster against slow, obvious float64 arithmetic, one ray at a time."""

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxsim.data.synthetic import fields
from jaxsim.data.synthetic.raycast import FAR_M, LEAF_M, enter_crown, enter_polyhedron, enter_round
from jaxsim.data.synthetic.solids import Look, Model
from jaxsim.data.synthetic.street import Street, cast_ground, past_kerb

STONE = Look(11, (0.5, 0.5, 0.5), 0.4)
RAYS = 400


def rays_at(rng: np.random.Generator, target: np.ndarray, spread: float) -> tuple[np.ndarray, np.ndarray]:
    """One eye, some 5 to 60 m away, and rays that pass the target at about `spread`."""
    away = rng.normal(size=3)
    eye = target + away / np.linalg.norm(away) * rng.uniform(5, 60)
    aim = target + rng.normal(size=(RAYS, 3)) * spread - eye
    return eye, aim / np.linalg.norm(aim, axis=1, keepdims=True) * rng.uniform(0.5, 2.0)


def bundle(eye: np.ndarray, aim: np.ndarray) -> tuple:
    """The kernel's layout: one tile of rays, components first."""
    return jnp.asarray(eye[:, None, None], jnp.float32), jnp.asarray(aim.T[:, None, :], jnp.float32)


def agree(fast: np.ndarray, slow: np.ndarray, metres: float, *, share: float = 1.0) -> None:
    """Hits agree to `metres`; rays that graze an edge may differ in whether they hit at all."""
    both = (fast < FAR_M) & (slow < FAR_M)
    assert np.abs(fast - slow)[both].max(initial=0.0) < metres
    assert np.mean((fast < FAR_M) == (slow < FAR_M)) >= share - 0.01
    assert both.any()


def slow_polyhedron(eye: np.ndarray, aim: np.ndarray, planes: np.ndarray) -> np.ndarray:
    """Nearest point where a ray meets a face's plane inside all the other planes."""
    planes = planes[np.linalg.norm(planes[:, :3], axis=1) > 0]
    out = np.full(len(aim), FAR_M)
    for i, d in enumerate(aim):
        for n in planes:
            if n[:3] @ d < 0:
                s = (n[3] - n[:3] @ eye) / (n[:3] @ d)
                if s > 0 and np.all(planes[:, :3] @ (eye + s * d) <= planes[:, 3] + 1e-9):
                    out[i] = min(out[i], s)
    return out


def slow_round(eye: np.ndarray, aim: np.ndarray, conic: np.ndarray, *, ball: bool, bore: float = 0.0) -> np.ndarray:
    """Nearest point on a side within the caps, or on a cap outside the bore."""
    out = np.full(len(aim), FAR_M)
    axes = [0, 1, 2] if ball else [0, 1]
    for i, d in enumerate(aim):
        start = eye if eye.ndim == 1 else eye[i]
        q, p = conic[:, :3] @ start + conic[:, 3], conic[:, :3] @ d
        a, b, c = p[axes] @ p[axes], 2 * q[axes] @ p[axes], q[axes] @ q[axes] - 1
        hits = []
        if b * b - 4 * a * c > 0:
            side = (-b - np.sqrt(b * b - 4 * a * c)) / (2 * a)
            if ball or abs(q[2] + side * p[2]) <= 1:
                hits.append(side)
        if not ball:
            cap = (-np.sign(p[2]) - q[2]) / p[2]
            x, y = q[:2] + cap * p[:2]
            if x * x + y * y <= 1:
                hits.append(cap if x * x + y * y >= bore * bore else FAR_M)
        out[i] = min([h for h in hits if h > 0], default=FAR_M)
    return out


@pytest.mark.parametrize("seed", range(4))
def test_rays_enter_a_polyhedron_where_its_planes_say(seed: int) -> None:
    rng = np.random.default_rng(seed)
    model = Model()
    low = rng.uniform(-3, 0, 3)
    cuts = [(*rng.normal(size=3), 1.2) for _ in range(4)]
    model.box(tuple(low), tuple(low + rng.uniform(0.3, 5, 3)), STONE, cuts=cuts)
    planes = model.polyhedra[0][0]
    eye, aim = rays_at(rng, low + 0.6, 1.0)
    fast, face = enter_polyhedron(*bundle(eye, aim), planes[None].astype(np.float32))
    slow = slow_polyhedron(eye, aim, planes)
    agree(np.asarray(fast)[0], slow, 1e-3)
    hit = (np.asarray(fast)[0] < FAR_M) & (slow < FAR_M)
    at = eye + slow[hit][:, None] * aim[hit]
    on = planes[np.asarray(face)[0][hit]]
    assert np.abs(np.sum(on[:, :3] * at, axis=1) - on[:, 3]).max() < 1e-3


def test_a_ray_along_a_face_outside_it_misses() -> None:
    model = Model()
    model.box((-1, -1, -1), (1, 1, 1), STONE)
    planes = model.polyhedra[0][0][None].astype(np.float32)
    eye, aim = np.array([-5.0, 0.0, 1.5]), np.array([[1.0, 0.0, 0.0]])
    assert np.asarray(enter_polyhedron(*bundle(eye, aim), planes)[0])[0, 0] == FAR_M
    eye[2] = 0.5
    assert np.asarray(enter_polyhedron(*bundle(eye, aim), planes)[0])[0, 0] == pytest.approx(4.0)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("kind", ["ball", "cylinder", "ring", "thin pole"])
def test_rays_enter_balls_and_cylinders(kind: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    model, start = Model(), rng.uniform(-2, 2, 3)
    end = start + rng.normal(size=3)
    if kind == "ball":
        model.limb(tuple(start), tuple(end), STONE, radius=0.4)
    elif kind == "thin pole":
        model.cylinder(tuple(start), (*start[:2], start[2] + 6.0), STONE, radius=0.03)
    else:
        model.cylinder(tuple(start), tuple(end), STONE, radius=0.6, bore=0.7 if kind == "ring" else 0.0)
    conic, roundness, bore, _ = model.rounds[0]
    thin = kind == "thin pole"
    eye, aim = rays_at(rng, start + np.array([0, 0, 1.0]) if thin else (start + end) / 2, 0.03 if thin else 0.4)
    fast = enter_round(
        *bundle(eye, aim),
        conic[None].astype(np.float32),
        roundness=np.array([roundness], np.float32),
        bore=np.array([bore], np.float32),
    )
    slow = slow_round(eye, aim, conic, ball=kind == "ball", bore=bore)
    agree(np.asarray(fast)[0], slow, 0.01 if thin else 3e-3, share=0.98)


def slow_noise(x: np.ndarray) -> float:
    """Value noise of a point in space, from the lattice's hashes in Python integers."""

    def hashed(i: int, j: int, k: int) -> float:
        mask = 0xFFFFFFFF
        h = (i & mask) * 0x9E3779B1 & mask
        h = ((h ^ h >> 15) + (j & mask) * 0x85EBCA77) & mask
        h = ((h ^ h >> 13) + (k & mask) * 0xC2B2AE3D) & mask
        h = (h ^ h >> 16) * 0x7FEB352D & mask
        h = (h ^ h >> 15) * 0x846CA68B & mask
        return (h >> 8) / 2**24

    corner = np.floor(x).astype(int)

    t = x - corner
    ease = t * t * (3 - 2 * t)
    total = 0.0
    for step in np.ndindex(2, 2, 2):
        weight = np.prod(np.where(step, ease, 1 - ease))
        total += weight * hashed(*(corner + step).tolist())
    return total


def test_noise_is_the_lattice_s_hash_interpolated() -> None:
    points = np.random.default_rng(0).uniform(-50, 50, (200, 3)).astype(np.float32)
    fast = np.asarray(fields.smooth_noise3(*jnp.asarray(points.T)))
    np.testing.assert_allclose(fast, [slow_noise(p.astype(np.float64)) for p in points], atol=1e-5)
    assert abs(fast.mean() - 0.5) < 0.05


@pytest.mark.parametrize("seed", range(3))
def test_leaves_stop_rays_after_their_free_path(seed: int) -> None:
    rng = np.random.default_rng(seed)
    model, middle, path = Model(), rng.uniform(-3, 3, 3), 0.4
    model.crown(tuple(middle), (1.5, 1.2, 1.0), STONE, path_m=path)
    conic = model.crowns[0][0]
    eye, aim = rays_at(rng, middle, 0.8)
    fast = enter_crown(*bundle(eye, aim), conic[None].astype(np.float32), path_m=np.array([path], np.float32))
    enter = slow_round(eye, aim, conic, ball=True)
    leave = -slow_round(eye + 200 * aim, -aim, conic, ball=True) + 200
    slow = np.full(RAYS, FAR_M)
    for i in np.flatnonzero(enter < FAR_M):
        x = (eye + enter[i] * aim[i]) / LEAF_M
        u = 0.4 * slow_noise(0.35 * x) + 0.35 * slow_noise(x) + 0.25 * slow_noise(3.1 * x)
        u = np.clip(1.9 * (u - 0.5) + 0.5, 0.01, 0.98)
        stop = enter[i] - path * np.log(u) / np.linalg.norm(aim[i])
        slow[i] = stop if stop < leave[i] else FAR_M
    agree(np.asarray(fast)[0], slow, 0.02)
    assert np.any((enter < FAR_M) & (slow == FAR_M)), "some rays get through"


def a_street() -> Street:
    sides = {"side_x_m": [15.0, 40.0], "side_half_m": [3.0, -1.0], "side_towards": [1.0, -1.0]}
    measures = {"curvature": 4e-4, "half_width_m": 4.0, "kerb_m": 0.12, "pavement_m": 2.0, "parking": 0.0}
    looks = {"crossing_x_m": -500.0, "wear": 0.5, "tone": 0.5, "green": 1.0, "seed": 1.0}
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
