"""Free curves as laws: their bases, and what they do to rays."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.discover.find.covariates import BASIS_COLUMNS, CURVES, fixed_basis
from jaxsim.effects import all_rays
from tests.effects.streets import clutter_of_everything


@pytest.fixture(scope="module")
def rays():
    scan = clutter_of_everything()
    rays = jax.jit(all_rays)(scan)
    hit = np.asarray(rays.hit)
    basis = np.zeros((*hit.shape, BASIS_COLUMNS), np.float32)
    basis[hit] = fixed_basis(np.asarray(rays.range_m)[hit].astype(np.float64), "range")
    return replace(rays, basis=jnp.asarray(basis))


def heights(value):
    return {"height": jnp.full(BASIS_COLUMNS, value, jnp.float32)}


@pytest.mark.parametrize("covariate", ["range", "row", "frame"])
def test_a_basis_has_one_shape_and_sums_to_one(covariate):
    x = {"range": np.linspace(0.5, 4, 500), "row": np.arange(500.0) % 64, "frame": np.arange(500.0) % 6}[covariate]
    basis = fixed_basis(x, covariate)
    assert basis.shape == (500, BASIS_COLUMNS)
    np.testing.assert_allclose(basis.sum(1), 1, atol=1e-6)


def test_more_rows_than_columns_share_them_in_order():
    index = fixed_basis(np.arange(64.0), "row").argmax(1)
    assert (np.diff(index) >= 0).all()
    assert set(index) == set(range(BASIS_COLUMNS))


@pytest.mark.parametrize("channel", CURVES)
def test_a_curve_of_no_height_does_nothing(channel, rays):
    after = CURVES[channel].apply(heights(0.0), rays)
    for before, now in zip(jax.tree.leaves(rays), jax.tree.leaves(after), strict=True):
        np.testing.assert_array_equal(np.asarray(before), np.asarray(now))


@pytest.mark.parametrize(("channel", "field", "change"), [
    ("intensity", "log_intensity", 0.2), ("range", "reading_m", 0.2), ("drop", "log_keep", np.log(0.8)),
])  # fmt: skip
def test_a_level_curve_changes_its_channel_alike_wherever_rays_hit(channel, field, change, rays):
    after = CURVES[channel].apply(heights(0.2), rays)
    changed = np.asarray(getattr(after, field)) - np.asarray(getattr(rays, field))
    np.testing.assert_allclose(changed, np.where(np.asarray(rays.hit), change, 0), atol=1e-5)


def test_one_program_serves_the_curves_of_all_covariates(rays):
    traced = []

    def run(rays):
        traced.append(1)
        return CURVES["intensity"].apply(heights(0.1), rays)

    compiled = jax.jit(run)
    compiled(rays)
    compiled(replace(rays, basis=rays.basis[..., ::-1]))
    assert len(traced) == 1


def test_rays_without_a_basis_are_refused(rays):
    with pytest.raises(ValueError, match="with_basis"):
        CURVES["range"].apply(heights(0.1), replace(rays, basis=None))
