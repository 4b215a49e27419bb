"""The ray caster against slow, obvious float64 arithmetic, one ray at a time."""

import numpy as np
import pytest

from jaxsim.data.synthetic.raycast import SKY_M, enter_crown, enter_polyhedron, enter_round, entered_face
from jaxsim.data.synthetic.solids import LEAF_M, Look, Model
from tests.data.synthetic.made_raycast import bundle, slow_noise

STONE = Look(11, (0.5, 0.5, 0.5), 0.4)
RAYS = 400


def rays_at(rng: np.random.Generator, target: np.ndarray, spread: float) -> tuple[np.ndarray, np.ndarray]:
    """One eye, some 5 to 60 m away, and rays that pass the target at about `spread`."""
    away = rng.normal(size=3)
    eye = target + away / np.linalg.norm(away) * rng.uniform(5, 60)
    aim = target + rng.normal(size=(RAYS, 3)) * spread - eye
    return eye, aim / np.linalg.norm(aim, axis=1, keepdims=True) * rng.uniform(0.5, 2.0)


def agree(fast: np.ndarray, slow: np.ndarray, metres: float, *, share: float = 1.0) -> None:
    """Hits agree to `metres`; rays that graze an edge may differ in whether they hit at all."""
    both = (fast < SKY_M) & (slow < SKY_M)
    assert np.abs(fast - slow)[both].max(initial=0.0) < metres
    assert np.mean((fast < SKY_M) == (slow < SKY_M)) >= share - 0.01
    assert both.any()


def slow_polyhedron(eye: np.ndarray, aim: np.ndarray, planes: np.ndarray) -> np.ndarray:
    """Nearest point where a ray meets a face's plane inside all the other planes."""
    planes = planes[np.linalg.norm(planes[:, :3], axis=1) > 0]
    out = np.full(len(aim), SKY_M)
    for i, d in enumerate(aim):
        for n in planes:
            if n[:3] @ d < 0:
                s = (n[3] - n[:3] @ eye) / (n[:3] @ d)
                if s > 0 and np.all(planes[:, :3] @ (eye + s * d) <= planes[:, 3] + 1e-9):
                    out[i] = min(out[i], s)
    return out


def slow_round(eye: np.ndarray, aim: np.ndarray, conic: np.ndarray, *, ball: bool, bore: float = 0.0) -> np.ndarray:
    """Nearest point on a side within the caps, or on a cap outside the bore."""
    out = np.full(len(aim), SKY_M)
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
                hits.append(cap if x * x + y * y >= bore * bore else SKY_M)
        out[i] = min([h for h in hits if h > 0], default=SKY_M)
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
    solid = planes[None].astype(np.float32)
    fast, face = (enters(*bundle(eye, aim), solid) for enters in (enter_polyhedron, entered_face))
    slow = slow_polyhedron(eye, aim, planes)
    agree(np.asarray(fast)[0], slow, 1e-3)
    hit = (np.asarray(fast)[0] < SKY_M) & (slow < SKY_M)
    at = eye + slow[hit][:, None] * aim[hit]
    on = planes[np.asarray(face)[0][hit]]
    assert np.abs(np.sum(on[:, :3] * at, axis=1) - on[:, 3]).max() < 1e-3


def test_a_ray_along_a_face_outside_it_misses() -> None:
    model = Model()
    model.box((-1, -1, -1), (1, 1, 1), STONE)
    planes = model.polyhedra[0][0][None].astype(np.float32)
    eye, aim = np.array([-5.0, 0.0, 1.5]), np.array([[1.0, 0.0, 0.0]])
    assert np.asarray(enter_polyhedron(*bundle(eye, aim), planes))[0, 0] == SKY_M
    eye[2] = 0.5
    assert np.asarray(enter_polyhedron(*bundle(eye, aim), planes))[0, 0] == pytest.approx(4.0)


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
    slow = np.full(RAYS, SKY_M)
    for i in np.flatnonzero(enter < SKY_M):
        x = (eye + enter[i] * aim[i]) / LEAF_M
        u = 0.4 * slow_noise(0.35 * x) + 0.35 * slow_noise(x) + 0.25 * slow_noise(3.1 * x)
        u = np.clip(1.9 * (u - 0.5) + 0.5, 0.01, 0.98)
        stop = enter[i] - path * np.log(u) / np.linalg.norm(aim[i])
        slow[i] = stop if stop < leave[i] else SKY_M
    agree(np.asarray(fast)[0], slow, 0.02)
    assert np.any((enter < SKY_M) & (slow == SKY_M)), "some rays get through"
