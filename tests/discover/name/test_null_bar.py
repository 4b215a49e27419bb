"""The bar that nulls of the data set."""

from types import SimpleNamespace

import numpy as np
import pytest

from jaxsim.discover.explain import ranking, why_not
from jaxsim.discover.name import null_bar as calibrate
from jaxsim.discover.name import select as name
from jaxsim.discover.name.null_bar import bars_of, run_nulls
from jaxsim.discover.name.select import BAR, Bars, accepted, choose
from tests.discover.name.test_candidates import candidate

UNITS = 11
STEADY = np.array([4.0, 5, 3, 6, 4, 5, 2, 4, 3, 5, 6])
"""45 nats in all, none more than the third largest."""
SPLIT = np.array([1, -1, 1, 1, -1, 1, 1, -1, 1, 1, -1])


@pytest.fixture
def nulls_that_gain(monkeypatch):
    """Lets each null in turn have these candidates and curves."""

    def given(*rounds):
        left = iter(rounds)
        monkeypatch.setattr(calibrate, "redraw", lambda problem, explained, seed: seed)
        monkeypatch.setattr(calibrate, "fit_null", lambda *_, clutter: (next(left), None))
        monkeypatch.setattr(calibrate, "standardised", lambda *_: (None, {}))
        monkeypatch.setattr(calibrate, "localise", lambda *_: [])
        monkeypatch.setattr(calibrate, "survey", lambda null, effects: null[0])
        monkeypatch.setattr(calibrate, "free_curves", lambda null, places: [(None, curve) for curve in null[1]])
        problem = SimpleNamespace(scan=None, clutter=False)
        return run_nulls(problem, problem, np.arange(UNITS), (), len(rounds))

    return given


def test_the_bar_is_the_most_that_scenes_agree_on_in_any_null(nulls_that_gain):
    nulls = nulls_that_gain(
        ([candidate("gamma_response", STEADY), candidate("oren_nayar", 9 * STEADY * SPLIT)], []),
        ([candidate("oren_nayar", STEADY / 2)], [candidate("beam_gain", 2 * STEADY)]),
        ([candidate("saturation", -STEADY)], []),
    )
    assert nulls.effects == ("gamma_response", "oren_nayar", "")
    assert np.array(nulls.gains) * UNITS == pytest.approx([45, 22.5, 0])
    assert nulls.answered == 2
    assert bars_of(nulls, UNITS) == Bars(pytest.approx(45), pytest.approx(90))


def test_nulls_that_gain_little_leave_the_standing_bar(nulls_that_gain):
    nulls = nulls_that_gain(([candidate("gamma_response", STEADY / 10)], []), ([], []))
    assert nulls.answered == 0
    assert bars_of(nulls, UNITS) == Bars(pytest.approx(BAR), pytest.approx(BAR))


def test_what_gains_less_than_the_nulls_is_not_named(monkeypatch):
    strong = candidate("gamma_response", STEADY)
    assert accepted(strong, 44)
    assert not accepted(strong, 46)
    monkeypatch.setattr(name, "survey", lambda problem, left: [strong])
    problem = SimpleNamespace(ev=SimpleNamespace(unit=np.arange(UNITS)))
    choice = choose(problem, [], bars=Bars(46))
    assert choice.steps == ()
    assert why_not(strong, choice) == "its gain is within what a null reaches"
    assert ranking(choice)[0].bar == pytest.approx(46 / UNITS)
