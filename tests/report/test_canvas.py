"""One drawing, as SVG and as pixels."""

import base64

import cv2
import numpy as np

from jaxsim.report.canvas import Canvas, data_uri


def drawing() -> Canvas:
    canvas = Canvas(60, 40)
    canvas.line([(5, 5), (55, 5)], colour="#ff0000", width=2)
    canvas.area([(5, 10), (25, 10), (25, 30), (5, 30)], colour="#00ff00", opacity=0.5)
    canvas.dot(40, 20, colour="#0000ff", radius=6)
    canvas.text(30, 38, "a < b", anchor="middle", size=9)
    return canvas


def test_pixels_show_each_stroke_where_it_was_drawn():
    image = drawing().pixels(scale=2)
    assert image.shape == (80, 120, 3)
    assert image[10, 60].tolist() == [255, 0, 0]
    assert np.abs(image[40, 30].astype(int) - [128, 255, 128]).max() <= 1
    assert image[40, 80].tolist() == [0, 0, 255]
    assert image[2, 2].tolist() == [255, 255, 255]


def test_svg_holds_the_same_strokes_and_escapes_its_words():
    svg = drawing().svg('what "it" shows')
    assert [svg.count(f"<{tag} ") for tag in ("polyline", "polygon", "circle", "text")] == [1, 1, 1, 1]
    assert "a &lt; b" in svg
    assert "what &quot;it&quot; shows" in svg


def test_a_picture_travels_inside_the_page():
    rgb = np.arange(48, dtype=np.uint8).reshape(4, 4, 3)
    head, code = data_uri(rgb).split(",")
    assert head == "data:image/png;base64"
    decoded = cv2.imdecode(np.frombuffer(base64.b64decode(code), np.uint8), cv2.IMREAD_COLOR)
    np.testing.assert_array_equal(decoded[..., ::-1], rgb)
