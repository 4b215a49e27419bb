"""A real Chromium without a window, for tests of pages; tests that need it are skipped where there is none."""

from __future__ import annotations

import gc
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

PROGRAMS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
# No sandbox: containers run as root, and the pages are our own. SwiftShader draws WebGL without a GPU.
FLAGS = ["--no-sandbox", "--disable-dev-shm-usage", "--use-gl=angle", "--use-angle=swiftshader"]
FLAGS += ["--enable-unsafe-swiftshader"]


@contextmanager
def browser() -> Iterator[Any]:
    """The browser, by Playwright's driver and the system's program."""
    program = next(filter(None, map(shutil.which, PROGRAMS)), None)
    if program is None:
        pytest.skip("no Chromium: apt-get install chromium")
    api = pytest.importorskip("playwright.sync_api", reason="no Playwright: pip install '.[test]'")
    with api.sync_playwright() as driver:
        opened = driver.chromium.launch(executable_path=program, args=FLAGS)
        yield opened
        opened.close()
    # The driver's pipe outlives its event loop and complains of that when it is collected, in whatever test comes next.
    complain = sys.unraisablehook
    sys.unraisablehook = lambda what: None
    gc.collect()
    sys.unraisablehook = complain


@contextmanager
def opened(chromium: Any, path: Path, **how: Any) -> Iterator[Any]:
    """A file in a tab of its own, the network off; its console must stay silent."""
    context = chromium.new_context(**({"viewport": {"width": 1000, "height": 900}, "offline": True} | how))
    tab = context.new_page()
    tab.set_default_timeout(200_000)  # a click takes less than two seconds
    said: list[str] = []
    asked: list[str] = []
    tab.on("console", lambda message: said.append(message.text))
    tab.on("pageerror", lambda error: said.append(str(error)))
    tab.on("request", lambda request: asked.append(request.url))
    tab.goto(path.resolve().as_uri())
    yield tab
    context.close()
    assert not said
    assert [url for url in asked if not url.startswith(("file:", "data:"))] == []


def picture(tab: Any, selector: str, *, scripts: bool = True) -> np.ndarray:
    """What an element looks like, when all is drawn; without `scripts` there is no frame to wait for."""
    if scripts:
        tab.evaluate("() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
    shot = np.frombuffer(tab.locator(selector).screenshot(), np.uint8)
    return cv2.imdecode(shot, cv2.IMREAD_COLOR)[..., ::-1].astype(int)


def coloured(rgb: np.ndarray) -> np.ndarray:
    """Pixels that are neither dark nor grey."""
    return rgb.max(-1) - rgb.min(-1) > 60
