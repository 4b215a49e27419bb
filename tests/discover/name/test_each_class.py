"""What surfaces of one class alone do is told from what a sensor does; streets cast and disturbed in plain NumPy."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from jaxsim.data.cityscapes import IDS
from jaxsim.discover.find.division import Division, NullModel
from jaxsim.discover.model.evidence import Measured
from jaxsim.discover.model.noise_levels import FINEST
from jaxsim.discover.name import each_class
from jaxsim.discover.name.candidates import rank_effects
from jaxsim.discover.name.each_class import (
    denied_without,
    leaving_out,
    outdone_in,
    shown_below,
    shown_by,
    straight_below,
)
from jaxsim.discover.name.select import fitted_step
from jaxsim.discover.rules import RULES
from jaxsim.effects import EFFECTS
from tests.discover import noisy_street

pytestmark = [pytest.mark.long, pytest.mark.usefixtures("few_rays", "standard_promotion")]


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
    return fitted_step(problem, candidate, ranking=(), among=()), problem


@pytest.fixture(scope="module")
def chosen_of(few_rays, standard_promotion) -> Callable:
    """What is chosen where surfaces of these classes lose rays; several tests ask it of the same streets."""
    return cache(lambda *names: chosen(sides(*(IDS[name] for name in names))))


@pytest.mark.parametrize(("classes", "name"), [(("road", "building"), ""), (("road",), "road")])
def test_what_one_class_alone_shows_the_others_deny(chosen_of, classes, name):
    step, problem = chosen_of(*classes)
    assert step.chosen.total > RULES.bar_nats
    assert denied_without(step, problem) == name


@pytest.mark.parametrize(("classes", "names"), [(("road", "building"), ""), (("building",), "building")])
def test_what_none_but_surfaces_that_differ_show_is_told_to_be_of_these(chosen_of, classes, names):
    step, problem = chosen_of(*classes)
    assert shown_by(step, problem, [IDS["building"]]) == names
    assert shown_by(step, problem, []) == ""
    assert shown_by(step, problem, [IDS["road"], IDS["building"]]) == ""


@pytest.mark.parametrize(("classes", "name"), [(("road", "building"), ""), (("building",), "building")])
def test_others_that_gain_far_less_than_is_due_speak_against_an_effect(monkeypatch, classes, name):
    """Intensities of these classes fall off along the range, by numbers that the catalogue knows nothing of."""
    alike = noisy_street.comparison({}, {"share": 0.06, "constant": 0.004, "range_m": 0.01}, 12)
    falls = np.isin(np.asarray(alike.scan.semantic), [IDS[one] for one in classes])
    law = np.where(falls, (np.maximum(alike.measured.range_m, 1) / 10) ** -0.3, 1)
    intensity = (alike.measured.intensity * law).astype(np.float32)
    problem = NullModel.of(Division.of(replace(alike, measured=replace(alike.measured, intensity=intensity)))).problem
    [candidate] = rank_effects(problem, [EFFECTS["range_falloff"]])
    step = fitted_step(problem, candidate, ranking=(), among=())
    assert step.chosen.total > RULES.bar_nats
    monkeypatch.setattr(each_class, "_lose", lambda step, rest: False)
    assert denied_without(step, problem) == name


def rough(intensity, incidence_rad):
    """More light at grazing angles, the more the rougher; numbers of Oren and Nayar's model for 0.4 rad."""
    return intensity * (0.84 + 0.29 * np.sin(incidence_rad) * np.tan(np.minimum(incidence_rad, 1.5)))


def lifted(intensity, incidence_rad):
    return np.where(intensity > 0, intensity + 0.03, 0)


@pytest.mark.parametrize(("law", "outdone"), [(rough, ["intensity_offset"]), (lifted, [])])
def test_an_effect_of_which_a_class_shows_too_little_gives_way_to_one_that_all_show(law, outdone):
    alike = noisy_street.comparison({}, {"share": 0.04, "range_m": 0.01}, 12)
    intensity = law(alike.measured.intensity, np.asarray(alike.scan.incidence_rad)).astype(np.float32)
    problem = NullModel.of(Division.of(replace(alike, measured=replace(alike.measured, intensity=intensity)))).problem
    ranking = rank_effects(problem, [EFFECTS["intensity_offset"], EFFECTS["oren_nayar"]])
    for candidate in ranking if outdone else ranking[:1]:
        step = fitted_step(problem, candidate, ranking=ranking, among=())
        assert bool(outdone_in(step, problem)) == (candidate.effect.name in outdone)
    assert outdone or ranking[0].effect.name == "intensity_offset"
    [offset] = [candidate for candidate in ranking if candidate.effect.name == "intensity_offset"]
    assert outdone_in(fitted_step(problem, offset, ranking=[offset], among=()), problem) == ""


def test_what_turns_rays_is_not_asked_of_single_classes(chosen_of):
    step, problem = chosen_of("building")
    turned = replace(step, chosen=replace(step.chosen, effect=EFFECTS["extrinsic_rotation"]))
    assert denied_without(turned, problem) == shown_by(turned, problem, [IDS["building"]]) == ""


def test_a_lattice_is_not_asked_of_single_classes(chosen_of):
    step, problem = chosen_of("building")
    for name in FINEST:
        lattice = replace(step, chosen=replace(step.chosen, effect=EFFECTS[name]))
        assert denied_without(lattice, problem) == shown_by(lattice, problem, [IDS["building"]]) == ""


def test_rays_that_are_left_out_count_for_nothing():
    ev = NullModel.of(Division.of(sides())).problem.ev
    road = np.asarray(ev.rays.semantic) == IDS["road"]
    left = leaving_out(ev, road)
    for there in (left.rays.hit, left.returned, left.compared, left.features.any(-1)):
        assert not np.asarray(there)[road].any()
    np.testing.assert_array_equal(np.asarray(left.returned)[~road], np.asarray(ev.returned)[~road])


SIGN = (slice(2, 5), slice(None, None, 8), 6.0)
"""Rows and columns of signs one ray wide, and their range in metres, before what else is there."""


def glared(*, all_round: bool):
    """Streets with signs, beside which the sensor reads some signs' range: in all directions, or straight below."""
    bare = noisy_street.street

    def with_signs(seed: int):
        frame = bare(seed)
        rows, columns, at_m = SIGN
        for name, value in (("range", at_m), ("intensity", 0.9), ("semantic", IDS["traffic sign"]), ("incidence", 0.0)):
            frame[name][rows, columns] = value
        frame["hit"][rows, columns] = True
        return frame

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(noisy_street, "street", with_signs)
        both = noisy_street.comparison({}, {"range_m": 0.01}, 12)
    rng = np.random.default_rng(4)
    range_m = both.measured.range_m.copy()
    target = np.zeros(range_m.shape, bool)
    target[:, SIGN[0], SIGN[1]] = True
    if all_round:
        near = np.any([np.roll(target, by, axis) for by in (-3, -2, 2, 3) for axis in (1, 2)], axis=0) & ~target
        ghost = near & (rng.random(near.shape) < 0.3)
    else:
        posts = rng.random((len(range_m), 1, noisy_street.COLUMNS // 8)) < 0.15
        ghost = np.zeros(range_m.shape, bool)
        ghost[:, 6:10, SIGN[1]] = posts
    range_m[ghost] = SIGN[2] + 0.01 * rng.normal(size=ghost.sum())
    measured = replace(both.measured, range_m=range_m, valid=both.measured.valid | ghost)
    problem = NullModel.of(Division.of(replace(both, measured=measured))).problem
    [candidate] = rank_effects(problem, [EFFECTS["blooming"]])
    return fitted_step(problem, candidate, ranking=(), among=()), problem


@pytest.fixture(scope="module")
def all_round(few_rays, standard_promotion):
    return glared(all_round=True)


@pytest.fixture(scope="module")
def straight_down(few_rays, standard_promotion):
    return glared(all_round=False)


@pytest.mark.parametrize("glare", ["all_round", "straight_down"])
def test_glare_that_is_read_below_signs_alone_is_their_posts(request, glare):
    step, problem = request.getfixturevalue(glare)
    assert step.chosen.total > RULES.bar_nats
    assert shown_below(step, problem) == (glare == "straight_down")
    other = replace(step, chosen=replace(step.chosen, effect=EFFECTS["mixed_pixels"]))
    assert not shown_below(other, problem)


def test_rays_straight_below_a_target_are_those_of_its_columns(all_round):
    _, problem = all_round
    below, rays = straight_below(problem.ev), problem.ev.rays
    lower = np.asarray(rays.elevation_rad) < np.asarray(noisy_street.grid().elevation_rad)[2] - 1e-4
    of_sign = (np.asarray(rays.semantic) == IDS["traffic sign"]).any(-1, keepdims=True)
    in_reach = np.asarray(rays.glare_m) > 0
    np.testing.assert_array_equal(below, lower & of_sign & in_reach)
