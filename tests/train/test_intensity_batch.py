import jax
import jax.numpy as jnp
import numpy as np

from jaxsim.config import PrepareConfig
from jaxsim.train.intensity_batch import make_batch
from tests.evaluate.made import SHAPE, street

PREPARE = PrepareConfig(inputs=("rgb",), network_size=SHAPE)


def test_a_batch_says_what_returned_and_what_dropped():
    pair = street(1)
    batch = make_batch(PREPARE, occluded_weight=0.5)(jax.tree.map(lambda x: jnp.asarray(x)[None], pair))
    np.testing.assert_array_equal(batch["returned"][0], pair.measured.valid)
    np.testing.assert_array_equal(batch["dropped"][0], ~pair.measured.valid)
    np.testing.assert_array_equal(batch["weight"][0] > 0, pair.painted.valid)
    occluded = pair.replace(painted=pair.painted.replace(occluded=np.ones(SHAPE, bool)))
    batch = make_batch(PREPARE, occluded_weight=0.5)(jax.tree.map(lambda x: jnp.asarray(x)[None], occluded))
    assert float(batch["weight"].max()) == 0.5
