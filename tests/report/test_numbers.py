"""How reports write numbers."""

from jaxsim.report.numbers import number, percent, probability


def test_numbers_are_short_and_honest():
    assert number(0.0) == "0"
    assert number(-0.12345) == "−0.123"
    assert number(211.4) == "211"
    assert number(float("nan")) == "–"
    assert number(3e-6) == "3.00·10⁻⁶"
    assert probability(1e-5) == "< 0.0001"
    assert percent(0.934) == "93 %"
    assert percent(-0.07) == "−7 %"
    assert percent(float("nan")) == "–"
