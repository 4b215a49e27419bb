import numpy as np
import pytest

from jaxsim.discover.find.interactions import interactions, spelled
from jaxsim.discover.find.localise import NAMED
from tests.discover.find.random_rays import rays

SHAPE = (12, 24, 16)


def alone(r, z, **settings):
    return interactions(r, {"range": (z - z.mean(), np.ones(SHAPE, bool))}, np.arange(12), level=0.05, **settings)


@pytest.mark.parametrize(
    ("pair", "first", "second"),
    [
        ("range x incidence", lambda r: r.range_m > 31.5, lambda r: r.incidence_rad > 0.7),
        ("row x class", lambda r: r.row > 7, lambda r: r.semantic == 11),
    ],
)
def test_a_dependence_on_two_covariates_that_neither_shows_alone_is_found(pair, first, second):
    rng = np.random.default_rng(0)
    r = rays(rng, SHAPE)
    share = np.mean(second(r))
    z = rng.normal(0, 1, SHAPE) + 1.2 * np.where(first(r), 0.5, -0.5) * (second(r) - share)
    (place,) = alone(r, z)
    assert place.covariate == pair
    assert place.p_value < 0.01
    assert 0.01 < place.share < 0.2


def test_what_single_covariates_explain_makes_no_pair():
    rng = np.random.default_rng(1)
    r = rays(rng, SHAPE)
    z = rng.normal(0, 1, SHAPE) + 0.6 * np.log(r.range_m) + 0.6 * r.incidence_rad + 0.4 * (r.row % 5)
    assert alone(r, z) == []


def test_noise_alone_has_a_pair_about_as_often_as_the_level_says():
    found = 0
    for seed in range(12):
        rng = np.random.default_rng(100 + seed)
        found += bool(alone(rays(rng, SHAPE), rng.normal(0, 1, SHAPE)))
    assert found <= 3


def test_few_scenes_decide_nothing():
    rng = np.random.default_rng(2)
    r = rays(rng, SHAPE)
    z = rng.normal(0, 1, SHAPE) + 3.0 * ((r.range_m > 31.5) == (r.incidence_rad > 0.7))
    scene = np.repeat(np.arange(4), 3)
    assert interactions(r, {"range": (z, np.ones(SHAPE, bool))}, scene, level=0.5) == []


def test_a_handful_of_events_tells_nothing():
    rng = np.random.default_rng(3)
    r = rays(rng, SHAPE)
    together = (r.range_m > 58) & (r.incidence_rad > 1.3)
    assert 5 < together.sum() < 60
    z = np.where(together, 30.0, -0.05)
    assert interactions(r, {"drop": (z, np.ones(SHAPE, bool))}, np.arange(12), level=1.0) == []


def test_a_pair_is_spelled_by_the_words_of_its_parts():
    assert spelled("range x step side", NAMED) == "range x step"
    assert spelled("speed x time", NAMED) == "time"
    assert spelled("row", NAMED) == "row"
