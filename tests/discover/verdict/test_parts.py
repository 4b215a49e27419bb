"""Parts of a verdict as JSON has them."""

import numpy as np

from jaxsim.discover.verdict.parts import Interval, plain


def test_parts_become_plain_values_of_six_digits():
    one = Interval(np.float64(1.23456789), -np.inf, 2.0, "m")
    assert plain(one) == {"value": 1.23457, "low": None, "high": 2.0, "unit": "m"}
    assert plain({"a": (one, np.nan), "b": np.float32(0.1), "c": "x", "d": True}) == {
        "a": [plain(one), None],
        "b": 0.1,
        "c": "x",
        "d": True,
    }
