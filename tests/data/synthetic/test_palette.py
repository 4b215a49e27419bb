"""Paints are colours and reflectances that things can have."""

import numpy as np
import pytest

from jaxsim.data.synthetic import palette

DRAWN = {
    "car": palette.car_paint,
    "wall": lambda rng: palette.wall(rng, brick=False),
    "bricks": lambda rng: palette.wall(rng, brick=True),
    "roof": palette.roof,
    "cloth": palette.cloth,
    "skin": palette.skin,
    "leaf": lambda rng: palette.leaves(rng)[0],
}


def drawn(kind: str, count: int = 200) -> list[palette.Paint]:
    rng = np.random.default_rng(0)
    return [DRAWN[kind](rng) for _ in range(count)]


@pytest.mark.parametrize("kind", DRAWN)
def test_colours_and_reflectances_are_shares_of_the_light(kind):
    paints = drawn(kind)
    assert all(0 < part < 1 for paint in paints for part in (*paint.rgb, paint.nir))
    assert len({paint.rgb for paint in paints}) > 3


def test_carbon_black_is_dark_to_both_and_other_blacks_to_the_eye_alone():
    paints = drawn("car", 2000)
    black = [paint for paint in paints if palette.luminance(paint.rgb) < 0.02]
    carbon = np.array([paint.absorbing > 0 for paint in black])
    nir = np.array([paint.nir for paint in black])
    assert nir[carbon].max() < 0.07
    assert nir[~carbon].min() > 0.14


@pytest.mark.parametrize("kind", ["leaf", "cloth", "skin"])
def test_plants_dyes_and_skin_are_brighter_to_the_lidar_than_to_the_eye(kind):
    assert np.mean([paint.nir - palette.luminance(paint.rgb) for paint in drawn(kind)]) > 0.05
