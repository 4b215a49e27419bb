"""The caster against planes and spheres in closed form; textures have the spread that they promise."""

import numpy as np
import pytest

pytest.importorskip("embreex", reason="the second hidden world casts with embreex: pip install -e '.[worlds]'")

from benchmarks.blind.raycast.chance import stream, value_noise
from benchmarks.blind.raycast.materials import MATERIALS, NAMES, texture_of
from benchmarks.blind.raycast.scenes import Scene


def _rays(number: int = 400):
    direction = np.random.default_rng(0).normal(size=(number, 3))
    return np.zeros((number, 3)), direction / np.linalg.norm(direction, axis=1, keepdims=True)


def test_ranges_and_angles_in_a_room_are_those_of_its_planes():
    scene, half = Scene(), np.array([4.0, 3.0, 2.0])
    for axis in range(3):
        for side in (-1, 1):
            size, middle = 2 * half + 2, np.zeros(3)
            size[axis], middle[axis] = 0.2, side * (half[axis] + 0.1)
            scene.box("plaster", middle, size)
    origin, direction = _rays()
    hits = scene.cast(origin, direction)
    expected = (half / np.abs(direction)).min(1)
    np.testing.assert_allclose(hits.range_m, expected, rtol=1e-6)
    facing = np.take_along_axis(np.abs(direction), (half / np.abs(direction)).argmin(1)[:, None], 1)[:, 0]
    np.testing.assert_allclose(hits.cos, facing, rtol=1e-6)
    assert ((hits.normal * direction).sum(1) < 0).all()


def test_a_ray_past_everything_hits_nothing():
    scene = Scene()
    scene.box("carton", (5, 0, 0), (1, 1, 1), thing=scene.new_thing())
    hits = scene.cast(np.zeros((2, 3)), np.array([[1.0, 0, 0], [-1.0, 0, 0]]))
    assert hits.range_m.tolist() == [4.5, np.inf]
    assert hits.thing.tolist() == [1, 0]
    assert hits.material.tolist() == [NAMES.index("carton"), -1]


def test_value_noise_is_smooth_and_has_unit_spread():
    point = np.random.default_rng(1).uniform(-50, 50, (20000, 3))
    here, beside = value_noise(point, 1.0, 7), value_noise(point + 0.01, 1.0, 7)
    assert here.std() == pytest.approx(1, abs=0.1)
    assert np.abs(here - beside).max() < 0.2
    np.testing.assert_array_equal(here, value_noise(point, 1.0, 7))


@pytest.mark.parametrize("name", MATERIALS)
def test_a_texture_stays_about_its_albedo(name):
    point = np.random.default_rng(2).uniform(-30, 30, (4000, 3))
    nats = texture_of(np.full(4000, NAMES.index(name)), point, 3)
    assert 0.2 < nats.std() < 1.6
    assert abs(nats.mean()) < 0.4


def test_streams_follow_from_their_words_alone():
    a, b, c = (stream(case, "x", 1).normal() for case in ("1", "1", "2"))
    assert a == b != c
