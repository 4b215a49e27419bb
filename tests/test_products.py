"""Products keep float32's digits, which the program that would run says of itself."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.products import einsum, matmul, tensordot

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
