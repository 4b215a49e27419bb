import numpy as np
import pytest

from jaxsim.discover.model.lattice import lattice_step


@pytest.mark.parametrize("step", [0.004, 1 / 255, 0.01, 0.05])
def test_a_lattice_is_found_in_float32_values(step):
    rng = np.random.default_rng(1)
    values = np.round(rng.uniform(0, 1, 5000) / step) * step
    assert lattice_step(values.astype(np.float32), finest=1e-3) == pytest.approx(step, rel=1e-3)


def test_values_on_no_lattice_have_none():
    assert lattice_step(np.random.default_rng(2).uniform(0, 80, 5000), finest=1e-3) == 0


def test_a_few_values_off_the_lattice_do_not_hide_it_and_many_do():
    rng = np.random.default_rng(3)
    values = np.round(rng.uniform(0, 1, 5000) / 0.02) * 0.02
    values[:10] += 0.007
    assert lattice_step(values, finest=1e-3) == pytest.approx(0.02, rel=1e-3)
    values[:500] += rng.uniform(0, 0.02, 500)
    assert lattice_step(values, finest=1e-3) == 0
