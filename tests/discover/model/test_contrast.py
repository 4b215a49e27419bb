from dataclasses import replace

import numpy as np
import pytest

from jaxsim.data.cityscapes import NAMES
from jaxsim.discover.model.contrast import (
    MOST_CLASSES,
    OF_NO_CLASS,
    PATCH_RAD,
    PATCH_ROWS,
    SCALES,
    class_trend,
    contrast_of,
    within_classes,
)
from tests.discover.noisy_street import COLUMNS, ROWS, scan


def told_of(frames):
    """The contrast of all rays, rows first."""
    places = np.moveaxis(np.indices(np.asarray(frames.hit).shape), 2, 3)
    index = places[0], places[1], places[2]
    told = contrast_of(frames, index, given_rad=np.asarray(frames.incidence_rad))
    assert told.scales[: len(SCALES)] == SCALES
    assert len(told.scales) == told.nats.shape[-1]
    return np.moveaxis(told.nats, 1, 2)


def mean_about(light, counts, row, column, half):
    """The mean over a window about one cell of a full turn, cell by cell."""
    of = []
    for i in range(row - half[0], row + half[0] + 1):
        for j in range(column - half[1], column + half[1] + 1):
            if 0 <= i < ROWS and counts[i, j % COLUMNS]:
                of.append(light[i, j % COLUMNS])
    return np.mean(of)


def test_cells_and_patches_are_held_against_what_returned_about_them():
    frames, _ = scan(None, 1)
    told = told_of(frames)
    assert told.shape[:3] == (1, ROWS, COLUMNS)
    counts = np.asarray(frames.hit)[0]
    light = np.log(np.maximum(np.asarray(frames.intensity, float)[0], 1e-4))
    patch = PATCH_ROWS, round(PATCH_RAD / (2 * np.pi / COLUMNS))
    # Amid the street, at its top and bottom, and at the seam of the turn.
    for row, column in ((12, 100), (ROWS - 1, 0), (9, COLUMNS - 1), (10, 240)):
        assert counts[row, column]
        near = mean_about(light, counts, row, column, (1, 1))
        far = mean_about(light, counts, row, column, patch)
        expected = [light[row, column] - near, near - far]
        np.testing.assert_allclose(told[0, row, column, :2], np.clip(expected, -1, 1), atol=1e-5)


def test_a_cell_without_a_reading_has_no_contrast_and_makes_none():
    frames, _ = scan(None, 1)
    intensity = np.array(frames.intensity)
    intensity[0, 12, 100] = 0
    dark = replace(frames, intensity=intensity)
    before, after = told_of(frames), told_of(dark)
    np.testing.assert_array_equal(after[0, 12, 100], 0)
    np.testing.assert_allclose(after[0, 12, 101, :2], before[0, 12, 101, :2], atol=0.05)


def test_surfaces_are_held_against_what_is_usual_of_their_class():
    rng = np.random.default_rng(0)
    n = 4000
    angle, range_m, kind = rng.uniform(0, 1.2, n), rng.uniform(4, 50, n), rng.choice([7, 11], n)
    usual = 0.8 * np.log(np.cos(angle)) - 1.5 * np.log(range_m) + np.where(kind == 7, -1.0, 0.2)
    own = rng.normal(0, 0.2, n)
    told = class_trend(usual + own, semantic=kind, incidence_rad=angle, range_m=range_m)
    np.testing.assert_allclose(told, usual, atol=0.05)
    # Of a class of few rays the mean alone is told.
    few = class_trend(usual[:10], semantic=kind[:10] * 0, incidence_rad=angle[:10], range_m=range_m[:10])
    assert few == pytest.approx(np.full(10, usual[:10].mean()))


def test_a_trend_holds_what_the_nearest_rays_that_are_told_say():
    rng = np.random.default_rng(1)
    n = 2000
    angle, kind = rng.uniform(0, 1.2, n), rng.choice([7, 11], n)
    level = np.log(np.cos(angle))
    steep = angle < 0.9
    # Beyond what is told anything may stand.
    told = class_trend(
        np.where(steep, level, 9.0), semantic=kind, incidence_rad=angle, range_m=np.full(n, 10.0), telling=steep
    )
    np.testing.assert_allclose(told[steep], level[steep], atol=1e-3)
    np.testing.assert_allclose(told[~steep], np.log(np.cos(0.9)), atol=2e-3)
    none = class_trend(level, semantic=kind, incidence_rad=angle, range_m=np.full(n, 10.0), telling=steep & (kind == 7))
    assert (none[kind == 11] == 0).all()


def within(semantic, light, angle=0.1):
    """The contrast within classes of rays, row by row the same, that lie at one range and, unless told, one angle."""
    frames, _ = scan(None, 1)
    n = frames.hit.shape[-1]
    wide = {"semantic": np.resize(semantic, (1, ROWS, n)), "intensity": np.resize(np.exp(light), (1, ROWS, n))}
    far = np.full((1, ROWS, n), 10.0, np.float32)
    angles = np.resize(np.asarray(angle, np.float32), far.shape)
    frames = replace(frames, **wide, hit=np.ones((1, ROWS, n), bool), range_m=far, incidence_rad=angles)
    places = np.moveaxis(np.indices((1, ROWS, n)), 2, 3)
    return within_classes(frames, (places[0], places[1], places[2]), given_rad=angles)


def test_each_class_has_a_scale_of_what_is_over_its_usual():
    semantic, light = np.array([7, 7, 11, 11]), np.array([-1.0, -0.8, -0.3, -0.7])
    told = within(semantic, light)
    # Of no other classes there is no scale.
    assert told.scales == ("road", "building")
    of_rays = np.unique(told.nats.reshape(-1, 2).round(3), axis=0)
    np.testing.assert_allclose(of_rays, [[-0.1, 0], [0, -0.2], [0, 0.2], [0.1, 0]], atol=2e-3)


def test_paint_stands_as_far_over_asphalt_as_it_does():
    told = within(np.tile([7, 7, 7, 7, 11], 2), np.tile([-2.5, -2.5, -2.5, -0.5, -1.0], 2))
    assert told.nats[..., 0].max() == pytest.approx(1.5, abs=0.02)


def test_the_classes_of_fewer_rays_share_a_scale():
    kinds = np.arange(7, 7 + MOST_CLASSES + 3)
    # The last three are seen half as often.
    semantic = np.concatenate([kinds, kinds[:MOST_CLASSES]])
    told = within(np.tile(semantic, 2), np.repeat([-0.5, -0.7], len(semantic)))
    assert told.scales == (*(NAMES[kind] for kind in kinds[:MOST_CLASSES]), "other_classes")
    assert np.abs(told.nats[..., -1]).max() > 0.05


def test_where_no_class_is_told_dark_and_bright_surfaces_stand_apart():
    # Seen aslant they are dark, and each kind differs by its own from what is usual there.
    told = within(np.zeros(4, int), np.array([-2.1, -1.9, -1.3, -0.7]), angle=[1.2, 1.2, 0.1, 0.1])
    assert told.scales == OF_NO_CLASS
    of_rays = np.unique(told.nats.reshape(-1, 2).round(3), axis=0)
    np.testing.assert_allclose(of_rays, [[-0.1, 0], [0, -0.3], [0, 0.3], [0.1, 0]], atol=2e-3)
