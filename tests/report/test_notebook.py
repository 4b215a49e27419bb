"""What a notebook shows of results, frames and clouds."""

from __future__ import annotations

import json
from html import unescape

import numpy as np
import pytest

from jaxsim.frame import Cloud, PolarImage
from jaxsim.report.notebook import html_of
from jaxsim.report.words import verdict_sentence
from tests.report import results


def test_a_result_shows_its_sentence_and_its_report():
    result = results.with_frames()
    text = result._repr_html_()
    assert unescape(text).startswith(f"<p>{verdict_sentence(result.verdict)}</p>")
    # The page is an attribute of a frame: nothing of it reaches the notebook's own.
    assert "<script" not in text
    assert '<script type="application/json" id="scenes">' in unescape(text)


def test_a_cloud_turns_and_of_a_batch_the_first_is_shown():
    xyz = np.random.default_rng(0).normal(0, 9, (2, 40, 3)).astype(np.float32)
    valid = np.ones((2, 40), bool)
    valid[0, 30:] = False
    cloud = Cloud(xyz, np.full((2, 40), 0.3, np.float32), valid)
    page = unescape(cloud._repr_html_())
    assert "30 points; the first of a batch of (2,)" in page
    scenes = json.loads(page.split('id="scenes">')[1].split("</script>")[0])
    assert len(scenes["scenes"]) == 1
    nothing = Cloud(xyz[0], np.zeros(40, np.float32), np.zeros(40, bool))
    assert nothing._repr_html_() == "<p>0 points</p>"


def test_a_frame_is_two_pictures():
    shape = (16, 90)
    image = PolarImage(np.full(shape, 9.0, np.float32), np.full(shape, 0.4, np.float32), np.eye(*shape) > 0)
    text = image._repr_html_()
    assert "16 rows x 90 columns, 16 returns" in text
    assert text.count("data:image/png;base64,") == 1


def test_what_it_does_not_know_is_refused():
    with pytest.raises(TypeError, match="int cannot be shown"):
        html_of(3)
