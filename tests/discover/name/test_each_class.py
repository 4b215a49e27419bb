"""What surfaces of one class alone do is told from what a sensor does; streets cast and disturbed in plain NumPy."""

from dataclasses import replace

import numpy as np
import pytest

from jaxsim.data.cityscapes import IDS
from jaxsim.discover.division import Division, NullModel
from jaxsim.discover.model.evidence import Measured
from jaxsim.discover.model.noise_levels import FINEST
from jaxsim.discover.name.candidates import rank_effects
from jaxsim.discover.name.each_class import denied_without, leaving_out, shown_by
from jaxsim.discover.name.select import fitted_step
from jaxsim.discover.rules import RULES
from jaxsim.effects import EFFECTS
from tests.discover import noisy_street

pytestmark = [pytest.mark.long, pytest.mark.usefixtures("standard_promotion")]


def sides(*classes: int):
    """Streets of whose surfaces those of these classes alone lose a ray in twenty."""
    alike = noisy_street.comparison({}, {"range_m": 0.01}, 12)
    kept = np.random.default_rng(3).random(alike.measured.valid.shape) > 0.05
    kept |= ~np.isin(np.asarray(alike.scan.semantic), classes)
    read = [np.where(kept, getattr(alike.measured, name), np.float32(0)) for name in ("range_m", "intensity")]
    return replace(alike, measured=Measured(*read, alike.measured.valid & kept))


def chosen(comparison):
    """Losses at random fitted to all find scenes, and the null that they were fitted to."""
    problem = NullModel.of(Division.of(comparison)).problem
    [candidate] = rank_effects(problem, [EFFECTS["random_dropout"]])
    return fitted_step(problem, candidate, ranking=(), good=()), problem


@pytest.mark.parametrize(("classes", "name"), [(("road", "building"), ""), (("road",), "road")])
def test_what_one_class_alone_shows_the_others_deny(classes, name):
    step, problem = chosen(sides(*(IDS[one] for one in classes)))
    assert step.chosen.total > RULES.bar_nats
    assert denied_without(step, problem) == name


@pytest.mark.parametrize(("classes", "names"), [(("road", "building"), ""), (("building",), "building")])
def test_what_none_but_surfaces_that_differ_show_is_told_to_be_of_these(classes, names):
    step, problem = chosen(sides(*(IDS[one] for one in classes)))
    assert shown_by(step, problem, [IDS["building"]]) == names
    assert shown_by(step, problem, []) == ""
    assert shown_by(step, problem, [IDS["road"], IDS["building"]]) == ""


def test_what_turns_rays_is_not_asked_of_single_classes():
    step, problem = chosen(sides(IDS["building"]))
    turned = replace(step, chosen=replace(step.chosen, effect=EFFECTS["extrinsic_rotation"]))
    assert denied_without(turned, problem) == shown_by(turned, problem, [IDS["building"]]) == ""


def test_a_lattice_is_not_asked_of_single_classes():
    step, problem = chosen(sides(IDS["road"]))
    for name in FINEST:
        lattice = replace(step, chosen=replace(step.chosen, effect=EFFECTS[name]))
        assert denied_without(lattice, problem) == ""


def test_rays_that_are_left_out_count_for_nothing():
    ev = NullModel.of(Division.of(sides())).problem.ev
    road = np.asarray(ev.rays.semantic) == IDS["road"]
    left = leaving_out(ev, road)
    for there in (left.rays.hit, left.returned, left.compared, left.features.any(-1)):
        assert not np.asarray(there)[road].any()
    np.testing.assert_array_equal(np.asarray(left.returned)[~road], np.asarray(ev.returned)[~road])
