"""Slopes of measured on simulated intensities by scale, of frames cast and disturbed in plain NumPy."""

from dataclasses import replace

import numpy as np
import pytest

from jaxsim.discover import discover
from jaxsim.discover.find.division import NOTHING_YET, Division, NullModel
from jaxsim.discover.model.contrast import SCALES
from jaxsim.discover.model.evidence import without_detail
from jaxsim.discover.model.fit import Problem, in_place
from jaxsim.discover.model.null_model import reweighted
from jaxsim.discover.model.parameters import to_z
from jaxsim.discover.name.select import Choice, choose
from jaxsim.discover.name.simulator_contrast import contrast_of_answer, contrast_off
from jaxsim.discover.read import Comparison
from jaxsim.effects import EFFECTS
from tests.discover.few_rays import looking_at
from tests.discover.noisy_street import ROWS, TEXTURE, comparison

pytestmark = pytest.mark.usefixtures("few_rays", "standard_promotion")
NOISE = {"share": 0.03, "range_m": 0.01}
MADE_UP = 0.25
"""Standard deviation of what a simulator makes up of ln I, in patches of cells."""
USUAL = 0.08
"""The same of a good table of reflectances, which has single things a little too dark or too bright."""


def sides(*, made_up: float = 0.0, gamma: float = 1.0, frames: int = 12) -> Comparison:
    """A street as a simulator renders it, which makes up patches of brightness of its own, frame by frame; and as a
    sensor of this gamma reads it."""
    one = comparison({}, NOISE, frames)
    rng = np.random.default_rng(5)
    intensity = np.asarray(one.scan.intensity)
    rows, columns = intensity.shape[1:]
    patches = rng.normal(0, made_up, (frames, -(-rows // 3), -(-columns // 12)))
    patches = patches.repeat(3, axis=1)[:, :rows].repeat(12, axis=2)[:, :, :columns]
    scan = replace(one.scan, intensity=(intensity * np.exp(patches)).astype(np.float32))
    measured = replace(one.measured, intensity=np.asarray(one.measured.intensity) ** np.float32(gamma))
    return replace(one, scan=scan, measured=measured)


def null_of(of: Comparison, *, free: bool = False) -> NullModel:
    division = Division.of(of)
    return NullModel.of(division.with_free_contrast() if free else division)


def as_said(problem: Problem) -> Problem:
    """The problem that takes what is simulated within classes for true."""
    return reweighted(replace(problem, ev=without_detail(problem.ev)), problem.ev.all_blocks)


def nothing(null_model: NullModel) -> Choice:
    return Choice((), (), null_model.problem)


@pytest.fixture(scope="module")
def follows(few_rays, standard_promotion) -> NullModel:
    """Of a sensor that follows the simulator."""
    return null_of(sides())


@pytest.fixture(scope="module")
def made_up(few_rays, standard_promotion) -> tuple[NullModel, NullModel]:
    """Of a simulator that makes something up; and with free contrast."""
    of = sides(made_up=MADE_UP)
    return null_of(of), null_of(of, free=True)


@pytest.mark.long
def test_a_sensor_that_follows_the_simulator_leaves_its_contrast_as_it_is(follows):
    null = follows
    assert contrast_off(null, nothing(null)) is None


@pytest.mark.long
def test_what_a_simulator_makes_up_is_found_and_told_by_scale(made_up):
    null, free = made_up
    found = contrast_off(null, nothing(null))
    assert found is not None
    told = contrast_of_answer(found, free.problem)
    # Walls have a texture of their own, which the simulator knows, and the road has none: reliability, as errors in
    # variables have it.
    wall, road = told.slopes["building"], told.slopes["road"]
    expected = TEXTURE[11] ** 2 / (TEXTURE[11] ** 2 + MADE_UP**2)
    assert wall.value == pytest.approx(expected, abs=0.1)
    assert wall.low < wall.value < wall.high
    assert road.value == pytest.approx(0, abs=0.1)
    assert told.p_value < 0.05


@pytest.mark.long
def test_the_contrast_is_asked_beside_what_lets_rays_hit_something_else(follows):
    null = follows
    turn = EFFECTS["extrinsic_rotation"]
    turned = in_place(null.problem, [(turn, to_z(turn, {"pitch_rad": np.float32(0.03)}, ROWS))])
    assert (np.asarray(turned.ev.rays.hit) != np.asarray(null.problem.ev.rays.hit)).any()
    assert contrast_off(null, Choice((), (), turned)) is None


@pytest.mark.long
def test_what_a_simulator_makes_up_is_no_gamma(made_up):
    gamma, (null, free) = EFFECTS["gamma_response"], made_up
    assert choose(as_said(null.problem), [gamma]).steps
    assert not choose(null.problem, [gamma]).steps
    assert not choose(free.problem, [gamma]).steps


@pytest.mark.long
@pytest.mark.slow  # The test above says the same of more that is made up.
def test_what_tables_have_wrong_of_things_within_a_class_is_no_gamma():
    gamma, null = EFFECTS["gamma_response"], null_of(sides(made_up=USUAL))
    assert choose(as_said(null.problem), [gamma]).steps
    assert not choose(null.problem, [gamma]).steps


@pytest.mark.long
def test_a_gamma_has_one_slope_on_every_scale_and_leaves_the_contrast_alone():
    with looking_at(1):  # in half of them what is left over comes to half of what would be told
        null = null_of(sides(gamma=0.7))
    assert contrast_off(null, nothing(null)) is not None
    choice = choose(null.problem, [EFFECTS["gamma_response"]])
    assert choice.steps
    assert contrast_off(null, choice) is None


@pytest.mark.long
def test_an_answer_tells_the_contrast_and_names_nothing_in_its_place():
    verdict = discover(sides(made_up=MADE_UP), effects=["gamma_response", "intensity_offset"]).verdict
    assert (verdict.verdict, verdict.effects) == ("none", ())
    assert verdict.contrast is not None
    told = verdict.to_json()["contrast"]
    assert list(told["slopes"])[: len(SCALES)] == list(SCALES)
    assert told["slopes"]["building"]["high"] < 0.6
    assert any("does not follow the simulator's contrast" in note for note in verdict.notes)


def test_noise_on_intensities_has_left_the_contrast_free_already():
    division = Division.of(comparison({"share": 0.06, "constant": 0.008}, NOISE, 12))
    # A fit would take long, and is not looked at where contrast is free.
    null = NullModel(division, NOTHING_YET, problem=object.__new__(Problem))
    assert contrast_off(null, nothing(null)) is None
