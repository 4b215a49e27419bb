"""Products keep float32's digits, which the program that would run says of itself."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.products import einsum, inverse, matmul, tensordot

PRODUCTS = {
    "einsum": (lambda a, b: einsum("ij,jk->ik", a, b)),
    "matmul": matmul,
    "tensordot": (lambda a, b: tensordot(a, b, 1)),
}


@pytest.mark.parametrize("name", PRODUCTS)
def test_a_product_is_numpys_and_asks_for_every_digit(name):
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=(5, 7)), rng.normal(size=(7, 3))
    arrays = jnp.asarray(a, jnp.float32), jnp.asarray(b, jnp.float32)
    np.testing.assert_allclose(PRODUCTS[name](*arrays), a @ b, atol=1e-5)
    assert "precision = [HIGHEST, HIGHEST]" in jax.jit(PRODUCTS[name]).lower(*arrays).as_text()


@pytest.mark.parametrize("size", [1, 2, 6, 40])
def test_the_inverse_of_positive_definite_matrices_is_numpys(size):
    rng = np.random.default_rng(size)
    roots = rng.normal(size=(9, size, 3 * size)) * rng.uniform(0.1, 30, (1, size, 1))
    matrices = roots @ roots.transpose(0, 2, 1) + np.eye(size)
    ours, right = inverse(jnp.asarray(matrices, jnp.float32)), np.linalg.inv(matrices)
    np.testing.assert_allclose(ours, right, atol=3e-6 * np.abs(right).max())
    assert "lapack" not in jax.jit(inverse).lower(jnp.asarray(matrices, jnp.float32)).as_text()
