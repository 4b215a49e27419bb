"""How reports write numbers."""

from __future__ import annotations

import math

Real = float | int
RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def number(value: Real | None) -> str:
    """Three significant digits with a true minus sign, and a power of ten where it is tiny or huge; a dash where there
    is no value."""
    if value is None or not math.isfinite(value):
        return "–"
    if value == 0 or 1e-4 <= abs(value) < 1e5:
        places = max(0, 2 - math.floor(math.log10(abs(value)))) if value else 0
        text = f"{value:.{places}f}"
    else:
        digits, power = f"{value:.2e}".split("e")
        text = f"{digits}·10{str(int(power)).translate(RAISED)}"
    return text.replace("-", "−")


def probability(p: Real) -> str:
    if not math.isfinite(p):
        return "–"
    return "< 0.0001" if p < 1e-4 else f"{p:.2g}"


def percent(value: Real) -> str:
    return f"{100 * value:.0f} %".replace("-", "−") if math.isfinite(value) else "–"
