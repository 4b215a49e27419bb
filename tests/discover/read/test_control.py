"""What a simulator lacks by itself: read from an earlier answer, put in place, and no longer named."""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import jax
import numpy as np
import pytest

from jaxsim.data.polar_frames import write_frame, write_grid
from jaxsim.discover import NO_CONTROL, Comparison, Control, discover
from jaxsim.discover.find.division import Division, NullModel
from jaxsim.discover.read.control import read_sides, write_sides
from jaxsim.discover.verdict import Contrast, InPlace, Interval, Level, Verdict
from jaxsim.effects.chain import SensorModel
from jaxsim.frame import PolarGrid, PolarImage
from tests.discover.toy import toy
from tests.report import results

pytestmark = pytest.mark.usefixtures("standard_promotion")
FRAMES = 12
AT_MOST = Interval(1, 0.9, 1.1, "m")
PAIRED = (Level("range_noise", AT_MOST, AT_MOST, AT_MOST, beyond_usual=False),)
"""Levels, which answers have where frames were compared ray by ray."""
TURN = ("extrinsic_rotation", {"yaw_rad": 0.01})
FALL = ("range_falloff", {"exponent": 0.4})


def drives(count: int) -> Iterator[Comparison]:
    """As many drives of one car, whose sensor reads ranges too far by 8 cm: its simulator lacks that. Twelve streets
    each."""
    scan, measured = toy(frames=count * FRAMES)
    far_m = np.where(measured.valid, measured.range_m + np.float32(0.08), 0)
    measured = replace(measured, range_m=far_m)
    names = tuple(f"{k:02d}" for k in range(FRAMES))
    for first in range(0, count * FRAMES, FRAMES):
        of_drive = slice(first, first + FRAMES)
        cut = partial(jax.tree.map, lambda leaf, of_drive=of_drive: np.asarray(leaf)[of_drive])
        yield Comparison(replace(cut(replace(scan, grid=None)), grid=scan.grid), cut(measured), names, names)


def named_of(verdict: Verdict) -> list[str]:
    return [effect.name for effect in verdict.effects]


@pytest.mark.long
# Of the same streets `stages` asks, and tests/discover/stages/test_conclude.py holds its answer.
@pytest.mark.parametrize("answered", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_what_the_control_lacks_as_well_is_not_named(answered):
    before, same, later = drives(3)
    asked = partial(discover, effects=["gamma_response", "range_offset"])
    lacks = SensorModel((("range_offset", {"offset_m": 0.08}),))
    if answered:
        control = asked(before)
        assert named_of(control.verdict) == ["range_offset"]
        lacks = control.effects_model
    beside = Control(lacks)

    null = asked(replace(same, control=beside))
    assert null.verdict.verdict == "none"
    assert null.verdict.control is not None
    assert null.verdict.control.names == ("range_offset",)
    assert null.effects_model.effects == ()

    bent = replace(later.measured, intensity=later.measured.intensity ** np.float32(0.75))
    new = asked(replace(later, measured=bent, control=beside))
    assert named_of(new.verdict) == ["gamma_response"]
    assert dict(new.effects_model.effects)["gamma_response"]["gamma"] == pytest.approx(0.75, abs=0.03)
    # The model holds what is new; what the control has stays its own.
    assert [name for name, _ in new.effects_model.effects] == ["gamma_response"]
    assert any("in place from the start" in note and "range_offset" in note for note in new.verdict.notes)


def test_more_of_what_the_control_has_is_still_a_candidate():
    [one] = drives(1)
    half = SensorModel((("range_falloff", {"exponent": 0.3}),))
    plain = NullModel.of(Division.of(one), SensorModel((("range_falloff", {"exponent": 0.6}),)))
    beside = NullModel.of(Division.of(replace(one, control=Control(half))), half)
    np.testing.assert_allclose(beside.problem.ev.rays.log_intensity, plain.problem.ev.rays.log_intensity, atol=1e-5)


def test_a_control_leaves_the_contrast_free_where_it_was_off():
    [one] = drives(1)
    assert not Division.of(replace(one, control=Control())).simulator.free_contrast
    assert Division.of(replace(one, control=Control(contrast_off=True))).simulator.free_contrast


def test_a_mounting_is_put_in_place_by_casting_and_the_rest_by_rays():
    control = Control(SensorModel((FALL, TURN)))
    assert [name for name, _ in control.mounting.effects] == ["extrinsic_rotation"]
    assert [name for name, _ in control.of_rays.effects] == ["range_falloff"]
    assert NO_CONTROL.mounting == NO_CONTROL.of_rays == SensorModel()


def test_a_control_of_these_frames_or_of_another_grid_is_refused(tmp_path: Path):
    grid = PolarGrid(*(np.linspace(1, -1, n, dtype=np.float32) for n in (8, 4)), np.zeros(4, np.float32))
    folders = {name: tmp_path / name for name in ("simulated", "measured", "new", "wide")}
    for name, folder in folders.items():
        write_grid(folder, grid.replace(azimuth_rad=2 * grid.azimuth_rad) if name == "wide" else grid)
    control = Control(folders=(folders["simulated"], folders["measured"]))
    control.check_new(folders["simulated"], folders["new"])
    NO_CONTROL.check_new(folders["wide"], folders["measured"])
    with pytest.raises(ValueError, match=r"measured are the frames of the control"):
        control.check_new(folders["simulated"], folders["measured"])
    seen = np.ones((4, 8), np.float32)
    for name in ("measured", "new"):
        write_frame(folders[name], "a", PolarImage(seen, seen / 2, seen > 0))
        write_frame(folders[name], "b", PolarImage(seen * len(name), seen / 2, seen > 0))
    with pytest.raises(ValueError, match=r"a of .*new holds the readings of the control's a"):
        control.check_new(folders["simulated"], folders["new"])
    (folders["new"] / "a.npz").unlink()
    control.check_new(folders["simulated"], folders["new"])
    with pytest.raises(ValueError, match=r"differ in azimuth_rad .*; a control is of the same simulated sensor"):
        control.check_new(folders["wide"], folders["new"])


def test_where_frames_are_is_noted_from_the_answer_itself_where_they_are_in_it(tmp_path: Path):
    out = tmp_path / "answer"
    for folder in (out / "simulated", tmp_path / "measured"):
        folder.mkdir(parents=True)
    write_sides(out, out / "simulated", tmp_path / "measured")
    assert read_sides(out) == (out / "simulated", tmp_path / "measured")
    moved = out.rename(tmp_path / "kept")
    assert read_sides(moved) == (moved / "simulated", tmp_path / "measured")
    (moved / "simulated").rmdir()
    assert read_sides(moved) is None
    assert read_sides(tmp_path) is None
    (moved / "sides.json").write_text("{}")
    with pytest.raises(ValueError, match=r"sides.json must hold 'simulated'"):
        read_sides(moved)


def test_an_earlier_answer_is_a_control(tmp_path: Path):
    result = results.named()
    contrast = Contrast({"cells": Interval(1, 0.9, 1.1, "")}, Interval(50, 40, 60, "nats per scene"), 0.01)
    replace(result.verdict, contrast=contrast, levels=PAIRED).save(tmp_path)
    replace(result.effects_model, levels={"range_noise": 0.02}).save(tmp_path / "sensor.json")
    control = Control.load(tmp_path, rows=results.ROWS)
    assert control.contrast_off
    assert control.model == replace(result.effects_model, levels={})
    assert Control.load(tmp_path) == control


def test_what_is_no_earlier_answer_is_refused(tmp_path: Path):
    with pytest.raises(ValueError, match=r"^discover: no file .*verdict.json; a control is the folder of an earlier"):
        Control.load(tmp_path)
    (tmp_path / "verdict.json").write_text("[]")
    with pytest.raises(ValueError, match=r"is no verdict of `jaxsim discover`"):
        Control.load(tmp_path)
    (tmp_path / "verdict.json").write_text("{}")
    with pytest.raises(ValueError, match=r"lacks 'levels'"):
        Control.load(tmp_path)
    result = results.named()
    replace(result.verdict, levels=()).save(tmp_path)
    with pytest.raises(ValueError, match=r"is an answer of --unpaired frames"):
        Control.load(tmp_path)
    replace(result.verdict, levels=PAIRED, control=InPlace(("beam_gain",), contrast_off=False)).save(tmp_path)
    with pytest.raises(ValueError, match=r"is itself an answer beside a control"):
        Control.load(tmp_path)
    replace(result.verdict, levels=PAIRED).save(tmp_path)
    with pytest.raises(ValueError, match=r"no file .*sensor.json"):
        Control.load(tmp_path)
    SensorModel((("beam_gain", {"gain": (0.1, -0.1)}),)).save(tmp_path / "sensor.json")
    with pytest.raises(ValueError, match=r"beam_gain"):
        Control.load(tmp_path, rows=16)
