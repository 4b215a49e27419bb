"""What the paper does with Virtual KITTI: inputs scaled down without projection."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.config import PrepareConfig
from jaxsim.frame import CameraFrame, Frame
from jaxsim.geometry import camera_at_lidar, preset, window_grid
from jaxsim.prepare import dense_view, network_inputs, paint, paint_raster, prepare_view, shrink
from jaxsim.simulate.predict import (
    camera_intensity,
    simulate_frame,
    simulate_unprojected,
)

K = np.array([[60.0, 0, 63.5], [0, 60.0, 19.5], [0, 0, 1]], np.float32)
PREPARE = PrepareConfig(inputs=("rgb", "depth"), network_size=(32, 64))
GRID = window_grid(preset("hdl64e"), 0.75, -0.75, columns=64, rows=(0, 16))
ROW = np.linspace(0, 0.25, 16, dtype=np.float32)


def generate(params, inputs):
    """Not a network: the red channel, so that it can be told where an answer came from."""
    return params * inputs[..., :1]


SETTINGS = {"generate": generate, "prepare": PREPARE}
INTENSITY = jax.jit(partial(camera_intensity, **SETTINGS))
UNPROJECTED = jax.jit(partial(simulate_unprojected, **SETTINGS))


def view(seed: int = 0) -> CameraFrame:
    """A wall 10 m ahead of a camera in the LiDAR's place, its colours at random; no depth in the top rows."""
    rng = np.random.default_rng(seed)
    red = rng.integers(0, 100, (40, 128)) * 255 // 100
    rgb = np.stack([red, 0 * red, 0 * red], axis=-1).astype(np.uint8)
    known = np.ones((40, 128), bool)
    known[:3] = False
    return CameraFrame(rgb, camera_at_lidar(K), np.full((40, 128), 10.0, np.float32), known)


def test_each_pixel_takes_the_answer_of_the_cell_it_falls_into():
    whole = view()
    intensity = np.asarray(INTENSITY(jnp.float32(1), whole, GRID, row_share=ROW))
    small = shrink(whole, (16, 64))
    expected = np.where(small.valid, np.round(np.asarray(small.rgb)[..., 0] * 100) / 100, 0)
    for v, u in [(5, 0), (20, 63), (39, 127), (1, 4)]:
        assert intensity[v, u] == pytest.approx(min(expected[v * 16 // 40, u * 64 // 128], 0.99), abs=0.011)
    assert intensity.shape == (40, 128)


def test_points_lie_where_the_lidar_has_them_with_the_intensity_of_their_pixel():
    whole = view()
    image, painted = UNPROJECTED(jnp.float32(1), whole, GRID, row_share=ROW)
    plain = paint(whole, GRID)
    np.testing.assert_array_equal(image.range_m, plain.range_m)
    np.testing.assert_array_equal(painted.valid, plain.valid)
    per_pixel = INTENSITY(jnp.float32(1), whole, GRID, row_share=ROW)
    carried = np.asarray(paint_raster(per_pixel, whole, GRID))
    np.testing.assert_array_equal(image.intensity, carried)
    np.testing.assert_array_equal(image.valid, np.asarray(plain.valid) & (carried > 0))
    assert 0.2 < np.asarray(image.valid).mean() < 1


def test_a_carried_raster_is_that_of_the_painted_pixel():
    whole = view()
    red = whole.rgb[..., 0].astype(np.float32) / 255
    np.testing.assert_allclose(paint_raster(red, whole, GRID), np.asarray(paint(whole, GRID).rgb)[..., 0], atol=1e-6)


def test_a_batch_is_simulated_as_its_views_are():
    views = [view(k) for k in range(2)]
    batch = jax.tree.map(lambda *leaves: np.stack(leaves), *views)
    together, _ = UNPROJECTED(jnp.float32(1), batch, GRID, row_share=ROW)
    for k, one in enumerate(views):
        alone, _ = UNPROJECTED(jnp.float32(1), one, GRID, row_share=ROW)
        np.testing.assert_array_equal(together.intensity[k], alone.intensity)


def test_the_network_is_given_what_it_was_trained_with():
    prepare = PrepareConfig(
        inputs=("incidence", "depth"), network_size=(16, 64), image_crop=(40, 128), columns=64, depth="given"
    )
    street = Frame("street-0", "street", view(), None)
    pair, grid = prepare_view(street, preset("hdl64e"), prepare)
    trained = network_inputs(pair.painted, pair.incidence_rad, pair.row_share, prepare=prepare)
    given = []

    def watched(params, inputs):
        given.append(np.asarray(inputs)[0])
        return params * inputs[..., :1]

    settings = {"row_share": pair.row_share[:, 0], "generate": watched, "prepare": prepare}
    simulate_frame(jnp.float32(1), dense_view(street, prepare), grid, **settings)
    assert not pair.painted.valid.all()
    assert (pair.incidence_rad[~pair.painted.valid] == np.float32(np.pi / 2)).all()
    np.testing.assert_array_equal(given[0], trained)
