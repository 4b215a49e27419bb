"""What is said of the candidates that are not named, and what a reader must know."""

import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from jaxsim.discover.find.division import Division
from jaxsim.discover.model.noise_levels import Levels
from jaxsim.discover.model.null_model import Residuals
from jaxsim.discover.model.parameters import to_z
from jaxsim.discover.name.answer import Answer
from jaxsim.discover.name.doubts import DENIED, NEGLIGIBLE, OF_MATERIALS, RARELY_IF_EVER
from jaxsim.discover.name.other_sides import CONTROL, EXCHANGED
from jaxsim.discover.name.select import Choice
from jaxsim.discover.read import Comparison
from jaxsim.discover.read.control import NO_CONTROL, Control
from jaxsim.discover.rules import RULES
from jaxsim.discover.show.explain import coarse_shapes, named, notes, usual_last, why_not
from jaxsim.discover.verdict import Interval, Level
from jaxsim.effects.chain import SensorModel
from tests.discover import verdicts
from tests.discover.name.made import candidate, problem, step


def test_each_candidate_is_told_why_it_was_not_named():
    best = candidate("beam_gain", 9)
    alike = candidate("range_falloff", 8.9)
    weak = candidate("saturation", 0.5)
    split = candidate("gamma_response", np.array([60, -20] * 5 + [0]), slope=np.array([3.0, -2.9] * 5 + [0.0]))
    little = candidate("oren_nayar", 4)
    ranking = (best, alike, split, little, weak)
    fall = candidate("atmospheric_extinction", 3)
    choice = Choice((step(best, alike, ranking=ranking), step(fall)), (), problem())
    assert why_not(best, choice) == ""
    assert why_not(alike, choice).startswith("these data cannot tell")
    assert weak.total < RULES.bar_nats
    assert "within what a null reaches" in why_not(weak, choice)
    assert why_not(split, choice) == "the scenes disagree on it"
    assert why_not(little, choice) == "it explains clearly less than the one that is named"
    assert why_not(fall, choice) == "named too, after beam_gain"
    nothing = Choice((), (split, little), problem())
    assert "weak beside gamma_response" in why_not(little, nothing)
    # The scenes agree on the best: a free curve kept all from being named.
    outdone = Choice((), (best, little), problem())
    assert why_not(best, outdone) == why_not(little, outdone) == "a free curve explains clearly more"
    refused = Choice((), (best,), problem(), refused={"beam_gain": "neighbours say no"})
    assert why_not(best, refused) == "neighbours say no"


def test_a_named_effect_tells_what_would_tell_its_look_alikes_apart():
    one = named(step(candidate("beam_gain", 9), candidate("range_falloff", 8.9)), {})
    assert one.look_alikes == ("range_falloff",)
    assert one.tell_apart["range_falloff"]
    assert (one.gain.value, one.gain.low, one.gain.high) == (9, 9, 9)


def partly(kind, **fields):
    """A struct of which only these fields are known."""
    made = object.__new__(kind)
    made.__dict__.update(fields)
    return made


def told(*steps, semantic=None, free_contrast=False, control=NO_CONTROL, drives="ab", sectors=1, **more):
    """The notes of an answer on frames of which nothing else must be known."""
    scan = SimpleNamespace(semantic=np.zeros((1, 2, 2), int) if semantic is None else semantic)
    comparison = partly(Comparison, notes=(), scenes=tuple(drives), scan=scan, control=control)
    simulator = SimpleNamespace(noise=more.pop("noise", Levels()), free_contrast=free_contrast)
    parts, blocks = SimpleNamespace(judge=("a",) * 5), SimpleNamespace(sectors=sectors)
    division = partly(Division, parts=parts, blocks=blocks, left_out=more.pop("left_out", ""), simulator=simulator)
    choice = Choice(steps, (), problem(), refused=more.pop("refused", {}))
    return notes(comparison, division, Answer("named", choice, None, **more))


def test_few_drives_that_are_cut_into_sectors_are_told():
    [note] = told(sectors=6)
    assert note.startswith("2 drives alone: each frame is cut into 6 sectors")
    [note] = told(drives="aa", sectors=12)
    assert note.startswith("1 drive alone: each frame is cut into 12 sectors")


def test_rays_that_are_left_out_are_told():
    [note] = told(left_out="3.5 % of the rays (29 % of terrain)")
    assert note.startswith("3.5 % of the rays (29 % of terrain) met a surface that one side alone has")


@pytest.mark.parametrize(
    ("gamma", "noise", "control", "said"),
    [
        (1.15, Levels(intensity_share=0.02), NO_CONTROL, True),
        (0.85, Levels(intensity_share=0.02), NO_CONTROL, False),
        (1.15, Levels(), NO_CONTROL, False),
        (1.15, Levels(intensity_share=0.02), Control(), False),
    ],
)
def test_contrasts_that_a_simulator_may_have_shrunk_are_told(gamma, noise, control, said):
    gained = step(candidate("gamma_response", 8))
    z = to_z(gained.chosen.effect, {"gamma": gamma}, 4)
    found = told(replace(gained, fit=replace(gained.fit, z=z)), noise=noise, control=control)
    assert any(note.startswith("gamma_response: measured contrasts are larger") for note in found) is said


def test_a_curve_that_unseen_scenes_do_not_gain_by_is_told():
    assert told() == ()
    [note] = told(unconfirmed=("intensity along range",))
    assert note.startswith("not confirmed on unseen scenes: intensity along range ")
    assert note.endswith("it is not added")


def test_what_one_class_alone_shows_is_told_to_be_of_its_surfaces():
    [note] = told(refused={"range_noise": f"{DENIED} terrain"})
    assert note.startswith("found, and not said: range_noise. All other surfaces speak against it, without those of")
    assert "terrain. It is taken for something of these surfaces" in note


def test_what_is_too_small_to_matter_is_told():
    [note] = told(refused={"range_scale": NEGLIGIBLE})
    assert note.startswith("found, and not said: range_scale. Each is less than 10 % of what is clearly visible of it")


def test_what_materials_make_as_well_is_told():
    [note] = told(refused={"range_falloff": OF_MATERIALS}, elsewhere=(("intensity along height", OF_MATERIALS),))
    assert note.startswith("found, and not said: range_falloff, intensity along height. The simulated frames tell no")


def test_what_may_never_act_is_told():
    [note] = told(refused={"blooming": RARELY_IF_EVER})
    assert note.startswith("found, and not said: blooming. The 90 % interval of how often it acts holds never")


def test_a_contrast_that_is_left_free_is_told():
    [note] = told(free_contrast=True)
    assert note.startswith("the sensor does not follow the simulator's contrast")


def test_what_follows_range_or_rows_is_told_to_be_doubtful_where_no_class_tells_surfaces_apart():
    one_kind, classes = np.zeros((1, 2, 2), int), np.array([[[7, 7], [11, 0]]])
    fall, gain = step(candidate("atmospheric_extinction", 9)), step(candidate("beam_gain", 9))
    [note] = told(gain, fall, semantic=one_kind)
    assert note.startswith("beam_gain, atmospheric_extinction: the simulated frames tell no classes")
    assert told(gain, fall, semantic=classes) == ()
    assert told(step(candidate("incidence_cosine", 9)), semantic=one_kind) == ()
    assert told(step(candidate("range_offset", 9)), semantic=one_kind) == ()


def range_levels(simulated_m: float, measured_m: float):
    """The levels of two sides with so much noise of the range."""
    sides = [Interval.exact(value, "m") for value in (simulated_m, measured_m)]
    return (Level("range_noise", *sides, missing=sides[1], beyond_usual=False),)


@pytest.mark.parametrize(
    ("simulated_m", "off_m", "coarse"), [(0.0, 0.05, True), (0.0, 0.015, False), (0.04, 0.05, False)]
)
def test_shapes_that_are_off_by_more_than_noise_are_told(simulated_m, off_m, coarse):
    off = np.random.default_rng(0).normal(0, off_m, (2, 40, 30))
    counts = np.ones(off.shape, bool)
    # Rays that met another thing, and rays that say nothing, change nothing.
    off[:, :2], off[:, 2:4], counts[:, 2:4] = 1.0, 9.0, False
    told = [*coarse_shapes(Residuals(off, off, counts), range_levels(simulated_m, 0.012))]
    assert bool(told) == coarse
    if coarse:
        assert re.match(
            r"simulated surfaces are off the measured ones by [45]\.\d cm, where noise makes 1.2 cm", told[0]
        )


def test_where_no_surface_is_smooth_nothing_is_said_of_shapes():
    nothing = np.zeros((1, 2, 3))
    assert [*coarse_shapes(Residuals(nothing, nothing, nothing > 0), range_levels(0.0, 0.012))] == []


def test_what_a_control_put_in_place_is_told():
    model = SensorModel((("range_offset", {"offset_m": 0.05}),))
    [note] = told(control=Control(model, folders=(Path("simulated"), Path("measured"))))
    assert "in place from the start" in note
    assert "(range_offset)" in note
    [_, lost] = told(control=Control(model))
    assert "the control's frames are not where its answer found them" in lost
    [nothing, _] = told(control=Control())
    assert "(nothing)" in nothing


def test_what_other_sides_show_as_well_is_told_with_what_that_means():
    found = (("mixed_pixels", EXCHANGED), ("snr_dropout", CONTROL), ("drop along power", CONTROL))
    [noise, own] = told(elsewhere=found)
    assert "not said: mixed_pixels. With the sides exchanged" in noise
    assert "what noise of both does" in noise
    assert "not said: snr_dropout, drop along power. The control's frames do not clearly differ in it" in own
    assert "by itself, and nothing new" in own


def test_losses_and_lattices_that_every_sensor_has_come_after_all_else_and_others_where_they_were_found():
    fine = verdicts.effect("range_quantization", "range", step_m=Interval.exact(0.002, "m"))
    coarse = verdicts.effect("intensity_quantization", "intensity", step=Interval.exact(0.02, ""))
    gain = verdicts.effect("beam_gain", "intensity", gain=Interval.exact(0.1, "nats"))
    assert usual_last([fine, coarse, gain]) == (coarse, gain, fine)
    assert usual_last([fine]) == (fine,)
    few, many = (
        verdicts.effect("random_dropout", "drop", probability=Interval.exact(share, "")) for share in (0.01, 0.05)
    )
    assert usual_last([many, few, gain]) == (many, gain, few)
