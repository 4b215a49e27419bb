"""verdict.json holds plain values that JSON can say."""

import json
from dataclasses import replace

import numpy as np

from jaxsim.discover.verdict import EveryFrame, Gap, Interval, Named, OddFrame, Verdict, plain
from tests.report import results


def test_parts_become_plain_values_of_six_digits():
    one = Interval(np.float64(1.23456789), -np.inf, 2.0, "m")
    assert plain(one) == {"value": 1.23457, "low": None, "high": 2.0, "unit": "m"}
    assert plain({"a": (one, np.nan), "b": np.float32(0.1), "c": "x", "d": True}) == {
        "a": [plain(one), None],
        "b": 0.1,
        "c": "x",
        "d": True,
    }


def test_vectors_become_lists_and_what_is_not_finite_null(tmp_path):
    beams = (Interval(1.0, 0.9, 1.1, "1"), Interval(2.0, 1.9, float("nan"), "1"))
    effect = Named("beam_gain", (), {}, ("intensity",), 0.01, Interval(9.0, 8.0, 10.0, "nats"), {"gain": beams})
    gap = Gap(0.2, 0.1, 0.05, 0.15, "m", floor=0.1, placebo=0.2, win_rate=1.0)
    verdict = Verdict(
        verdict="named",
        effects=(effect,),
        where=(),
        unexplained=None,
        gap={"intensity": gap},
        closure=None,
        find=("a",),
        judge=("b",),
        sha256="0",
        frames=2,
        seconds=1.234,
        moved={"gain": (float(np.float32(0.1)), np.inf)},
    )
    content = json.loads(verdict.save(tmp_path).read_text())
    gain = content["effects"][0]["parameters"]["gain"]
    assert gain == {"value": [1.0, 2.0], "low": [0.9, 1.9], "high": [1.1, None], "unit": "1"}
    assert content["gap"]["range"] is None
    assert content["gap"]["intensity"]["not_worse"] is True
    assert content["moved"] == {"gain": [0.1, None]}
    assert content["seconds"] == 1.23


def test_what_is_told_of_frames_that_were_not_read_is_null_where_all_were_read(tmp_path):
    verdict = results.none().verdict
    assert json.loads(verdict.save(tmp_path).read_text())["every_frame"] is None
    gains = {"intensity": Interval(2.0, 1.0, float("nan"), "nats a frame")}
    told = EveryFrame(10, 4, 2, gains, gains, gains, gains, (OddFrame("f1", "street1", -3.0),))
    written = json.loads(replace(verdict, every_frame=told).save(tmp_path).read_text())["every_frame"]
    assert (written["frames"], written["unseen"]) == (10, 2)
    assert written["gained"]["intensity"] == {"value": 2.0, "low": 1.0, "high": None, "unit": "nats a frame"}
    assert written["worst"] == [{"name": "f1", "scene": "street1", "nats": -3.0}]
