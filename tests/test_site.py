"""The site: built without a warning, read from disk in a real browser."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.pages import ROOT
from tests.programs import PATIENCE_S
from tests.report.chromium import browser, opened


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    for needed in ("sphinx", "myst_parser", "furo", "jupytext", "sphinx_copybutton"):
        pytest.importorskip(needed, reason="no Sphinx: pip install '.[docs]'")
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", str(ROOT / "docs"), str(folder)]
    result = subprocess.run(command, text=True, capture_output=True, timeout=PATIENCE_S)
    assert result.returncode == 0, result.stderr
    return folder


@pytest.mark.slow
def test_pages_fit_and_search_works_from_disk(site):
    """`opened` forbids requests elsewhere and words on the console."""
    with browser() as chromium:
        for page in ("index", "start", "effects", "site/api", "site/discover_a_hidden_effect"):
            for width in (400, 1400):
                with opened(chromium, site / f"{page}.html", viewport={"width": width, "height": 900}) as tab:
                    assert tab.evaluate("document.documentElement.scrollWidth") <= width
        with opened(chromium, site / "index.html", viewport={"width": 1400, "height": 900}) as tab:
            tab.locator("input[name=q]").first.fill("beam_gain")
            tab.keyboard.press("Enter")
            tab.get_by_role("link", name="Catalogue of effects > beam_gain").click()
            assert tab.url.endswith("effects.html#beam-gain")
