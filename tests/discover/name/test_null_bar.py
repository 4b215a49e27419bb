"""The bar that nulls of the data set."""

import numpy as np
import pytest

from jaxsim.discover.name import null_bar
from jaxsim.discover.name.null_bar import bars_of, run_nulls
from jaxsim.discover.name.select import Bars
from jaxsim.discover.rules import RULES
from tests.discover.name.made import candidate, problem

SCENES = 11
STEADY = np.array([4.0, 5, 3, 6, 4, 5, 2, 4, 3, 5, 6])
"""45 nats in all, none more than the third largest."""
SPLIT = np.array([1, -1, 1, 1, -1, 1, 1, -1, 1, 1, -1])


@pytest.fixture
def nulls_that_gain(monkeypatch):
    """Lets each null in turn have these candidates and curves."""

    def given(*rounds):
        rest = iter(rounds)
        monkeypatch.setattr(null_bar, "bootstrap", lambda problem, explained, seed: seed)
        monkeypatch.setattr(null_bar, "fit_null", lambda *_, clutter: (next(rest), None))
        monkeypatch.setattr(null_bar, "standardised", lambda *_: (None, {}))
        monkeypatch.setattr(null_bar, "localise", lambda *_: [])
        monkeypatch.setattr(null_bar, "rank_effects", lambda null, effects: null[0])
        monkeypatch.setattr(null_bar, "free_curves", lambda null, places: [(None, curve) for curve in null[1]])
        bare = problem(scan=None, clutter=False)
        return run_nulls(bare, bare, (), scene=np.arange(SCENES), count=len(rounds))

    return given


def test_the_bar_is_the_most_that_scenes_agree_on_in_any_null(nulls_that_gain):
    nulls = nulls_that_gain(
        ([candidate("gamma_response", STEADY), candidate("oren_nayar", 9 * STEADY * SPLIT)], []),
        ([candidate("oren_nayar", STEADY / 2)], [candidate("beam_gain", 2 * STEADY)]),
        ([candidate("saturation", -STEADY)], []),
    )
    assert nulls.effects == ("gamma_response", "oren_nayar", "")
    assert np.array(nulls.gains) * SCENES == pytest.approx([45, 22.5, 0])
    assert nulls.answered == 2
    bars = bars_of(nulls, SCENES)
    assert (bars.effect, bars.free) == pytest.approx((45, 90))


def test_nulls_that_gain_little_leave_the_standing_bar(nulls_that_gain):
    nulls = nulls_that_gain(([candidate("gamma_response", STEADY / 10)], []), ([], []))
    assert nulls.answered == 0
    bars = bars_of(nulls, SCENES)
    assert (bars.effect, bars.free) == pytest.approx((Bars().effect, RULES.bar_nats))
