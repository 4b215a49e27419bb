"""The parts of a page."""

import pytest
from markupsafe import Markup

from jaxsim.report.page import (
    EMPTY,
    bar_cell,
    file_name,
    join_parts,
    number,
    paragraph,
    percent,
    probability,
    table,
    whole_page,
)


def test_words_are_escaped_and_markup_is_not():
    assert paragraph("a < b") == "<p>a &lt; b</p>"
    html = table(["<name>", "value"], [[Markup("<b>x</b>"), "1"], ["<b>y</b>", "2"]], text=1)
    assert "&lt;name&gt;" in html
    assert '<td class="t"><b>x</b></td><td>1</td>' in html
    assert '<td class="t">&lt;b&gt;y&lt;/b&gt;</td>' in html
    assert join_parts([Markup("<i>"), "<i>"]) == "<i><p>&lt;i&gt;</p>"


def test_a_row_of_another_length_is_refused():
    with pytest.raises(ValueError, match="a row of 1 cells under 2 heads"):
        table(["name", "value"], [["x"]], text=1)


def test_a_page_loads_nothing_from_elsewhere():
    page = whole_page(title="t", sentence="s", facts=[("frames", "3")], sections=[paragraph("one"), EMPTY])
    assert "http" not in page
    assert "<dt>frames</dt><dd>3</dd>" in page


def test_bars_end_inside_their_cell():
    assert 'width="240.0"' in bar_cell(7.0, 0.5, strong=True)
    assert 'width="0.0"' in bar_cell(float("nan"), 0.5, strong=False)


def test_names_suit_every_file_system():
    assert file_name("curve", "a b/c") == "curve_a-b-c"


def test_numbers_are_short_and_honest():
    assert number(0.0) == "0"
    assert number(-0.0) == "0"
    assert number(-0.12345) == "−0.123"
    assert number(211.4) == "211"
    assert number(float("nan")) == "–"
    assert number(3e-6) == "3.00·10⁻⁶"
    assert probability(1e-5) == "< 0.0001"
    assert percent(0.934) == "93 %"
    assert percent(-0.07) == "−7 %"
    assert percent(-0.001) == "0 %"
    assert percent(float("nan")) == "–"
