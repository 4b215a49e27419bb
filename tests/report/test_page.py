"""The parts of a page."""

from jaxsim.report.page import bar_cell, file_name, paragraph, table, whole_page


def test_words_are_escaped_and_cells_are_not():
    assert paragraph("a < b") == "<p>a &lt; b</p>"
    html = table(["<name>", "value"], [["<b>x</b>", "1"]], text=1)
    assert "&lt;name&gt;" in html
    assert '<td class="t"><b>x</b></td><td>1</td>' in html


def test_a_page_loads_nothing_from_elsewhere():
    page = whole_page(title="t", sentence="s", facts=[("frames", "3")], sections=["<p>one</p>", ""])
    assert "http" not in page
    assert "<dt>frames</dt><dd>3</dd>" in page


def test_bars_end_inside_their_cell():
    assert 'width="240.0"' in bar_cell(7.0, 0.5, strong=True)
    assert 'width="0.0"' in bar_cell(float("nan"), 0.5, strong=False)


def test_names_suit_every_file_system():
    assert file_name("curve", "a b/c") == "curve_a-b-c"
