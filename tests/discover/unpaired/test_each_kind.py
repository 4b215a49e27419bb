"""Whether a term is the sensor's, whose effects all surfaces show, or one kind's of surface alone."""

import numpy as np
import pytest

from benchmarks.blind.hidden.streets import make_unpaired
from jaxsim.discover.unpaired import each_kind
from jaxsim.discover.unpaired.columns import GROUND, UPRIGHT, kinds
from jaxsim.discover.unpaired.conditional import compare
from jaxsim.discover.unpaired.each_kind import shown_alone_by
from jaxsim.discover.unpaired.law import exchanged
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


def test_a_sensors_effect_is_shown_by_every_kind_of_surface(nothing):
    problem, term = nothing
    assert shown_alone_by(moved(problem, term.columns.columns[:, 0]), term) == ""


@pytest.mark.parametrize(("kind", "word"), [(GROUND, "the ground"), (UPRIGHT, "upright surfaces")])
def test_what_is_of_one_kind_alone_is_told_by_its_name(nothing, kind, word):
    problem, term = nothing
    of_kind = kinds(problem.comparison) == kind
    assert shown_alone_by(moved(problem, term.columns.columns[:, 0] * of_kind), term) == word


def test_where_there_is_nothing_else_nobody_is_asked(nothing, monkeypatch):
    problem, term = nothing
    monkeypatch.setattr(each_kind, "kinds", lambda comparison: np.full(len(comparison.scene), GROUND))
    # Without the upright surfaces, of which there are none, all rays are left, and nothing is hidden from them.
    assert shown_alone_by(moved(problem, term.columns.columns[:, 0]), term) == ""
