"""The loop's page, from scores and clouds that were made up."""

import json

import numpy as np
import pytest

from jaxsim.report.scenes import cloud_with_boxes
from jaxsim.studies.real2sim2real.page import write_loop
from tests.studies.real2sim2real.made import COUNTS, clouds


def test_the_page_stands_alone_and_the_json_is_strict(scored):
    counts = {kind: clouds(value) for kind, value in COUNTS.items()}
    found = cloud_with_boxes(
        "trained on raw_64", np.zeros((5, 4), np.float32), detected=np.array([[10.0, 0, -1, 4, 2, 1.5, 0.3]])
    )
    page = write_loop(scored, counts, {"found": np.zeros((8, 8, 3), np.uint8)}, clouds=[found])
    html = page.read_text()
    assert "http" not in html.replace("http://www.w3.org", "")
    assert html.count("data:image/png") == 2  # found, drops
    assert html.count("<svg") == 4  # intensity, epochs, a class and elsewhere
    assert "<b>nan" not in html.lower()

    def refuse(name):
        raise AssertionError(name)

    plain = json.loads((scored.out / "real2sim2real.json").read_text(), parse_constant=refuse)
    moderate = next(r for r in plain["on_real"] if (r["clouds"], r["difficulty"]) == ("simulated_64", "moderate"))
    assert moderate["3D@0.7"]["paper"] == 51.74
    assert moderate["3D@0.7"]["value"] == pytest.approx(56)
    assert plain["clouds"]["raw_64"]["intensity"] == pytest.approx(0.4, abs=0.01)
    # What the detectors find turns in the page.
    shown = json.loads(html.split('id="scenes">')[1].split("</script>")[0])["scenes"]
    assert [(one["name"], len(one["boxes"])) for one in shown] == [("trained on raw_64", 1)]
    drawn = {p.stem for p in (scored.out / "pictures").iterdir()}
    assert drawn == {"found", "drops", "intensity", "on_car", "elsewhere", "epochs"}
