"""What stands along a street and uses it: on the ground, as large as its label says, the same from the same seed."""

import numpy as np
import pytest

from jaxsim.data.synthetic import things
from jaxsim.data.synthetic.solids import Model

STANDING = {
    "house": lambda rng: things.house(rng, length=12.0, floors=3, shops=True)[0],
    "tree": things.tree,
    "bush": things.bush,
    "hedge": lambda rng: things.hedge(rng, 8.0),
    "fence": lambda rng: things.fence(rng, 8.0),
    "lamp post": things.lamp_post,
    "sign": things.sign,
}
LABELLED = {
    **{name: (lambda rng, shape=shape: things.car(rng, shape)) for name, shape in things.CAR_SHAPES.items()},
    "truck": things.truck,
    "pedestrian": things.pedestrian,
    "cyclist": things.cyclist,
}


def box_of(model: Model) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest corner of all its solids."""
    bounds = np.array([box for kind in model.bounds for box in kind])
    return bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)


@pytest.mark.parametrize("name", STANDING)
def test_it_stands_on_the_ground(name):
    for seed in range(5):
        low, high = box_of(STANDING[name](np.random.default_rng(seed)))
        assert -0.5 < low[2] < 0.35
        assert 0.4 < high[2] < 25


@pytest.mark.parametrize("name", LABELLED)
def test_its_label_is_as_large_as_it_is(name):
    for seed in range(5):
        model, size = LABELLED[name](np.random.default_rng(seed))
        low, high = box_of(model)
        np.testing.assert_allclose(low[2], 0, atol=0.05)
        np.testing.assert_allclose(high[2], size[2], atol=0.15)
        np.testing.assert_allclose((high - low)[0], size[0], atol=0.3)


def test_the_same_seed_gives_the_same_thing():
    one, other = (things.tree(np.random.default_rng(3)) for _ in range(2))
    np.testing.assert_array_equal(box_of(one), box_of(other))
