"""A gate: what passes, what is a gap, what cannot be judged; and its distances against the plainest computation."""

import json
import shlex
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from jaxsim.cli import discover, main
from jaxsim.discover.distances import quick_distances
from jaxsim.discover.gate import (
    check_quick,
    check_verdict,
    colour_of,
    read_gate,
    save_gate,
    thresholds_of,
)
from jaxsim.discover.verdict import Interval, Named
from tests.discover.made_embedded import write_streets
from tests.discover.made_gate import sides
from tests.report import results


def test_of_a_hundred_means_at_the_threshold_at_most_five_turn_red():
    """Scenes that scatter about the threshold itself, the hardest null: red where the whole interval lies above."""
    rng = np.random.default_rng(0)
    red = [Interval.of_scenes(rng.normal(0.1, 0.03, 8), "").low > 0.1 for _ in range(1000)]
    assert np.mean(red) < 0.07


def gate(tmp_path, **content):
    (tmp_path / "gate.json").write_text(json.dumps(content))
    return read_gate(tmp_path / "gate.json")


def test_fast_is_red_for_a_gap_green_without_and_unsure_between(tmp_path):
    simulated, measured = sides(tmp_path / "null")
    asked = gate(tmp_path, thresholds={"intensity": 0.02, "range": 0.05, "drop": 0.05})
    checks = check_quick(asked, quick_distances(simulated, measured))
    assert {check.colour for check in checks} == {"pass"}
    simulated, measured = sides(tmp_path / "bright", gain=1.2)
    checks = check_quick(asked, quick_distances(simulated, measured))
    assert {check.name: check.colour for check in checks} == {"intensity": "gap", "range": "pass", "drop": "pass"}
    near = quick_distances(simulated, measured).channels["drop"]
    asked = gate(tmp_path, thresholds={"drop": near.value - (near.value - near.low) / 2})
    assert colour_of(check_quick(asked, quick_distances(simulated, measured))) == "unsure"


def test_a_whole_answer_is_red_for_effects_that_may_not_be_missing(tmp_path):
    verdict = results.named().verdict
    effect = verdict.effects[0].name
    most = {channel: 2 * gap.before for channel, gap in verdict.gap.items()}
    (checks) = check_verdict(gate(tmp_path, thresholds=most), verdict)
    assert checks[0].colour == "gap"
    assert effect in checks[0].words
    assert {check.colour for check in checks[1:]} == {"pass"}
    assert colour_of(check_verdict(gate(tmp_path, thresholds=most, allowed=[effect]), verdict)) == (
        "pass" if len(verdict.effects) == 1 else "gap"
    )
    everything = [one.name for one in verdict.effects]
    least = {channel: gap.before / 2 for channel, gap in verdict.gap.items()}
    checks = check_verdict(gate(tmp_path, thresholds=least, allowed=everything), verdict)
    assert [check.colour for check in checks] == ["pass", *["gap"] * len(least)]


def unseen(verdict, *, nats):
    """The verdict with this gain of judge scenes in its intensity, and none elsewhere."""
    gap = {
        name: replace(one, gained=one.gained and replace(one.gained, value=nats * (name == "intensity")))
        for name, one in verdict.gap.items()
    }
    return replace(verdict, gap=gap)


def test_a_gate_is_unsure_of_what_has_no_name_and_no_gain(tmp_path):
    [check] = check_verdict(gate(tmp_path, allowed=[]), unseen(results.not_in_catalogue().verdict, nats=0.4))
    assert check.colour == "unsure"
    assert "along range (0.4 nats a judge scene)" in check.words


def test_a_gate_is_unsure_of_effects_that_chance_may_have_named(tmp_path):
    certain = results.named().verdict
    effects = tuple(replace(one, gain=replace(one.gain, value=1.2)) for one in certain.effects)
    faint = replace(certain, effects=effects)
    [check] = check_verdict(gate(tmp_path, allowed=[]), faint)
    assert check.colour == "unsure"
    assert f"the simulation may lack {effects[0].name} (" in check.words
    assert "1.2 nats per scene" in check.words
    assert colour_of(check_verdict(gate(tmp_path, effect_nats=1.0), faint)) == "gap"
    assert colour_of(check_verdict(gate(tmp_path, effect_nats=0), faint)) == "gap"
    assert colour_of(check_verdict(gate(tmp_path, effect_nats=1e9), certain)) == "unsure"
    # One that is certain makes the answer so.
    assert colour_of(check_verdict(gate(tmp_path, allowed=[]), replace(faint, effects=certain.effects))) == "gap"


def test_a_baseline_allows_what_was_so_before(tmp_path):
    verdict = results.named().verdict
    verdict.save(tmp_path)
    assert colour_of(check_verdict(gate(tmp_path, baseline="verdict.json"), verdict)) == "pass"
    none = results.none().verdict
    none.save(tmp_path)
    assert colour_of(check_verdict(gate(tmp_path, baseline="verdict.json"), verdict)) == "gap"


@pytest.mark.parametrize(("now_m", "colour"), [(0.0, "pass"), (1e-7, "pass"), (0.01, "gap")])
def test_rounding_is_no_more_than_a_baseline_of_nothing(tmp_path, now_m, colour):
    def apart(by_m):
        gap = results.none().verdict.gap
        return replace(results.none().verdict, gap={"range": replace(gap["range"], before=by_m)})

    apart(0.0).save(tmp_path)
    assert colour_of(check_verdict(gate(tmp_path, baseline="verdict.json"), apart(now_m))) == colour


@pytest.mark.parametrize("frames", ["17", 16.5, True, 0, [17]])
def test_a_baseline_of_no_number_of_frames_is_refused(tmp_path, frames):
    """It asked for none."""
    results.named().verdict.save(tmp_path)
    content = json.loads((tmp_path / "verdict.json").read_text())
    assert gate(tmp_path, baseline="verdict.json").fewest_frames > 0
    (tmp_path / "verdict.json").write_text(json.dumps(content | {"frames": frames}))
    with pytest.raises(ValueError, match=r"verdict\.json: frames is .*; it must be a whole number above 0"):
        gate(tmp_path, baseline="verdict.json")


def test_what_has_no_name_is_a_gap_unless_allowed(tmp_path):
    verdict = unseen(results.not_in_catalogue().verdict, nats=3.0)
    assert colour_of(check_verdict(gate(tmp_path, allowed=[]), verdict)) == "gap"
    allowed = ["not_in_catalogue", *(one.name for one in verdict.effects)]
    assert colour_of(check_verdict(gate(tmp_path, allowed=allowed), verdict)) == "pass"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({}, "asks nothing"),
        ({"threshold": 1}, "threshold"),
        ({"thresholds": {"colour": 1}}, "colour"),
        ({"thresholds": {"range": -1}}, "must be a number above 0"),
        ({"thresholds": {"range": "x"}}, "must be a number above 0"),
        ({"allowed": ["fogg"]}, "fogg"),
        ({"baseline": 5}, "must be the path of a verdict.json"),
        ({"effect_nats": -1}, "effect_nats is -1; it must be a number, 0 or more"),
        ({"effect_nats": True}, "effect_nats is True"),
        ({"effect_nats": "2"}, "effect_nats is '2'"),
    ],
)
def test_gates_that_cannot_be(tmp_path, content, message):
    with pytest.raises(ValueError, match=message):
        gate(tmp_path, **content)


def test_a_gate_is_written_from_frames_that_are_right_and_asked_of_others(tmp_path):
    """As a user does: two commands, no number of his own."""
    words = ["--gate", str(tmp_path / "gate.json"), "--fast", "--out", str(tmp_path / "out")]

    def both(name, **changes):
        simulated, measured = sides(tmp_path / name, **changes)
        return ["--simulated", str(simulated), "--measured", str(measured)]

    main(["discover", *both("right"), "--write-gate", *words[1:]])
    shown = quick_distances(tmp_path / "right/simulated", tmp_path / "right/measured")
    asked = read_gate(tmp_path / "gate.json")
    for name, one in shown.channels.items():
        assert asked.thresholds[name] == pytest.approx(1.1 * one.high, rel=1e-3)
    for name, changes, code in (("later", {"seed": 1}, 0), ("bright", {"seed": 1, "gain": 1.3}, 1)):
        with pytest.raises(SystemExit) as stop:
            main(["discover", *both(name, **changes), *words])
        assert stop.value.code == code


def test_a_gate_of_frames_that_differ_by_nothing_asks_for_no_less_than_files_hold(tmp_path):
    nothing = Interval(0.0, 0.0, 0.0, "m")
    unseen = Interval(float("nan"), float("nan"), float("nan"), "m")
    assert thresholds_of({"range": nothing, "drop": unseen}) == {"range": 0.001}
    with pytest.raises(ValueError, match="nothing to ask"):
        save_gate(tmp_path / "gate.json", thresholds=thresholds_of({"drop": unseen}))


def test_a_whole_answer_becomes_the_baseline_of_the_gate_that_is_written(tmp_path, monkeypatch):
    def answered(self):
        verdict = results.named().verdict
        verdict.save(self.out)
        return verdict

    monkeypatch.setattr(discover.Discover, "answer", answered)
    (tmp_path / "gates").mkdir()
    asked = discover.Discover(out=tmp_path / "out", write_gate=tmp_path / "gates/gate.json")
    asked()
    assert json.loads((tmp_path / "gates/gate.json").read_text()) == {"baseline": "../out/verdict.json"}
    assert colour_of(check_verdict(read_gate(tmp_path / "gates/gate.json"), results.named().verdict)) == "pass"


@pytest.mark.slow
def test_one_effect_in_the_embedded_worlds_sensor_turns_the_gate_red_and_is_named(
    tmp_path, monkeypatch, capsys, standard_promotion
):
    """The commands of docs/bring-yours.md, as they stand there, with the page's own gate; 4 minutes of processor."""
    monkeypatch.chdir(tmp_path)
    write_streets(tmp_path)
    Path("whole.json").write_text('{"allowed": ["random_dropout"], "baseline": "verdict.json"}')

    def stand_as_measured(side):
        Path("measured").unlink(missing_ok=True)
        Path("measured").symlink_to(side)

    def ended(side):
        """Status, JUnit's suite and Markdown of the gate on one side's frames."""
        stand_as_measured(side)
        with pytest.raises(SystemExit) as stop:
            main(shlex.split("discover --measured measured --simulated simulated --gate whole.json --out answer"))
        return stop.value.code, ET.parse("answer/junit.xml").getroot(), Path("answer/gate.md").read_text()

    stand_as_measured("first")
    main(shlex.split("discover --measured measured --simulated simulated --out answer"))
    Path("answer/verdict.json").rename("verdict.json")
    assert json.loads(Path("verdict.json").read_text())["verdict"] == "none"
    # The same sensor measures again: nothing has changed.
    code, suite, summary = ended("again")
    assert (code, suite.get("failures")) == (0, "0")
    assert "no effect is missing" in summary
    code, suite, summary = ended("changed")
    assert (code, suite.get("failures")) == (1, "1")
    named = [one["name"] for one in json.loads(Path("answer/verdict.json").read_text())["effects"]]
    assert named == ["range_falloff"]
    assert "the simulation lacks range_falloff" in ET.tostring(suite, encoding="unicode")
    assert "**gap**" in summary
    assert "the simulation lacks range_falloff" in summary
    assert "the simulation lacks range_falloff" in capsys.readouterr().out


@pytest.mark.parametrize("lost", ["left out", "not a number"])
def test_a_channel_that_was_compared_before_and_is_not_now_is_unsure(tmp_path, lost):
    verdict = results.named().verdict
    verdict.save(tmp_path)
    asked = gate(tmp_path, baseline="verdict.json")
    channels = dict(verdict.gap)
    drop = channels.pop("drop")
    if lost == "not a number":
        channels["drop"] = replace(drop, before=float("nan"))
    checks = {check.name: check for check in check_verdict(asked, replace(verdict, gap=channels))}
    told = checks["drop against baseline"]
    assert (told.colour, told.words) == ("unsure", "the channel was not compared")
    assert checks["range against baseline"].colour == "pass"


def test_a_simulator_that_renders_nothing_in_most_frames_is_red(tmp_path):
    simulated, measured = sides(tmp_path)
    asked = gate(tmp_path, thresholds=thresholds_of(quick_distances(simulated, measured).channels))
    for file in sorted(simulated.glob("*.npz"))[2:]:
        np.savez(file, **{name: np.zeros_like(array) for name, array in np.load(file).items()})
    colours = {check.name: check.colour for check in check_quick(asked, quick_distances(simulated, measured))}
    assert colours["drop"] == "gap"


def test_frames_that_are_missing_leave_a_gate_unsure(tmp_path):
    simulated, measured = sides(tmp_path)
    asked = gate(tmp_path, thresholds={"intensity": 0.02})
    for file in sorted(simulated.glob("*.npz"))[5:]:
        file.unlink()
    told = check_quick(asked, quick_distances(simulated, measured))[-1]
    assert (told.name, told.colour) == ("frames", "unsure")
    assert "5 frames compared, and at least 8 must be" in told.words
    enough = gate(tmp_path, thresholds={"intensity": 0.02}, frames=5)
    assert colour_of(check_quick(enough, quick_distances(simulated, measured))) == "pass"


def test_a_gate_that_is_written_asks_for_nine_tenths_of_its_frames(tmp_path):
    save_gate(tmp_path / "gate.json", thresholds={"drop": 0.1}, frames=16)
    assert read_gate(tmp_path / "gate.json").frames == 15
    verdict = results.named().verdict
    verdict.save(tmp_path)
    asked = gate(tmp_path, baseline="verdict.json")
    fewer = replace(verdict, frames=int(0.8 * verdict.frames))
    assert "frames" not in {check.name for check in check_verdict(asked, verdict)}
    assert {check.name: check.colour for check in check_verdict(asked, fewer)}["frames"] == "unsure"


def test_a_file_that_is_no_gate_is_not_written_over(tmp_path):
    for content in ('{"azimuth": [1.0]}', "[]", "no json"):
        (tmp_path / "grid.json").write_text(content)
        with pytest.raises(ValueError, match=r"grid\.json is there, and is no gate: .*; give another --write-gate"):
            save_gate(tmp_path / "grid.json", thresholds={"drop": 0.1})
        assert (tmp_path / "grid.json").read_text() == content
    for most in (0.1, 0.2):
        save_gate(tmp_path / "gate.json", thresholds={"drop": most})
    assert read_gate(tmp_path / "gate.json").thresholds == {"drop": 0.2}


@pytest.mark.parametrize("said", ["unrelated", "a curve", "a pattern"])
def test_what_was_not_asked_or_has_no_name_beside_what_may_be_missing_is_unsure(tmp_path, said):
    named = results.named().verdict
    more = {
        "unrelated": {"unrelated": True},
        "a curve": {"unexplained": results.not_in_catalogue().verdict.unexplained},
        "a pattern": {"repeats": results.repeating().verdict.repeats},
    }
    verdict = unseen(replace(named, **more[said]), nats=sum(one.gain.value for one in named.effects))
    allowed = [one.name for one in named.effects]
    assert colour_of(check_verdict(gate(tmp_path, allowed=allowed), named)) == "pass"
    assert colour_of(check_verdict(gate(tmp_path, allowed=allowed), verdict)) == "unsure"
    # What judge scenes gain beyond the named effects is the curve's.
    much = unseen(verdict, nats=sum(one.gain.high for one in named.effects) + 3)
    red = colour_of(check_verdict(gate(tmp_path, allowed=allowed), much))
    assert red == ("unsure" if said == "unrelated" else "gap")
    verdict.save(tmp_path)
    assert colour_of(check_verdict(gate(tmp_path, baseline="verdict.json"), verdict)) == "pass"


@pytest.mark.parametrize("result", ["named", "none", "not_in_catalogue", "repeating"])
def test_a_baseline_passes_itself(tmp_path, result):
    verdict = getattr(results, result)().verdict
    verdict.save(tmp_path)
    assert colour_of(check_verdict(gate(tmp_path, baseline="verdict.json"), verdict)) == "pass"


def test_a_baseline_of_another_kind_of_answer_is_no_measure(tmp_path):
    verdict = results.named().verdict
    verdict.save(tmp_path)
    asked = gate(tmp_path, baseline="verdict.json")
    other = replace(verdict, gap={name: replace(one, unit="of another kind") for name, one in verdict.gap.items()})
    checks = [check for check in check_verdict(asked, other) if check.name.endswith("against baseline")]
    assert {check.colour for check in checks} == {"unsure"}
    assert all("an answer of another kind" in check.words for check in checks)


@pytest.mark.parametrize(("p", "colour"), [(2.0**-12, "gap"), (0.03, "unsure")])
def test_losses_that_gain_no_nats_are_red_by_their_chance(tmp_path, p, colour):
    share = Interval(0.45, 0.44, 0.46, "share of rays")
    lost = Named("random_dropout", (), {}, ("drop",), p, share, {})
    [check] = check_verdict(gate(tmp_path, allowed=[]), replace(results.named().verdict, effects=(lost,)))
    assert check.colour == colour
    assert "0.45 share of rays" in check.words
    assert ("losses at a p above 0.01" in check.words) == (colour == "unsure")


@pytest.mark.parametrize("channel", ["intensity", "drop"])
def test_a_threshold_in_percent_would_never_be_reached(tmp_path, channel):
    asked = gate(tmp_path, thresholds={channel: 5})
    with pytest.raises(ValueError, match=rf"the threshold of {channel} is 5, .*give a number below 1"):
        check_quick(asked, quick_distances(*sides(tmp_path)))
