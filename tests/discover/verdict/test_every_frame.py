"""What is told of the frames that were not read goes into verdict.json as plain values."""

import json
from dataclasses import replace

from jaxsim.discover.verdict import EveryFrame, Interval, OddFrame
from tests.report import results


def test_it_stands_in_the_verdict_and_is_null_where_all_were_read(tmp_path):
    verdict = results.none().verdict
    assert json.loads(verdict.save(tmp_path).read_text())["every_frame"] is None
    gains = {"intensity": Interval(2.0, 1.0, float("nan"), "nats a frame")}
    told = EveryFrame(10, 4, 2, gains, gains, gains, gains, (OddFrame("f1", "street1", -3.0),))
    written = json.loads(replace(verdict, every_frame=told).save(tmp_path).read_text())["every_frame"]
    assert (written["frames"], written["unseen"]) == (10, 2)
    assert written["gained"]["intensity"] == {"value": 2.0, "low": 1.0, "high": None, "unit": "nats a frame"}
    assert written["worst"] == [{"name": "f1", "scene": "street1", "nats": -3.0}]
