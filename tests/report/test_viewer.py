"""The viewer of a report, in a real browser."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from jaxsim.discover.verdict import Interval, Level
from jaxsim.effects.region import Region
from jaxsim.report.page import explorer, own_text, whole_page
from jaxsim.report.scenes import (
    MOST_BYTES,
    Channel,
    Side,
    TurnedScene,
    cloud_with_boxes,
    compared_clouds,
    packed,
    write_clouds,
)
from tests.report import results
from tests.report.chromium import browser, coloured, opened, picture
from tests.report.made_regimes import regime, sectors

POINTS = 100_000


@pytest.fixture(scope="module")
def chromium() -> Iterator[Any]:
    with browser() as opened_browser:
        yield opened_browser


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("report")
    results.page(folder, results.with_frames())
    return folder / "report.html"


def test_a_page_opens_without_a_network_and_draws_both_sides(chromium, report):
    with opened(chromium, report) as tab:
        assert tab.locator("#lost").is_hidden()
        assert coloured(picture(tab, "#cloud")).sum() > 200
        assert tab.locator("#left").inner_text() == "before"
        assert tab.locator("#scene option").count() == 2


def test_the_slider_moves_from_before_to_after(chromium, report):
    """Before, beams are off by their gain; after, by nothing."""
    with opened(chromium, report) as tab:
        colours = {}
        for place in (0, 100):
            tab.locator("#wipe").fill(str(place))
            colours[place] = [coloured(picture(tab, name)).sum() for name in ("#cloud", "#map")]
        assert colours[100][0] > 5 * colours[0][0]
        assert colours[100][1] > colours[0][1]
        # At an end there is one side alone, and one name.
        assert tab.locator("#left").is_visible()
        assert tab.locator("#right").is_hidden()


def test_what_is_lit_while_the_slider_still_settles_stays_lit(chromium, report):
    with opened(chromium, report) as tab:
        tab.locator("#curve_intensity_row .target").nth(3).click()
        lit = picture(tab, "#cloud")
        tab.keyboard.press("Escape")
        tab.evaluate("""async () => {
            document.getElementById("wipe").dispatchEvent(new Event("input"));
            await new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)));
            document.querySelectorAll("#curve_intensity_row .target")[3].dispatchEvent(new Event("click"));
        }""")
        tab.wait_for_timeout(500)
        np.testing.assert_array_equal(picture(tab, "#cloud"), lit)


def test_a_click_on_a_curve_lights_its_rays_in_cloud_and_map(chromium, report):
    with opened(chromium, report) as tab:
        everything = tab.evaluate("jaxsimViewer.lit()")
        before = {name: picture(tab, name) for name in ("#cloud", "#map")}
        tab.locator("#curve_intensity_row .target").nth(3).click()
        assert tab.evaluate("jaxsimViewer.lit()") == everything // results.ROWS
        assert f"{everything // results.ROWS} of {everything} rays" in tab.locator("#told").inner_text()
        # The curve stands far from the cloud, and leads there.
        there = tab.locator("#there")
        there.wait_for()
        assert there.inner_text() == f"{tab.locator('#told').inner_text()} Show."
        there.click()
        there.wait_for(state="hidden")
        for name, picture_before in before.items():
            assert (np.abs(picture(tab, name) - picture_before).max(-1) > 30).mean() > 0.01
        # The same beam is marked on the chart of its parameter by a click there, and Escape lights all again.
        tab.locator("#parameter_beam_gain_gain .target").nth(3).click()
        assert tab.evaluate("jaxsimViewer.state.pick.chart") == "row"
        tab.keyboard.press("Escape")
        assert tab.evaluate("jaxsimViewer.lit()") == everything


def test_it_works_by_keys_alone(chromium, report):
    with opened(chromium, report) as tab:
        first = tab.locator("#curve_intensity_row .target").first
        first.focus()
        tab.keyboard.press("ArrowRight")
        tab.keyboard.press("Enter")
        assert tab.evaluate("jaxsimViewer.state.pick.index") == 1
        tab.keyboard.press("Escape")
        before = picture(tab, "#cloud")
        tab.locator("#cloud").focus()
        for key in ("ArrowLeft", "ArrowUp", "+", "Shift+ArrowRight"):
            tab.keyboard.press(key)
        assert (picture(tab, "#cloud") != before).mean() > 0.01
        tab.keyboard.press("0")
        tab.wait_for_function("jaxsimViewer.rests()")
        np.testing.assert_array_equal(picture(tab, "#cloud"), before)


def test_the_mouse_turns_and_the_wheel_zooms(chromium, report):
    with opened(chromium, report) as tab:
        tab.locator("#cloud").scroll_into_view_if_needed()
        box = tab.locator("#cloud").bounding_box()
        views = [picture(tab, "#cloud")]
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        tab.mouse.move(x, y)
        tab.mouse.down()
        tab.mouse.move(x + 80, y + 20)
        tab.mouse.up()
        views.append(picture(tab, "#cloud"))
        tab.mouse.wheel(0, -300)
        views.append(picture(tab, "#cloud"))
        assert all((np.abs(a - b).max(-1) > 30).mean() > 0.005 for a, b in pairwise(views))


def test_one_finger_turns_and_two_move_and_zoom(chromium, report):
    with opened(chromium, report) as tab:
        tab.locator("#cloud").scroll_into_view_if_needed()
        box = tab.locator("#cloud").bounding_box()
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        screen = tab.context.new_cdp_session(tab)

        def touch(*moments: list[tuple[float, float]]) -> np.ndarray:
            """What the cloud shows after fingers were put down, moved from place to place, and lifted."""
            for k, places in enumerate(moments):
                points = [{"x": a, "y": b, "id": finger} for finger, (a, b) in enumerate(places)]
                screen.send(
                    "Input.dispatchTouchEvent", {"type": "touchMove" if k else "touchStart", "touchPoints": points}
                )
            screen.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
            tab.wait_for_function("jaxsimViewer.rests()")
            return picture(tab, "#cloud")

        views = [picture(tab, "#cloud"), touch([(x, y)], [(x + 40, y)], [(x + 80, y + 20)])]
        # Farther apart, and then both to one side.
        views.append(touch([(x - 20, y), (x + 20, y)], [(x - 60, y), (x + 60, y)]))
        views.append(touch([(x - 20, y), (x + 20, y)], [(x + 60, y + 40), (x + 100, y + 40)]))
        assert all((np.abs(a - b).max(-1) > 30).mean() > 0.005 for a, b in pairwise(views))
        # A finger that was lifted is forgotten: one alone turns again, it neither moves nor zooms.
        turned = touch([(x, y)], [(x + 80, y)])
        assert (np.abs(turned - views[-1]).max(-1) > 30).mean() > 0.005


def test_a_click_on_the_map_lights_a_cell_and_another_scene_has_other_rays(chromium, report):
    with opened(chromium, report) as tab:
        everything = tab.evaluate("jaxsimViewer.lit()")
        tab.locator("#map").click(position={"x": 200, "y": 70})
        assert 0 < tab.evaluate("jaxsimViewer.lit()") < everything / 100
        tab.locator("#clear").click()
        before = picture(tab, "#cloud")
        tab.locator("#scene").select_option(index=1)
        tab.locator("#channel").select_option("range")
        assert (picture(tab, "#cloud") != before).any()


def test_words_and_moments_show_what_they_speak_of(chromium, tmp_path):
    """A level its channel, an effect its channel and figures, a row of the frames' table and a moment their scene."""
    result = results.with_frames()
    noise = Level("range_noise", *(Interval(0.02, 0.01, 0.03, "m") for _ in range(3)), beyond_usual=False)
    acts = (regime(Region(time_s=(90.0, None))), sectors())
    results.page(tmp_path, replace(result, verdict=replace(result.verdict, levels=(noise,), regimes=acts)))
    with opened(chromium, tmp_path / "report.html") as tab:
        everything = tab.evaluate("jaxsimViewer.lit()")
        level = tab.get_by_role("button", name="range noise")
        level.press("Enter")
        assert tab.locator("#channel").input_value() == "range"
        assert level.get_attribute("aria-pressed") == "true"
        assert tab.locator("figure.shown").evaluate_all("all => all.map(one => one.id)") == ["map_range"]
        tab.locator("section", has_text="Changes intensity").locator(".shows", has_text="intensity").click()
        marked = tab.locator("figure.shown").evaluate_all("all => all.map(one => one.id)")
        assert {"curve_intensity_row", "map_intensity", "parameter_beam_gain_gain"} == {*marked}
        assert level.get_attribute("aria-pressed") == "false"
        before = picture(tab, "#cloud")
        tab.locator("#regime_beam_gain .target").nth(1).click()
        assert tab.locator("#scene").input_value() == "1"
        assert (picture(tab, "#cloud") != before).mean() > 0.01
        tab.get_by_role("button", name="drive 5, frame 0005", exact=True).click()
        assert tab.locator("#scene").input_value() == "0"
        tab.locator('.target[data-chart="regime 1"]').nth(2).click()
        assert tab.evaluate("jaxsimViewer.lit()") == everything // 8


def test_turning_draws_as_many_points_as_there_is_time_for_and_rest_draws_all(chromium, report):
    with opened(chromium, report) as tab:
        _, share = tab.evaluate("jaxsimViewer.turning(0.3)")
        # A few rays are always drawn whole.
        assert share == 1
        moved = picture(tab, "#cloud")
        tab.wait_for_function("jaxsimViewer.rests()")
        assert (np.abs(picture(tab, "#cloud") - moved).max(-1) > 30).mean() < 0.05


def test_without_webgl_the_map_still_works_and_the_page_says_why(chromium, report, tmp_path):
    page = report.read_text().replace('stage.getContext("webgl"', 'stage.getContext("none"')
    (tmp_path / "page.html").write_text(page)
    with opened(chromium, tmp_path / "page.html") as tab:
        assert "no WebGL" in tab.locator("#lost").inner_text()
        tab.locator("#wipe").fill("100")
        assert coloured(picture(tab, "#map")).any()
        tab.locator("#curve_intensity_row .target").nth(3).click()
        assert "row 3: " in tab.locator("#told").inner_text()


def test_without_scripts_figures_and_tables_stay(chromium, report):
    with opened(chromium, report, java_script_enabled=False) as tab:
        assert tab.locator("#explorer").is_hidden()
        assert "needs scripts" in tab.locator(".still").inner_text()
        assert tab.locator("#turn table").is_visible()
        assert coloured(picture(tab, "#map_intensity svg", scripts=False)).any()


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [400, 1400])
def test_nothing_is_wider_than_the_screen_and_ink_stands_out(chromium, report, scheme, width):
    with opened(chromium, report, viewport={"width": width, "height": 800}, color_scheme=scheme) as tab:
        assert tab.evaluate("document.documentElement.scrollWidth") <= width
        # Names of frames are as long as a recording's.
        tab.evaluate("document.querySelector('.bars option').text = 'OS-2-128-U1_v2.3.0_1024x10-'.repeat(4)")
        assert tab.evaluate("document.documentElement.scrollWidth") <= width
        light = picture(tab, "#curve_intensity_row svg").mean(-1)
        paper = np.median(light)
        assert (paper > 240) == (scheme == "light")
        assert (np.abs(light - paper) > 100).any()


def test_a_shadow_tells_that_a_chart_goes_on(chromium, report):
    """On a narrow screen, on the side where it does."""
    with opened(chromium, report, viewport={"width": 400, "height": 800}) as tab:
        chart = "#curve_intensity_row"
        edges = [[picture(tab, chart)[-60:-50, k].mean() for k in (1, -2)]]
        tab.locator(chart).evaluate("one => one.scrollTo(one.scrollWidth, 0)")
        edges.append([picture(tab, chart)[-60:-50, k].mean() for k in (1, -2)])
        (left, right), (left_at_end, right_at_end) = edges
        assert right < left - 20
        assert left_at_end < right_at_end - 20


def test_in_print_there_is_no_viewer(chromium, report):
    with opened(chromium, report) as tab:
        tab.emulate_media(media="print")
        assert tab.locator("#explorer").is_hidden()
        assert tab.locator("#map_intensity svg").is_visible()
        assert tab.locator(".still").is_visible()
        # Paper unfolds nothing.
        folded = tab.locator("details:not([open])")
        assert folded.count() > 1
        assert all(one.locator("table").is_visible() for one in folded.all())


def test_a_hundred_thousand_points_turn(chromium, tmp_path, record_property):
    rng = np.random.default_rng(0)
    xyz = rng.normal(0, 15, (POINTS, 3)) * [1, 1, 0.1]
    scene = TurnedScene("many", (Side("cloud", xyz, {"intensity": rng.uniform(size=POINTS)}),))
    scenes = packed([scene], [Channel("intensity", "intensity", 0, 1, "")])
    assert len(scenes) < MOST_BYTES
    text = whole_page(
        title="t", sentence="s", facts=[], sections=[explorer("many points", has_map=False)], scenes=scenes
    )
    (tmp_path / "page.html").write_text(text)
    with opened(chromium, tmp_path / "page.html") as tab:
        assert tab.evaluate("jaxsimViewer.lit()") == POINTS
        before = picture(tab, "#cloud")
        # Told, not judged: a machine that others use too draws as fast as they let it.
        record_property("frames_per_second", tab.evaluate("jaxsimViewer.speed(5)"))
        record_property("turning", tab.evaluate("jaxsimViewer.turning(0.5)"))
        assert (np.abs(picture(tab, "#cloud") - before).max(-1) > 30).mean() > 0.01


def test_simulated_stands_beside_measured_and_boxes_are_drawn(chromium, tmp_path):
    """The pages of simulate, detect and real2sim2real."""
    random = np.random.default_rng(0)
    simulated, measured = (random.uniform([4, -6, -2, low], [20, 6, 0, low + 0.1], (3000, 4)) for low in (0.0, 0.5))
    nothing = np.zeros((0, 7))
    scenes = [
        compared_clouds("street", simulated.astype("f4"), measured.astype("f4")),
        cloud_with_boxes("nothing", measured[:1].astype("f4"), detected=nothing, labelled=nothing),
        cloud_with_boxes("car", measured[:1].astype("f4"), detected=np.array([[10.0, 0, -1, 4, 2, 1.5, 0.3]])),
    ]
    page = write_clouds(tmp_path / "clouds.html", scenes, title="t", sentence="s", words="w")
    with opened(chromium, page) as tab:
        # Dim intensities are blue, bright ones red; the slider gives all the width to one of them.
        for wipe, blue in ((100, True), (0, False)):
            tab.locator("#wipe").fill(str(wipe))
            tab.wait_for_function("jaxsimViewer.rests()")
            rgb = picture(tab, "#cloud")
            colour = rgb[coloured(rgb)].mean(0)
            assert (colour[2] > colour[0]) == blue
        assert tab.locator("#clear").is_hidden()
        assert tab.locator("#told").inner_text() == "simulated 3000, measured 3000 points in street."
        tab.get_by_role("button", name="nothing").click()
        empty = picture(tab, "#cloud")
        assert tab.locator("#wipe").is_hidden()
        tab.get_by_role("button", name="car").press("Enter")
        assert 50 < coloured(picture(tab, "#cloud")).sum() - coloured(empty).sum() < 20_000


def test_a_thinned_cloud_says_so(chromium, report, tmp_path):
    (tmp_path / "page.html").write_text(report.read_text().replace('"every":1', '"every":3'))
    with opened(chromium, tmp_path / "page.html") as tab:
        assert tab.locator("#told").inner_text().endswith("one point in 3 is drawn.")


@pytest.mark.long
def test_names_from_data_cannot_become_code(chromium, tmp_path):
    bad = "</script><script>window.broken = 1</script><img src=x onerror='window.broken = 1'>"
    result = results.with_frames()
    frames = tuple(replace(frame, name=bad, scene=bad) for frame in result.frames)
    judge = replace(result.verdict, judge=(bad,), notes=(bad,))
    results.page(tmp_path, replace(result, frames=frames, verdict=judge))
    with opened(chromium, tmp_path / "report.html") as tab:
        assert tab.evaluate("window.broken === undefined")
        assert bad in tab.locator("#scene option").first.inner_text()


@pytest.mark.long
def test_the_scripts_name_nothing_of_elsewhere():
    assert "http" not in own_text("viewer.js") + own_text("cloud.js")
