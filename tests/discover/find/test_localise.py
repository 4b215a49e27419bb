import numpy as np
import pytest

from jaxsim.discover.find.localise import Place, curve_basis, localise, reported
from tests.discover.find.random_rays import rays


@pytest.mark.parametrize("name", ["range", "incidence", "row", "class"])
def test_the_covariate_that_the_residuals_depend_on_comes_first(name):
    rng = np.random.default_rng(0)
    shape = (10, 12, 16)
    r = rays(rng, shape)
    value = {"range": np.log(r.range_m), "incidence": r.incidence_rad, "row": (r.row % 5), "class": (r.semantic == 26)}
    z = rng.normal(0, 1, shape) + 0.5 * np.asarray(value[name], float)
    places = localise(r, {"intensity": (z - z.mean(), np.ones(shape, bool))}, np.arange(10))
    assert places[0].covariate == name
    assert places[0].p_value < 0.05


def test_noise_alone_depends_on_nothing_more_often_than_the_level_says():
    found = 0
    for seed in range(40):
        rng = np.random.default_rng(100 + seed)
        shape = (10, 6, 12)
        z = {name: (rng.normal(0, 1, shape), np.ones(shape, bool)) for name in ("intensity", "range")}
        found += any(place.p_value <= 0.05 for place in localise(rays(rng, shape), z, np.arange(10), most=1))
    assert found <= 5


def test_what_a_stronger_covariate_explains_is_not_counted_again():
    rng = np.random.default_rng(5)
    shape = (12, 12, 16)
    r = rays(rng, shape)
    r.log_power = np.log(r.range_m) + rng.normal(0, 0.3, shape)
    z = 0.8 * (np.log(r.range_m) - 3) + rng.normal(0, 1, shape)
    places = {p.covariate: p for p in localise(r, {"intensity": (z, np.ones(shape, bool))}, np.arange(12))}
    assert places["range"].gain > 10 * (places["power"].gain if "power" in places else 0)


@pytest.mark.parametrize(
    "place", [("range", "row", 0.06, 50.0), ("range", "row", 0.01, 9.0), ("intensity", "class", 0.01, 50.0)]
)
def test_what_chance_explains_is_slight_or_is_a_nuisance_itself_is_not_reported(place):
    channel, covariate, p, gain = place
    sure = [Place("drop", "class", 0.01, 0.1, 11.0), Place("range", "row", 0.01, 0.1, 12.0)]
    assert reported([*sure, Place(channel, covariate, p, 0.1, gain)]) == sure[::-1]


def test_hat_functions_sum_to_one():
    basis = curve_basis(np.random.default_rng(6).normal(size=300), "range")
    np.testing.assert_allclose(basis.sum(1), 1, atol=1e-6)
