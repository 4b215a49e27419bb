"""Measures of a cell's surroundings, against loops over the definition."""

from dataclasses import replace

import jax
import numpy as np
import pytest

from jaxsim.frame import Painted
from jaxsim.prepare import input_channels, network_inputs
from jaxsim.prepare.channels import AROUND, COLOURED, LINES, SIZES, surroundings
from tests.prepare.made_config import config

SHAPE = (9, 12)


@pytest.fixture(scope="module")
def compiled():
    return jax.jit(surroundings)


def scene(seed=0):
    rng = np.random.default_rng(seed)
    draw = lambda *shape: rng.uniform(0, 1, (*SHAPE, *shape)).astype(np.float32)  # noqa: E731
    painted = Painted(
        range_m=0.5 + 150 * draw() ** 2,
        depth_m=draw(),
        rgb=draw(3),
        semantic=np.zeros(SHAPE, np.int32),
        instance=np.zeros(SHAPE, np.int32),
        valid=draw() < 0.7,
        occluded=draw() < 0.2,
    )
    return painted, (draw() * np.pi / 2).astype(np.float32)


def by_hand(painted, angle):
    """The channels of each seen cell, by loops in double precision; unseen ones stay NaN."""
    seen, rgb = painted.valid, painted.rgb.astype(np.float64)
    grey = rgb.mean(-1)
    own = grey[seen]
    level = (grey - own.mean()) / (own.std() + 0.02)
    away = np.log(np.clip(painted.range_m, 1, 120).astype(np.float64)) - 2.5
    found = np.full((*SHAPE, AROUND), np.nan)
    for i, j in np.argwhere(seen):
        cell = [level[i, j], 2 * own.mean() - 1, 4 * (own.std() + 0.02) - 1]
        for size in SIZES:
            h = size // 2
            square = np.s_[max(i - h, 0) : i + h + 1, max(j - h, 0) : j + h + 1]
            m = seen[square]
            a, b = level[square][m], away[square][m]
            cell += [level[i, j] - a.mean(), a.mean(), a.std(), 3 * b.std(), 2 * (away[i, j] - b.mean())]
            cell += [2 * m.sum() / size**2 - 1]
            if size in COLOURED:
                red, green, blue = rgb[square][m].T
                cell += [2 * (angle[square][m] / (np.pi / 2)).mean() - 1, 6 * (red - blue).mean()]
                cell += [6 * (green - (red + green + blue) / 3).mean()]
        for step in LINES:
            k = min(max(i + step, 0), SHAPE[0] - 1)
            cell += [2 * (away[k, j] - away[i, j]), 2 * angle[k, j] / (np.pi / 2) - 1] if seen[k, j] else [0, 0]
        found[i, j] = cell
    return found


def test_every_measure_is_what_a_loop_over_its_definition_gives(compiled):
    painted, angle = scene()
    found = np.asarray(compiled(painted, angle))
    seen = painted.valid
    np.testing.assert_allclose(found[seen], by_hand(painted, angle)[seen], atol=2e-3)
    assert np.isfinite(found).all()


def test_what_the_camera_did_not_see_changes_nothing(compiled):
    painted, angle = scene()
    other, other_angle = scene(1)
    seen = painted.valid
    mixed = replace(
        painted,
        rgb=np.where(seen[..., None], painted.rgb, other.rgb),
        range_m=np.where(seen, painted.range_m, other.range_m),
    )
    np.testing.assert_array_equal(compiled(mixed, np.where(seen, angle, other_angle)), compiled(painted, angle))


def test_another_exposure_leaves_all_but_the_exposure_as_it_was(compiled):
    painted, angle = scene()
    grey = np.repeat(painted.rgb.mean(-1, keepdims=True), 3, axis=-1)
    bright, dark = (compiled(replace(painted, rgb=gain * grey), angle) for gain in (1.0, 0.5))
    np.testing.assert_allclose(np.delete(bright, (1, 2), -1), np.delete(dark, (1, 2), -1), atol=0.35)
    assert np.abs(np.asarray(bright - dark))[..., 1].min() > 0.1


def test_a_mirrored_frame_has_mirrored_surroundings(compiled):
    painted, angle = scene()
    mirrored = jax.tree.map(lambda x: np.ascontiguousarray(x[:, ::-1]), (painted, angle))
    np.testing.assert_allclose(compiled(*mirrored), compiled(painted, angle)[:, ::-1], atol=1e-4)


def test_an_empty_frame_and_a_batch_are_no_special_case():
    painted, angle = scene()
    both = jax.tree.map(lambda x: np.stack([x, np.zeros_like(x)]), (painted, angle))
    row = np.zeros((2, *SHAPE), np.float32)
    settings = config("surroundings", size=SHAPE)
    found = np.asarray(network_inputs(*both, row, prepare=settings))
    assert found.shape == (2, *SHAPE, AROUND)
    assert input_channels(settings) == AROUND
    assert np.isfinite(found).all()
    alone = network_inputs(painted, angle, row[0], prepare=settings)
    np.testing.assert_allclose(found[0], alone, atol=1e-5)
