"""From what readers deliver to what effects act on."""

from dataclasses import replace

import numpy as np
import pytest

from jaxsim.effects.scan import nearest_glare, scan_of
from jaxsim.frame import PolarImage
from jaxsim.geometry import incidence
from tests.effects.streets import directions_of, grid_of, road_and_walls


def image(rows=24, columns=96, range_m=10.0):
    shape = (rows, columns)
    return PolarImage(np.full(shape, range_m, "f4"), np.full(shape, 0.2, "f4"), np.ones(shape, bool))


def test_what_files_hold_becomes_the_scan():
    grid, one = grid_of(), image()
    one.valid[0, 0] = False
    more = {
        "incidence": np.full((24, 96), 0.3),
        "semantic": np.full((24, 96), 26, np.uint8),
        "rgb": np.full((24, 96, 3), 255, np.uint8),
        "time": np.tile(np.linspace(5, 5.05, 96), (24, 1)),
    }
    scan = scan_of(
        grid, [one, one], [more, more], about=[{"time": 1e9, "speed": 3.0}, {"time": 1e9 + 0.5, "speed": 4.0}]
    )
    assert not scan.hit[0, 0, 0]
    assert scan.range_m[0, 0, 0] == 0
    assert (scan.semantic[scan.hit] == 26).all()
    np.testing.assert_allclose(scan.incidence_rad[scan.hit], 0.3, rtol=1e-6)
    np.testing.assert_allclose(scan.rgb, 1)
    np.testing.assert_allclose(scan.phase[0, 5], np.linspace(0, 1, 96), atol=1e-5)
    np.testing.assert_allclose(scan.time_s, [0, 0.5])
    np.testing.assert_allclose(scan.speed_mps, [3, 4])
    np.testing.assert_allclose(scan.heading_rad, 0)


def test_what_is_missing_comes_from_the_range_image_and_the_column():
    grid = grid_of()
    street = road_and_walls(grid)
    one = PolarImage(*(np.asarray(x[0]) for x in (street.range_m, street.intensity, street.hit)))
    scan = scan_of(grid, [one])
    angle, known = (np.asarray(x) for x in incidence(one.range_m, one.valid, grid))
    np.testing.assert_array_equal(scan.incidence_rad[0][known], angle[known])
    np.testing.assert_allclose(scan.phase[0, 3], (np.arange(96) + 0.5) / 96, rtol=1e-6)
    assert (scan.semantic == 0).all()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"semantic": np.full((24, 96), 255)}, "Cityscapes ids"),
        ({"incidence": np.full((24, 96), 45.0)}, "radians"),
        ({"incidence": np.full((24, 96), np.nan)}, "radians"),
        ({"rgb": np.zeros((3, 24, 96))}, r"rgb is \(3, 24, 96\), the grid \(24, 96\)"),
    ],
)
def test_values_that_cannot_be_are_refused(change, message):
    with pytest.raises(ValueError, match=message):
        scan_of(grid_of(), [image()], [change])


def test_counts_and_grids_must_agree():
    with pytest.raises(ValueError, match="no frames"):
        scan_of(grid_of(), [])
    with pytest.raises(ValueError, match="one each"):
        scan_of(grid_of(), [image()], [{}, {}])
    with pytest.raises(ValueError, match="range is"):
        scan_of(grid_of(), [image(columns=95)])
    one_column = replace(grid_of(), azimuth_rad=np.zeros(1))
    with pytest.raises(ValueError, match="a grid of 1 columns has no step"):
        scan_of(one_column, [image(columns=1)])
    with pytest.raises(ValueError, match=r"speed is given for some .* lack it \(numbers "):
        scan_of(grid_of(), [image(), image()], about=[{"speed": 1.0}, {}])


@pytest.mark.parametrize("turn", [2 * np.pi, 1.2])
def test_the_nearest_glare_is_that_of_a_plain_search(turn):
    grid = grid_of(turn)
    r = np.random.default_rng(1)
    bright = r.uniform(size=(24, 96)) > 0.995
    bright[3, 0] = bright[20, 95] = True
    range_m = r.uniform(3, 60, (24, 96)).astype("f4")
    target_m, angle = nearest_glare(grid, range_m, bright)
    ray = directions_of(grid.azimuth_rad.astype(float)[None], grid.elevation_rad.astype(float)[:, None])
    apart = np.arccos(np.clip(np.einsum("ijk,nk->ijn", ray, ray[bright]), -1, 1))
    near = apart.min(-1) < 0.25
    # Angles on the sphere and on its cylinder differ by the width of a hair within the reach.
    np.testing.assert_allclose(angle[near], apart.min(-1)[near], rtol=0.05, atol=2e-3)
    assert (angle[apart.min(-1) > 0.32] > 3).all()
    assert (angle[bright] == 0).all()
    np.testing.assert_array_equal(target_m[bright], range_m[bright])
    second = np.sort(apart, -1)[..., 1]
    clear = near & (second > apart.min(-1) * 1.1 + 3e-3)
    np.testing.assert_array_equal(target_m[clear], range_m[bright][apart.argmin(-1)[clear]])


def test_a_frame_without_bright_targets_has_no_glare():
    target_m, angle = nearest_glare(grid_of(), np.ones((24, 96), "f4"), np.zeros((24, 96), bool))
    assert (angle > 3).all()
    assert np.isfinite(target_m).all()
