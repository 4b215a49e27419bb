"""One drawing, for a page and as a file."""

import base64
import xml.etree.ElementTree as ElementTree

import cv2
import numpy as np

from jaxsim.report.canvas import BEFORE, Canvas, data_uri, save_figure

SVG = "{http://www.w3.org/2000/svg}"


def drawing() -> Canvas:
    canvas = Canvas(60, 40)
    canvas.line([(5, 5), (55, 5)], colour=BEFORE, width=2)
    canvas.area([(5, 10), (25, 10), (25, 30), (5, 30)], colour="#00ff00", opacity=0.5)
    canvas.dot(40, 20, colour="#0000ff", radius=6, hollow=True)
    canvas.text(30, 38, "θ < b", anchor="middle", size=9)
    return canvas


def test_svg_holds_the_same_strokes_and_escapes_its_words():
    svg = drawing().svg('what "it" shows')
    assert [svg.count(f"<{tag} ") for tag in ("polyline", "polygon", "circle", "text")] == [1, 1, 1, 1]
    assert "θ &lt; b" in svg
    assert 'role="img" aria-label="what &#34;it&#34; shows"' in svg


def test_in_a_page_colours_are_the_pages_and_in_a_file_their_own(tmp_path):
    assert 'stroke="var(--before)"' in drawing().svg("it")
    path = save_figure(tmp_path, "it", drawing(), words="what <it> shows")
    root = ElementTree.parse(path).getroot()
    assert root.find(f"{SVG}title").text == "what <it> shows"
    assert root.find(f"{SVG}polyline").get("stroke") == BEFORE
    assert root.find(f"{SVG}text").text == "θ < b"
    # On white: a viewer without a background of its own may be dark.
    assert root.find(f"{SVG}rect").get("fill") == "#ffffff"


def test_what_answers_to_a_click_says_what_it_stands_for():
    canvas = drawing()
    canvas.target("curve 0", 3, 'row "3"', x=1, y=2, width=3, height=4)
    svg = canvas.svg("it")
    assert 'role="group"' in svg
    assert 'data-chart="curve 0" data-index="3" aria-label="row &#34;3&#34;"' in svg


def test_a_picture_travels_inside_the_page():
    rgb = np.arange(48, dtype=np.uint8).reshape(4, 4, 3)
    head, code = data_uri(rgb).split(",")
    assert head == "data:image/png;base64"
    decoded = cv2.imdecode(np.frombuffer(base64.b64decode(code), np.uint8), cv2.IMREAD_COLOR)
    np.testing.assert_array_equal(decoded[..., ::-1], rgb)


def test_pixels_are_saved_as_they_are(tmp_path):
    path = save_figure(tmp_path, "it", np.zeros((2, 3, 3), np.uint8), words="it")
    assert cv2.imread(str(path)).shape == (2, 3, 3)
