"""Fits of several parameters, from a start to the hidden truth."""

import numpy as np
import pytest

from benchmarks.blind.hidden.streets import make_unpaired
from jaxsim.discover.scenes import clipped
from jaxsim.discover.unpaired.conditional import compare
from jaxsim.discover.unpaired.equations import exchanged
from jaxsim.discover.unpaired.held_out import held_out
from jaxsim.discover.unpaired.read import read_unpaired
from jaxsim.discover.unpaired.refine import JointFit, beside, gain_of, refine
from jaxsim.discover.unpaired.workflow import divide
from tests.discover.unpaired.made import RAYS, SMALL

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def dirty(tmp_path_factory, standard_promotion):
    """A dirty window, and the comparison's candidates of that name."""
    folder = tmp_path_factory.mktemp("dirty") / "case"
    key = make_unpaired(folder, effect="window_contamination", severity=8.0, seed=3, **SMALL)
    comparison = read_unpaired(folder / "simulated", folder / "measured", per_scene=RAYS)
    _, find = divide(comparison)
    draws = np.zeros((50, len(find)))
    draws[:, find] = exchanged(comparison.measured[find], 50)
    problem = compare(comparison, find, draws)
    return key, problem, [c for c in problem.terms if c.name == "window_contamination"]


def test_a_fit_ends_at_the_hidden_patch_and_leaves_open_what_intensities_do_not_tell(dirty):
    key, problem, starts = dirty
    truth = key.effects[0]["parameters"]
    near = min(
        starts, key=lambda c: abs(np.angle(np.exp(1j * (c.columns.start["azimuth_rad"] - truth["azimuth_rad"]))))
    )
    found = refine(problem, [near.columns])
    said = found.intervals[0]
    assert np.angle(np.exp(1j * (said["azimuth_rad"].value - truth["azimuth_rad"]))) == pytest.approx(0, abs=0.2)
    assert said["loss"].value == pytest.approx(truth["loss"], abs=0.25)
    assert said["loss"].low > 0
    assert (said["drop"].low, said["drop"].high) == (0.0, 1.0)


def test_a_patch_gains_more_on_unseen_scenes_where_it_is_than_where_its_column_was_taken(dirty):
    _, problem, starts = dirty
    best = max(starts, key=lambda c: held_out(problem, problem.nuisance, [c.block]).sum())
    as_taken = clipped(held_out(problem, problem.nuisance, [best.block])[0]).sum()
    assert gain_of(problem, refine(problem, [best.columns])) > 1.05 * as_taken > 0
    assert gain_of(problem, refine(problem, [])) == 0


def test_a_fitted_patch_leaves_simulated_readings_alone_and_next_to_nothing_of_itself(dirty):
    _, problem, starts = dirty
    best = max(starts, key=lambda c: held_out(problem, problem.nuisance, [c.block]).sum())
    left = beside(problem, [best.columns])
    measured = problem.comparison.measured[problem.comparison.scene]
    np.testing.assert_array_equal(left.y[~measured], problem.y[~measured])
    # What dirt took is given back.
    assert (left.y[measured] - problem.y[measured]).max() > 0.5
    along_azimuth = next(curve for curve in problem.curves if curve.name == "azimuth")
    gains = [clipped(held_out(of, of.nuisance, [along_azimuth.block])[0]).sum() for of in (problem, left)]
    assert gains[1] < 0.1 * gains[0]


def test_no_step_of_a_fit_raises_the_loss(dirty):
    _, problem, starts = dirty
    for start in starts[::8]:
        joint = JointFit(problem, [start.columns])
        before = joint.loss(joint.linear())
        after = joint.loss(joint.fit())
        assert after <= before


def test_values_come_back_from_z(dirty):
    _, problem, starts = dirty
    joint = JointFit(problem, [starts[0].columns])
    [again] = joint.values_at(joint.z)
    for name, value in starts[0].columns.start.items():
        np.testing.assert_allclose(again[name], value, atol=1e-3)  # a start may lie at a bound, rounded
