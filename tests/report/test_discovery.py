"""The page of a discovery, and what chance gives on its data."""

import re
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from html import unescape
from pathlib import Path

import pytest

from jaxsim.discover.verdict import NullDraws
from jaxsim.report.page import number
from jaxsim.report.words import verdict_sentence
from tests.report import results
from tests.report.results import page


@pytest.mark.parametrize("make", [results.named, results.none, results.not_in_catalogue, results.repeating])
def test_the_page_says_the_answer_and_loads_nothing_from_elsewhere(tmp_path: Path, make):
    result = make()
    text = page(tmp_path, result)
    assert verdict_sentence(result.verdict) in unescape(text)
    assert "http" not in text
    assert "<script" not in text
    assert "<link" not in text
    assert text.count("href=") == text.count('href="data:image/png;base64,') + text.count('href="#')
    assert "nan" not in text.replace("nanometre", "")


def test_every_chart_of_the_page_is_a_figure_too(tmp_path: Path):
    text = page(tmp_path, results.named())
    figures = sorted(path.stem for path in (tmp_path / "figures").glob("*.svg"))
    assert figures == ["curve_intensity_row", "map_drop", "map_intensity", "map_range", "parameter_beam_gain_gain"]
    assert text.count("<figure") == len(figures)
    for path in (tmp_path / "figures").iterdir():
        assert len(ElementTree.parse(path).getroot()) > 10
    # What an effect's links lead to is there.
    assert set(re.findall(r'href="#([^"]+)"', text)) <= set(re.findall(r' id="([^"]+)"', text))


def test_figures_of_an_earlier_answer_do_not_stay_and_other_files_do(tmp_path: Path):
    page(tmp_path, results.named())
    (tmp_path / "figures" / "mine.png").write_bytes(b"mine")
    (tmp_path / "figures" / "map_range.png").write_bytes(b"of an earlier version")
    page(tmp_path, results.not_in_catalogue())
    names = {path.name for path in (tmp_path / "figures").iterdir()}
    assert not {"curve_intensity_row.svg", "map_range.png"} & names
    assert {"mine.png", "unexplained_intensity_range.svg"} <= names


def test_names_are_escaped(tmp_path: Path):
    text = page(tmp_path, results.named())
    assert "drive &lt;b&gt;3&lt;/b&gt; &amp; Co" in text
    assert "<b>3</b>" not in text


def test_what_chance_gives_is_drawn_where_nulls_were_asked_for(tmp_path: Path):
    assert "What chance gives" not in page(tmp_path, results.named())
    result = results.named()
    nulls = NullDraws(("oren_nayar", "", "saturation"), (1.4, 0.0, 0.3), (0.0, 0.0, 0.9), 1, 1.4, 0.9)
    text = page(tmp_path, replace(result, verdict=replace(result.verdict, nulls=nulls)))
    assert "3 measurements in which nothing is missing" in text
    assert "On 1 of them something would have been said" in text
    assert f"({number(1.4)} nats a scene)" in text
    assert (tmp_path / "figures" / "chance.svg").read_text().count("<circle") == 7
    page(tmp_path, result)
    assert not (tmp_path / "figures" / "chance.svg").exists()
