from dataclasses import replace

import numpy as np
import pytest

from jaxsim.discover.find.levels import compare_levels, missing, range_noise_grows
from tests.discover.noisy_street import comparison


@pytest.fixture(scope="module")
def by_name():
    levels = compare_levels(
        comparison({"range_m": 0.01, "loss": 0.005}, {"range_m": 0.05, "share": 0.08, "loss": 0.03})
    )
    return {one.name: one for one in levels}


def test_noise_that_the_simulator_lacks_is_the_difference_of_variances(by_name):
    noise = by_name["range_noise"]
    assert noise.simulated.value == pytest.approx(0.01, rel=0.1)
    assert noise.measured.value == pytest.approx(0.05, rel=0.1)
    assert noise.missing.low <= np.sqrt(0.05**2 - 0.01**2) <= noise.missing.high * 1.05
    assert noise.beyond_usual


def test_losses_are_compared_as_rates(by_name):
    assert by_name["random_loss"].missing.value == pytest.approx(0.025, rel=0.3)


def test_what_is_missing_goes_into_the_sensor_model(by_name):
    lacking = missing(tuple(by_name.values()))
    assert {"range_noise", "intensity_noise", "random_loss"} <= set(lacking)
    assert lacking["intensity_noise"] == pytest.approx(0.08, rel=0.3)


def test_what_a_named_effect_makes_is_not_counted_twice(by_name):
    whole = missing(tuple(by_name.values()))
    lacking = missing(tuple(by_name.values()), {"random_loss": 0.025, "range_noise": 0.03})
    assert "random_loss" not in lacking
    # Of noise the rest stays, by variances.
    assert lacking["range_noise"] == pytest.approx(np.sqrt(whole["range_noise"] ** 2 - 0.03**2))
    assert lacking["intensity_noise"] == whole["intensity_noise"]


def test_both_sides_alike_lack_nothing():
    noise = {"range_m": 0.015, "share": 0.06, "step": 1 / 255}
    lacking = missing(compare_levels(comparison(noise, noise)))
    assert "intensity_step" not in lacking
    assert lacking.get("range_noise", 0) < 0.005


def test_a_lattice_of_the_sensor_alone_is_missing():
    levels = {one.name: one for one in compare_levels(comparison(None, {"step": 1 / 255}))}
    assert levels["intensity_step"].missing.value == pytest.approx(1 / 255, rel=1e-3)


def test_noise_grows_where_that_of_neighbours_does():
    even = comparison(None, {"range_m": 0.015})
    assert not range_noise_grows(even)
    # The weakest third of the echoes scatters five times as much as the others.
    power = np.log(np.maximum(even.scan.intensity, 1e-4)) - 2 * np.log(np.maximum(even.scan.range_m, 0.1))
    weak = even.scan.hit & (power < np.quantile(power[even.scan.hit], 1 / 3))
    more = np.random.default_rng(5).normal(0, 0.075, weak.shape)
    measured = replace(even.measured, range_m=(even.measured.range_m + np.where(weak, more, 0)).astype(np.float32))
    assert range_noise_grows(replace(even, measured=measured))


def test_what_both_sides_know_of_leaves_far_off_is_no_noise_that_grows():
    even = comparison(None, {"range_m": 0.015})
    power = np.log(np.maximum(even.scan.intensity, 1e-4)) - 2 * np.log(np.maximum(even.scan.range_m, 0.1))
    weak = even.scan.hit & (power < np.quantile(power[even.scan.hit], 1 / 3))
    rng = np.random.default_rng(6)
    leaves = weak & (rng.random(weak.shape) < 0.15)
    off_m = np.where(leaves, rng.normal(0, 0.08, weak.shape), 0)
    rough = [(side.range_m + off_m).astype(np.float32) for side in (even.scan, even.measured)]
    scan, measured = replace(even.scan, range_m=rough[0]), replace(even.measured, range_m=rough[1])
    assert not range_noise_grows(replace(even, scan=scan, measured=measured))
