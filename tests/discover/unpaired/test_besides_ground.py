"""Whether a term is the sensor's, whose effects all surfaces show, or the ground's alone."""

import numpy as np
import pytest

from benchmarks.blind.hidden.streets import make_unpaired
from jaxsim.discover.unpaired import besides_ground
from jaxsim.discover.unpaired.besides_ground import shown_by_ground_alone
from jaxsim.discover.unpaired.columns import GROUND, UPRIGHT, kinds
from jaxsim.discover.unpaired.conditional import compare
from jaxsim.discover.unpaired.equations import exchanged
from jaxsim.discover.unpaired.read import read_unpaired
from jaxsim.discover.unpaired.workflow import divide
from tests.discover.unpaired.made import RAYS, SMALL, moved

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def nothing(tmp_path_factory, standard_promotion):
    """Two sets of streets that one sensor saw, and a term for what it does not see close by."""
    folder = tmp_path_factory.mktemp("nothing") / "case"
    make_unpaired(folder, effect="none", seed=5, **SMALL)
    comparison = read_unpaired(folder / "simulated", folder / "measured", per_scene=RAYS)
    _, find = divide(comparison)
    draws = np.zeros((50, len(find)))
    draws[:, find] = exchanged(comparison.measured[find], 50)
    problem = compare(comparison, find, draws)
    term = next(t for t in problem.terms if t.columns.start == {"distance_m": 8.0})
    return problem, term


def test_a_sensors_effect_is_shown_by_more_than_the_ground(nothing):
    problem, term = nothing
    assert not shown_by_ground_alone(moved(problem, term.columns.columns[:, 0]), term)


@pytest.mark.parametrize(("kind", "alone"), [(GROUND, True), (UPRIGHT, False)])
def test_what_is_of_the_ground_alone_is_told(nothing, kind, alone):
    problem, term = nothing
    of_kind = kinds(problem.comparison) == kind
    assert shown_by_ground_alone(moved(problem, term.columns.columns[:, 0] * of_kind), term) == alone


def test_where_there_is_nothing_else_nobody_is_asked(nothing, monkeypatch):
    problem, term = nothing
    monkeypatch.setattr(besides_ground, "kinds", lambda comparison: np.full(len(comparison.scene), GROUND))
    assert not shown_by_ground_alone(moved(problem, term.columns.columns[:, 0]), term)
