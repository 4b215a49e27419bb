"""A regime as the verdict holds it: what its places are; and what an answer with one keeps."""

import inspect
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from jaxsim.discover.name import select
from jaxsim.discover.name.answer import Answer
from jaxsim.discover.name.doubts import UNFOUNDED
from jaxsim.discover.name.other_sides import EXCHANGED
from jaxsim.discover.name.select import Choice
from jaxsim.discover.read.control import NO_CONTROL, Control
from jaxsim.discover.regimes import find
from jaxsim.discover.regimes.chance import FoundRegion
from jaxsim.discover.regimes.confine import Confined
from jaxsim.discover.regimes.find import find_regimes, regime_of
from jaxsim.discover.regimes.leads import Lead
from jaxsim.discover.regimes.questions import Facts, Question
from jaxsim.discover.regimes.sizes import OF_FIT, SIZE_SHARES, Sized
from jaxsim.discover.verdict import Interval
from jaxsim.effects.region import Region, within
from tests.discover.name.made import candidate, problem, step
from tests.discover.toy import toy
from tests.report.made_regimes import regime

FRAMES = 6
SLOPES = np.ones((len(SIZE_SHARES), FRAMES, 60))


@pytest.mark.parametrize(("times", "counted"), [(np.arange(FRAMES), False), (np.zeros(FRAMES), True)])
def test_scenes_are_counted_only_where_frames_say_no_moment_of_their_own(times, counted):
    """Moments a second apart from 0 on are the very numbers that scenes would have."""
    scan, _ = toy(frames=FRAMES, rows=4, columns=60)
    frame = np.arange(FRAMES)
    column = np.broadcast_to(np.arange(60), (FRAMES, 60))
    drives = tuple(f"drive {k}" for k in frame)
    facts = Facts(replace(scan, time_s=times.astype(np.float32)), drives, frame, frame, column)
    chosen = candidate("beam_gain", 4.0)
    late = Confined(step(chosen), chosen.effect, Region(time_s=(2.5, None)), frame > 2, problem(), 20.0)
    size = Interval(1.0, 0.9, 1.1, OF_FIT)
    question = Question("time", (late.region,), np.ones((1, FRAMES, 1), bool))
    lead = Lead(FoundRegion(question, 0, 0.001), (chosen,), 0, q_value=0.01)
    told = regime_of(Sized(late, size, size, SLOPES), lead, 20.0, facts=facts)
    assert (told.p_value, told.q_value, told.judge_nats) == (0.001, 0.01, 20.0)
    assert told.x == tuple(range(FRAMES))
    assert told.counted == counted


def divide(monkeypatch, lead: Lead, answer: Answer, *, controlled: bool = False, **more):
    """The answer in which this lead is the only one, and what free curves were asked with."""
    confined = SimpleNamespace(step=step(lead.candidates[0]), plain=lead.candidates[0].effect, advantage=20.0)
    asked = {}

    def named_answer(choice, **given):
        asked.update(given)
        return Answer("named", choice, None)

    judge = SimpleNamespace(gained=lambda *given, facts: (confined, 5.0))
    for name, stub in {
        "facts_of": lambda division: SimpleNamespace(scene=np.arange(3)),
        "questions": lambda facts: [],
        "of_named": lambda *given, **more: [lead] if lead.named else [],
        "of_candidates": lambda *given, **more: [] if lead.named else [lead],
        "_sized": lambda *given, **more: Sized(confined, *[Interval(1.0, 0.9, 1.1, OF_FIT)] * 2, SLOPES),
        "_with": lambda null, choice, *given, **more: choice,
        "_needed": lambda null, choice, **more: choice,
        "regime_of": lambda *given, **more: regime(Region(time_s=(2.5, None))),
        "AllScenes": SimpleNamespace(of=lambda model: None),
        "JudgeScenes": SimpleNamespace(of=lambda scenes: judge),
        "named_answer": named_answer,
    }.items():
        monkeypatch.setattr(find, name, stub)
    model = SimpleNamespace(problem=None, division=SimpleNamespace(control=Control() if controlled else NO_CONTROL))
    return inspect.unwrap(find_regimes)(model, answer, **more), asked


def lead_of(divides: str, **more) -> Lead:
    found = FoundRegion(SimpleNamespace(divides=divides), 0, 0.001)
    return Lead(found, (candidate("beam_gain", 40.0),), q_value=0.01, **more)


def test_an_answer_with_a_regime_keeps_what_was_found_and_not_said_and_asks_no_channel_that_was_left_out(monkeypatch):
    choice = Choice((step(candidate("beam_gain", 40.0)),), (), problem(), refused={"range_noise": UNFOUNDED})
    elsewhere = (("fog_backscatter", EXCHANGED),)
    given = Answer("named", choice, None, elsewhere=elsewhere)
    divided, asked = divide(monkeypatch, lead_of("time", step=0, named=True), given, without=("intensity",))
    assert len(divided.regimes) == 1
    assert (divided.answer.elsewhere, divided.answer.refused_for(UNFOUNDED)) == (elsewhere, ("range_noise",))
    assert asked["without"] == ("intensity",)


@pytest.mark.parametrize(
    ("divides", "controlled", "regimes"), [("scene", True, 0), ("scene", False, 1), ("time", True, 1)]
)
def test_beside_a_control_drives_that_only_readings_tell_apart_name_nothing(monkeypatch, divides, controlled, regimes):
    """A simulator may serve some drives ill by itself."""
    none = Answer("none", Choice((), (), problem()), None)
    divided, _ = divide(monkeypatch, lead_of(divides, step=None), none, controlled=controlled)
    assert len(divided.regimes) == regimes


def test_what_only_mended_an_effect_while_it_acted_everywhere_is_taken_back(monkeypatch):
    """A sector's falloff, fitted to all directions, left a dirty window in that sector."""
    chosen = candidate("range_falloff", 700.0)
    inside = within(chosen.effect, Region(azimuth_rad=(-0.5, 1.4)), np.ones(FRAMES, bool))
    confined = step(replace(chosen, effect=inside))
    window = step(candidate("window_contamination", 21.0))
    noise = step(candidate("range_noise", 50.0, "range"))
    asked = []

    def rank_effects(beside, effects):
        asked.extend(effect.name for effect in effects)
        return [candidate(effect.name, {"window_contamination": -3.0}.get(effect.name, 50.0)) for effect in effects]

    monkeypatch.setattr(select, "rank_effects", rank_effects)
    for module, name in ((select, "with_steps"), (find, "with_steps"), (select, "together")):
        monkeypatch.setattr(module, name, lambda null, steps: null)
    choice = Choice((confined, window, noise), (), problem())
    left = find._needed(problem(), choice, log=lambda line: None)
    assert left.steps == (confined, noise)
    assert left.needless == ("window_contamination",)
    # The effect in its region was shown to be needed when it was put there.
    assert confined.chosen.effect.name not in asked
