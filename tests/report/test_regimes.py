"""A report's account of regimes: where, how large, and the strip on which moments and sectors answer to a click."""

import json
from dataclasses import replace

import numpy as np
import pytest

from jaxsim.effects.region import Region
from jaxsim.report.canvas import Canvas
from jaxsim.report.regimes import picks_of, strip_chart
from jaxsim.report.words import part_of, verdict_sentence
from tests.report import results
from tests.report.drawn import elements, points, texts
from tests.report.made_regimes import LATE, regime, sectors, with_regime


def test_a_regime_has_a_table_a_strip_and_a_sentence(tmp_path):
    result = with_regime(regime(Region(time_s=(90.0, None))))
    page = results.page(tmp_path, result)
    assert "Where and when it acts" in page
    assert "from 90.0 s on" in page
    assert (tmp_path / "figures" / "regime_beam_gain.svg").is_file()
    assert "beam_gain acts from 90.0 s on alone (50 % of the rays)." in verdict_sentence(result.verdict)
    results.page(tmp_path, results.named())
    assert not (tmp_path / "figures" / "regime_beam_gain.svg").exists()


def test_what_simulations_cannot_know_is_said():
    one = regime(Region(scenes=("a", "b", "c")), "scene")
    assert "simulations cannot know where" in verdict_sentence(with_regime(one).verdict)


@pytest.mark.parametrize(
    ("where", "words"),
    [
        (Region(azimuth_rad=(3.0, 3.5)), "between 172° and −159° of azimuth"),
        (Region(time_s=(None, 40.0)), "until 40.0 s"),
        (Region(time_s=(10.0, 40.0)), "from 10.0 s to 40.0 s"),
        (Region(tag="night"), "in frames tagged night"),
        (Region(scenes=("a", "b")), "in 2 drives that nothing in grid.json tells from the others"),
    ],
)
def test_a_part_in_words(where, words):
    assert part_of(regime(where)) == words


def test_verdict_json_has_the_part_and_null_where_nothing_tells_a_size():
    told = with_regime(regime(Region(time_s=(90.0, None)))).verdict.to_json()["regimes"][0]
    assert told["where"] == {"time_s": [90.0, None]}
    assert told["sizes"] == [0.1, None, 1.1, 0.9]
    json.dumps(told, allow_nan=False)


def targets(canvas: Canvas | None) -> list[dict[str, str]]:
    assert canvas is not None
    return [dict(one.attrib) for one in elements(canvas, "rect") if one.get("class") == "target"]


def test_every_moment_shows_the_judge_frame_that_is_nearest():
    frames = results.with_frames().frames
    drawn = strip_chart(regime(LATE), frames=frames)
    found = targets(drawn)
    assert [(one["data-chart"], one["data-index"]) for one in found] == [("scene", "0"), ("scene", "1")]
    assert [one["aria-label"].split(", ")[-1] for one in found] == ["40.0 s: does not act", "130 s: acts"]
    ends = [(float(one["x"]), float(one["x"]) + float(one["width"])) for one in found]
    # They meet halfway between the frames, and together are as wide as the chart.
    assert ends[0][1] == pytest.approx(ends[1][0], abs=0.2)
    assert ends[1][1] - ends[0][0] == pytest.approx(706 - 72, abs=1)


def test_the_part_in_which_it_acts_is_shaded_to_halfway():
    drawn = strip_chart(regime(LATE))
    assert drawn is not None
    (shade,) = elements(drawn, "polygon")
    left, right = points(shade)[:, 0].min(), points(shade)[:, 0].max()
    # Of 0 to 180 s with 3 % to either side: from halfway between 60 and 120 s to the end.
    assert (left - 72) / (706 - 72) == pytest.approx((90 + 5.4) / 190.8, abs=0.002)
    assert right == pytest.approx(706, abs=0.1)
    assert len(drawn.rows) == 1 + 4
    assert drawn.rows[3][2] == "yes"


def test_a_sector_lights_the_rays_that_lie_in_it():
    one = sectors()
    found = targets(strip_chart(one, ordinal=1, frames=results.with_frames().frames))
    assert [int(target["data-index"]) for target in found] == list(range(8))
    assert {target["data-chart"] for target in found} == {"regime 1"}
    frame = results.with_frames().frames[0]
    picks = picks_of([regime(LATE), one], frame, columns=results.COLUMNS)
    assert list(picks) == ["regime 1"]
    azimuth = results.grid().azimuth_rad[frame.column]
    assert np.abs(np.asarray(one.x)[picks["regime 1"]] - azimuth).max() <= np.pi / 8 + 1e-6
    # Both rims of the turn are shaded, and nothing between.
    drawn = strip_chart(one)
    assert drawn is not None
    assert len(elements(drawn, "polygon")) == 2


def test_where_frames_say_no_time_scenes_are_counted_and_no_moment_is_shown():
    one = replace(regime(Region(scenes=("a", "b")), "scene"), x=(0.0, 1.0, 2.0, 3.0), counted=True)
    drawn = strip_chart(one, frames=results.with_frames().frames)
    assert not targets(drawn)
    assert drawn is not None
    assert "number of the scene" in texts(drawn)


def test_moments_a_second_apart_are_no_numbers_of_scenes():
    one = replace(regime(Region(time_s=(1.5, None))), x=(0.0, 1.0, 2.0, 3.0))
    drawn = strip_chart(one, frames=results.with_frames().frames)
    assert len(targets(drawn)) == 2
    assert drawn is not None
    assert "time since the first frame, s" in texts(drawn)


def test_nothing_that_tells_a_size_is_no_chart():
    assert strip_chart(replace(regime(LATE), sizes=(float("nan"),) * 4)) is None
