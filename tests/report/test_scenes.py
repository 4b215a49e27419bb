"""Clouds as a page's viewer gets them."""

import base64
import json
from dataclasses import replace

import numpy as np
import pytest

from jaxsim.report.accounts import residual_clouds
from jaxsim.report.scenes import (
    MOST_BYTES,
    Channel,
    Side,
    TurnedBoxes,
    TurnedScene,
    cloud_with_boxes,
    compared_clouds,
    packed,
    quantised,
    write_clouds,
)
from tests.report import results

CHANNEL = Channel("intensity", "intensity", 0.0, 0.5, "")


def plain(text: str) -> dict:
    return json.loads(text)


def decoded(text: str, kind: str) -> np.ndarray:
    return np.frombuffer(base64.b64decode(text), kind)


def test_places_come_back_to_half_a_step():
    xyz = np.random.default_rng(0).uniform(-70, 70, (500, 3))
    cells, low, step = quantised(xyz)
    assert cells.dtype == np.uint16
    assert np.abs(low + cells * step - xyz).max() <= step.max() / 2 + 1e-9
    assert step.max() < 0.003
    one = np.array([[1.0, 2.0, 3.0]])
    cells, low, step = quantised(one)
    np.testing.assert_allclose(low + cells * step, one)


def test_values_are_levels_and_none_is_0():
    side = Side(
        "a", np.zeros((4, 3)), {"intensity": np.array([0.0, 0.5, 9.0, np.nan])}, {"row": np.array([0, 1, -1, 3])}
    )
    got = plain(packed([TurnedScene("s", (side,))], [CHANNEL]))["scenes"][0]["sides"][0]
    assert decoded(got["values"]["intensity"], "u1").tolist() == [1, 255, 255, 0]
    assert decoded(got["picks"]["row"], "<u2").tolist() == [0, 1, 65535, 3]


def test_of_more_boxes_than_a_page_holds_the_first_scenes_are_shown():
    side = Side("a", np.zeros((4, 3)), {"intensity": np.zeros(4)})
    boxes = TurnedBoxes(np.tile([10.0, 0, 0, 4, 2, 1.5, 0.1], (600, 1)), detected=True)
    text = packed([TurnedScene(str(k), (side,), boxes=(boxes,)) for k in range(40)], [CHANNEL])
    assert len(text) <= MOST_BYTES
    shown = plain(text)["scenes"]
    assert [one["name"] for one in shown] == [str(k) for k in range(len(shown))]
    assert 10 <= len(shown) < 40
    assert all(len(one["boxes"]) == 600 for one in shown)
    crowded = replace(boxes, boxes=np.tile(boxes.boxes, (40, 1)))
    with pytest.raises(ValueError, match="the boxes of full alone are more than a page holds"):
        packed([TurnedScene("full", (side,), boxes=(crowded,))], [CHANNEL])


def test_large_clouds_are_thinned_to_what_a_page_may_hold():
    count = 400_000
    rng = np.random.default_rng(1)
    side = Side("a", rng.normal(size=(count, 3)), {"intensity": rng.uniform(size=count)})
    text = packed([TurnedScene("s", (side, Side("b", None, side.values)))], [CHANNEL])
    assert len(text) <= MOST_BYTES
    first, second = plain(text)["scenes"][0]["sides"]
    kept = len(decoded(first["xyz"], "<u2")) // 3
    assert count / 4 < kept < count
    assert len(decoded(second["values"]["intensity"], "u1")) == kept


def test_names_stay_inside_the_script():
    side = Side("</script>", np.zeros((1, 3)), {})
    text = packed([TurnedScene("<b>", (side,))], [CHANNEL])
    assert "<" not in text
    assert plain(text)["scenes"][0]["name"] == "<b>"


def test_nothing_to_show_and_points_of_nobody_are_refused():
    with pytest.raises(ValueError, match="0 scenes"):
        packed([], [CHANNEL])
    with pytest.raises(ValueError, match="has no points"):
        packed([TurnedScene("s", (Side("a", None, {}),))], [CHANNEL])


def test_a_reports_frames_are_seen_from_the_sensor_before_and_after():
    result = results.with_frames()
    section, scenes = residual_clouds(result)
    assert "drive 5, frame 0005" in section
    content = plain(scenes)
    assert [one["name"] for one in content["channels"]] == ["intensity", "range"]  # no ray's return was compared
    first, second = content["scenes"][0]["sides"]
    assert (first["name"], second["name"]) == ("before", "after")
    xyz = np.array(first["low"]) + decoded(first["xyz"], "<u2").reshape(-1, 3) * first["step"]
    frame = result.frames[0]
    np.testing.assert_allclose(np.linalg.norm(xyz, axis=1), frame.range_m, atol=0.01)
    azimuth = np.arctan2(xyz[:, 1], xyz[:, 0])
    np.testing.assert_allclose(np.sin(azimuth - result.grid.azimuth_rad[frame.column]), 0, atol=1e-3)
    assert (decoded(second["values"]["intensity"], "u1") == 128).all()


def test_a_report_without_frames_has_no_viewer():
    assert residual_clouds(results.named()) == ("", "")


def test_a_page_turns_simulated_beside_measured_and_boxes(tmp_path):
    points = np.random.default_rng(2).uniform(0, 1, (50, 4)).astype(np.float32)
    box = np.array([[10.0, 0, -1, 4, 2, 1.5, 0.3]])
    scenes = [compared_clouds("a", points, points[:20]), cloud_with_boxes("b", points, detected=box, labelled=box[:0])]
    path = write_clouds(tmp_path / "clouds.html", scenes, title="t", sentence="s", words="w")
    text = path.read_text()
    assert "simulated 50 | measured 20" in text
    content = plain(text.split('id="scenes">')[1].split("</script>")[0])
    assert [len(scene["sides"]) for scene in content["scenes"]] == [2, 1]
    (drawn,) = content["scenes"][1]["boxes"]
    corners = np.array(drawn["corners"])
    np.testing.assert_allclose(corners.mean(0), box[0, :3], atol=0.01)
    # A frame of which nothing was measured is shown alone.
    assert len(compared_clouds("c", points, points[:0]).sides) == 1


def test_a_page_without_boxes_has_no_columns_of_them(tmp_path):
    points = np.random.default_rng(2).uniform(0, 1, (50, 4)).astype(np.float32)
    nothing = np.zeros((0, 7))
    empty = cloud_with_boxes("b", points, detected=nothing, labelled=nothing)
    for scene, told in ((compared_clouds("a", points, points), False), (empty, True)):
        text = write_clouds(tmp_path / "clouds.html", [scene], title="t", sentence="s", words="w").read_text()
        assert ("boxes found" in text) is told
        assert "<dl>" not in text
