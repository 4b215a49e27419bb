"""What chance gives on a report's data."""

from dataclasses import replace
from pathlib import Path

import cv2

from jaxsim.discover.verdict import Nulls
from jaxsim.report.words import number
from tests.report import results
from tests.report.results import page


def test_what_chance_gives_is_drawn_where_nulls_were_asked_for(tmp_path: Path):
    assert "What chance gives" not in page(tmp_path, results.named())
    result = results.named()
    nulls = Nulls(("oren_nayar", "", "saturation"), (1.4, 0.0, 0.3), (0.0, 0.0, 0.9), 1, 1.4, 0.9)
    text = page(tmp_path, replace(result, verdict=replace(result.verdict, nulls=nulls)))
    assert "3 measurements in which nothing is missing" in text
    assert "On 1 of them something would have been said" in text
    assert f"({number(1.4)} nats a scene)" in text
    assert cv2.imread(str(tmp_path / "figures" / "chance.png")).std() > 5
    page(tmp_path, result)
    assert not (tmp_path / "figures" / "chance.png").exists()
