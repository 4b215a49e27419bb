"""What speaks against an effect that passed the bar."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from jaxsim.discover.find.covariates import Dependence
from jaxsim.discover.find.division import Division, NullModel
from jaxsim.discover.model.noise_levels import FINEST
from jaxsim.discover.name import doubts
from jaxsim.discover.name.answer import name_effects
from jaxsim.discover.name.doubts import (
    DENIED,
    NEGLIGIBLE,
    OF_MATERIALS,
    OF_POSTS,
    RARELY_IF_EVER,
    SCARCE,
    SHOWN_BY,
    UNFOUNDED,
    Doubts,
)
from jaxsim.discover.name.other_sides import CONTROL, EXCHANGED
from jaxsim.effects import EFFECTS
from tests.discover import noisy_street
from tests.discover.few_rays import looking_at
from tests.discover.name.made import candidate, problem, showing, step


@pytest.fixture
def no_class(monkeypatch):
    """No class speaks against anything, and nothing is too small."""
    monkeypatch.setattr(doubts, "denied_without", lambda step, problem: "")
    monkeypatch.setattr(doubts, "shown_by", lambda step, problem, classes: "")
    monkeypatch.setattr(doubts, "shown_below", lambda step, problem: False)
    monkeypatch.setattr(doubts, "RULES", replace(doubts.RULES, negligible=0.0))


@pytest.mark.usefixtures("no_class")
@pytest.mark.parametrize(("below", "why"), [(True, OF_POSTS), (False, "")])
def test_glare_of_posts_alone_is_not_said(monkeypatch, below, why):
    monkeypatch.setattr(doubts, "shown_below", lambda step, problem: below)
    assert Doubts().against(step(candidate("blooming", 9, "range")), problem(), null=problem()) == why


@pytest.mark.usefixtures("no_class")
@pytest.mark.parametrize(("name", "why"), [("mixed_pixels", EXCHANGED), ("beam_range_bias", "")])
def test_exchanged_sides_are_asked_of_depth_steps_whatever_the_simulator(name, why):
    held = Doubts(exchanged=lambda: showing(why=EXCHANGED, effects=True))
    assert held.against(step(candidate(name, 9, "range")), problem(), null=problem()) == why


@pytest.mark.parametrize(("channel", "why"), [("drop", EXCHANGED), ("intensity", "")])
def test_exchanged_sides_are_asked_of_curves_of_losses_whatever_the_simulator(channel, why):
    held = Doubts(exchanged=lambda: showing(why=EXCHANGED, all_curves=True))
    along = Dependence(channel, "class", 1.0, 0.0, 0.0)
    assert held.against_curve(along, candidate("curve", 9, channel), problem()) == why


@pytest.mark.usefixtures("no_class")
def test_the_first_reason_decides_and_later_ones_are_not_asked():
    def later():
        raise AssertionError("was asked")

    held = Doubts([lambda: showing(why=CONTROL, effects=True), later])
    assert held.against(step(candidate("beam_gain", 9)), problem(), null=problem()) == CONTROL


@pytest.mark.usefixtures("no_class")
@pytest.mark.parametrize(("grows", "why"), [(True, ""), (False, UNFOUNDED)])
def test_noise_that_grows_is_said_where_neighbouring_readings_say_so(grows, why):
    noise = step(candidate("range_noise", 9, "range"))
    assert Doubts(noise_grows=lambda: grows).against(noise, problem(), null=problem()) == why


@pytest.mark.usefixtures("no_class")
@pytest.mark.parametrize(
    ("name", "each", "classless", "why"),
    [
        ("range_falloff", 1.2, True, OF_MATERIALS),
        ("range_falloff", 1.3, True, ""),
        ("range_falloff", 1.2, False, ""),
        ("beam_gain", 1.2, True, OF_MATERIALS),
        ("gamma_response", 1.2, True, OF_MATERIALS),
        ("gamma_response", 1.3, True, ""),
        ("window_contamination", 1.2, True, ""),
        ("intensity_quantization", 1.2, True, ""),
    ],
)
def test_what_goes_by_surfaces_must_gain_more_than_materials_make_where_no_class_tells_them_apart(
    name, each, classless, why
):
    """Of eleven scenes with 2000 rays, 14 nats."""
    seen = problem(ev=SimpleNamespace(compared=np.ones(2000, bool)))
    held = Doubts(classless=classless)
    assert held.against(step(candidate(name, each)), seen, null=seen) == why
    along = Dependence("intensity", "azimuth" if "window" in name else "height", 1.0, 0.0, 0.0)
    if name not in FINEST:
        assert held.against_curve(along, candidate("curve", each), seen) == why


@pytest.mark.usefixtures("no_class")
@pytest.mark.parametrize(("grows", "why"), [(True, ""), (False, EXCHANGED)])
def test_neighbouring_readings_say_which_side_has_the_noise(grows, why):
    """The sides exchanged would show the reverse of what is certain."""
    held = Doubts([lambda: showing(why=EXCHANGED, effects=True)], noise_grows=lambda: grows)
    assert held.against(step(candidate("range_noise", 9, "range")), problem(), null=problem()) == why


@pytest.mark.usefixtures("no_class")
def test_a_control_shows_noise_that_the_simulator_lacks_by_itself():
    held = Doubts([lambda: showing(why=CONTROL, effects=True)])
    assert held.against(step(candidate("range_noise", 9, "range")), problem(), null=problem()) == CONTROL


@pytest.mark.usefixtures("no_class")
@pytest.mark.parametrize(("never", "why"), [(True, RARELY_IF_EVER), (False, "")])
def test_what_may_never_act_is_not_said(never, why):
    glare = step(candidate("blooming", 9, "range"))
    held = Doubts(may_never_act=lambda step, beside: never)
    assert held.against(glare, problem(), null=problem()) == why


@pytest.mark.usefixtures("no_class")
def test_a_rare_event_may_be_in_few_scenes():
    rare = step(candidate("packet_loss", [40, 30, 20, *[0] * 8], "drop"))
    held = Doubts(may_never_act=lambda step, beside: True)
    assert held.against(rare, problem(), null=problem()) == ""


def test_classes_are_told_by_name(monkeypatch):
    monkeypatch.setattr(doubts, "RULES", replace(doubts.RULES, negligible=0.0))
    loss = step(candidate("random_dropout", 9, "drop"))
    monkeypatch.setattr(doubts, "denied_without", lambda step, problem: "")
    monkeypatch.setattr(doubts, "shown_by", lambda step, problem, classes: "sky" if classes else "")
    assert Doubts().against(loss, problem(), null=problem()) == ""
    assert Doubts(apart=(23,)).against(loss, problem(), null=problem()) == f"{SHOWN_BY} sky"
    monkeypatch.setattr(doubts, "denied_without", lambda step, problem: "terrain")
    assert Doubts(apart=(23,)).against(loss, problem(), null=problem()) == f"{DENIED} terrain"


@pytest.mark.long
@pytest.mark.usefixtures("standard_promotion")
@pytest.mark.parametrize(("share", "said"), [(0.002, False), (0.02, True)])
def test_false_returns_are_said_where_they_are_more_than_thin_things_make(share, said):
    """Cast and disturbed in plain NumPy: a share of the rays reads anything before its surface."""
    of = noisy_street.comparison({}, {"range_m": 0.01}, 12)
    rng = np.random.default_rng(2)
    false = rng.random(of.measured.valid.shape) < share
    early = np.where(false, rng.uniform(0.1, 0.9, false.shape), 1) * of.measured.range_m
    with looking_at(1 / 2 if said else 1):  # what is refused is just found in all rays
        null = NullModel.of(Division.of(replace(of, measured=replace(of.measured, range_m=early.astype(np.float32)))))
    told = name_effects(null.problem, [EFFECTS["interference"]], ())
    assert [step.chosen.effect.name for step in told.choice.steps] == ["interference"] * said
    assert told.elsewhere == (() if said else (("interference", SCARCE),))


@pytest.mark.long
@pytest.mark.usefixtures("standard_promotion")
@pytest.mark.parametrize(("scale", "said"), [(0.00015, False), (0.002, True)])
def test_what_is_too_small_to_matter_is_not_said(scale, said):
    """Cast and disturbed in plain NumPy: ranges are wrong by a seven-thousandth, or by what is clearly visible."""
    of = noisy_street.comparison({}, {"range_m": 0.01}, 12)
    off = replace(of.measured, range_m=(of.measured.range_m * (1 + scale)).astype(np.float32))
    with looking_at(1 / 2 if said else 1):
        null = NullModel.of(Division.of(replace(of, measured=off)))
    told = name_effects(null.problem, [EFFECTS["range_scale"]], ())
    assert [step.chosen.effect.name for step in told.choice.steps] == ["range_scale"] * said
    assert told.refused_for(NEGLIGIBLE) == (() if said else ("range_scale",))
