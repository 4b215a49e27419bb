"""What a camera's rasters can be: what is right passes, whatever a scene holds; what is not is told."""

import inspect
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.data.synthetic import kitti_camera
from jaxsim.frame import CameraFrame
from jaxsim.geometry.rasters import check_metres, check_rasters, check_shapes, nearest_known, on_host

SIZE = (48, 64)


def view(depth_m=12.0, valid=True, batch=()):
    shape = (*batch, *SIZE)
    depth = np.broadcast_to(np.asarray(depth_m, np.float32), shape)
    mask = None if valid is None else np.broadcast_to(np.asarray(valid), shape)
    return CameraFrame(
        np.full((*shape, 3), 90, np.uint8), kitti_camera(), depth, mask, np.full(shape, 7), np.zeros(shape, np.int32)
    )


def road(sky):
    """A road from 6 m to the horizon, and above it what a renderer has for the sky."""
    rows = np.arange(SIZE[0])[:, None]
    below = np.maximum(rows - SIZE[0] // 2, 0.02)
    return np.broadcast_to(np.where(rows > SIZE[0] // 2, 130 / below, sky), SIZE)


@pytest.mark.parametrize("sky", [np.nan, np.inf, 0.0, 655.35, 1000.0, 65535.0])
def test_an_empty_highway_passes_whatever_the_sky_is(sky):
    check_rasters(view(road(sky), valid=None), "here")
    check_rasters(view(road(sky), valid=road(sky) > 0), "here")


@pytest.mark.parametrize("metres", [0.8, 1.2, 3.0, 80.0])
def test_rooms_and_whatever_stands_before_the_camera_pass(metres):
    walls = np.full(SIZE, metres)
    walls[0, 0] = 4.0
    check_rasters(view(walls), "here")


def test_other_types_of_right_numbers_pass():
    one = view(road(0.0), valid=None)
    for kind in (np.float16, np.float32, np.float64, np.int32, np.uint16):
        check_rasters(replace(one, depth_m=one.depth_m.astype(kind)), "here")
    for kind in (np.uint8, np.int16, np.int64):
        check_rasters(replace(one, semantic=one.semantic.astype(kind), instance=one.instance.astype(kind)), "here")
    check_rasters(replace(one, semantic=None, instance=None, depth_m=None), "here")
    check_rasters(jax.tree.map(jnp.asarray, view()), "here")


@pytest.mark.parametrize("name", ["depth_m", "semantic", "instance"])
def test_bytes_in_another_machines_order_are_told(name):
    """A compiled program would read them in its own."""
    raster = getattr(view(), name)
    other = replace(view(), **{name: raster.astype(raster.dtype.newbyteorder())})
    with pytest.raises(ValueError, match=rf"here: {name} holds .*order of another machine; take"):
        check_shapes(other, "here")


def test_objects_numbers_of_more_than_32_bits_are_told():
    """Cut off, two objects would become one, and their edge nothing."""
    one = view()
    with pytest.raises(ValueError, match=r"here: instance spans 0\.\..*32 bits: number them anew"):
        check_rasters(replace(one, instance=np.arange(one.instance.size, dtype=np.int64).reshape(SIZE) << 32), "here")


def test_a_mask_that_would_be_lost_is_told():
    masked = np.ma.masked_greater(road(70.0), 50)
    with pytest.raises(ValueError, match=r"here: depth_m is a masked array.*depth_m\.filled\(0\)"):
        check_shapes(replace(view(), depth_m=masked), "here")


@pytest.mark.parametrize("came", [None, "view", np.zeros((4, 4, 3), np.uint8)])
def test_what_is_no_view_is_told(came):
    with pytest.raises(ValueError, match=rf"here: {type(came).__name__} came; give a CameraFrame"):
        inspect.unwrap(check_shapes)(came, "here")


def test_no_view_is_told():
    with pytest.raises(ValueError, match=r"rgb is \(0, 48, 64, 3\), without a pixel"):
        check_shapes(view(batch=(0,)), "here")


def test_a_batch_tells_which_view_is_wrong():
    check_rasters(view(batch=(2,)), "here")
    depth = np.full((2, *SIZE), 12.0, np.float32)
    depth[1] *= 1000
    with pytest.raises(ValueError, match=r"here: depth_m of view 1 \(float32\) is 12000 in its nearest tenth"):
        check_rasters(view(depth, batch=(2,)), "here")


def test_a_mask_decides_what_counts():
    known = np.zeros(SIZE, bool)
    known[5, 5] = True
    depth = np.where(known, 9.0, -1.0)
    check_rasters(view(depth, valid=known), "here")
    with pytest.raises(ValueError, match=r"below 0 in 3071 of 3072 pixels; .* give 0 or NaN where there is nothing"):
        check_rasters(view(depth, valid=None), "here")
    with pytest.raises(ValueError, match=r"0 or less in 3071 of 3072 pixels; .* give False in depth_valid"):
        check_rasters(view(np.where(known, 9.0, 0.0)), "here")
    with pytest.raises(ValueError, match=r"depth_valid holds uint8; .*astype\(bool\)"):
        check_rasters(view(depth, valid=known.astype(np.uint8) * 255), "here")


def test_a_view_of_nothing_is_right_in_a_loop_alone():
    nothing = view(np.nan)
    check_rasters(nothing, "here", may_be_empty=True)
    with pytest.raises(ValueError, match="depth_m is known in no pixel"):
        check_rasters(nothing, "here")


def test_an_image_of_0_and_1_is_warned_of():
    one = view()
    with pytest.warns(UserWarning, match="rgb spans 0..1 of 0..255"):
        check_rasters(replace(one, rgb=np.ones_like(one.rgb)), "here")
    check_rasters(replace(one, rgb=np.zeros_like(one.rgb)), "here")


def test_while_jax_traces_shapes_and_types_are_checked():
    @jax.jit
    def depth_of(one):
        check_rasters(one, "here")
        return one.depth_m

    depth_of(view(12_000.0))
    with pytest.raises(ValueError, match="here: depth_m is"):
        depth_of(replace(view(), depth_m=np.ones((3, 3), np.float32)))
    jax.grad(lambda depth_m: depth_of(replace(view(), depth_m=depth_m)).sum())(view().depth_m)


def test_a_list_and_a_grey_image_are_told():
    with pytest.raises(ValueError, match=r"rgb is \(48, 64\); it must be \(h, w, 3\)"):
        check_shapes(replace(view(), rgb=np.zeros(SIZE, np.uint8)), "here")
    with pytest.raises(ValueError, match="semantic holds float64"):
        check_shapes(replace(view(), semantic=np.zeros(SIZE).tolist()), "here")


def test_distances_are_metres():
    check_metres(np.float32([3, 4, 5]), "here")
    with pytest.raises(ValueError, match=r"here \(float32\) is 3000 in its nearest tenth"):
        check_metres(np.float32([3000, 4000]), "here")


def test_what_lies_on_the_host_is_known():
    assert on_host(view())
    assert on_host(jax.tree.map(jnp.asarray, view()))


def test_the_nearest_known_pixel_is_told_with_its_distance():
    known = np.zeros((6, 9), bool)
    known[1, 2] = known[4, 7] = True
    away_px, place = nearest_known(known)
    here = np.stack(np.mgrid[:6, :9], -1)[:, :, None]
    exact = np.linalg.norm(here - np.argwhere(known), axis=-1)
    assert away_px == pytest.approx(exact.min(-1), rel=0.05)
    chosen = np.take_along_axis(exact, (place == 4 * 9 + 7)[..., None].astype(int), -1)[..., 0]
    assert (chosen - exact.min(-1)).max() < 0.1
    assert {*place.ravel()} == {1 * 9 + 2, 4 * 9 + 7}
    assert not nearest_known(np.zeros((3, 4), bool))[1].any()
