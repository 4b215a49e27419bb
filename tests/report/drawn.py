"""What a drawing holds, read from its SVG."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree

import numpy as np

from jaxsim.report.canvas import Canvas

SVG = "{http://www.w3.org/2000/svg}"


def elements(canvas: Canvas, tag: str) -> list[ElementTree.Element]:
    return ElementTree.fromstring(canvas.file("it")).findall(f"{SVG}{tag}")


def texts(canvas: Canvas) -> list[str]:
    return [one.text or "" for one in elements(canvas, "text")]


def points(line: ElementTree.Element) -> np.ndarray:
    """(n, 2) of a polyline."""
    return np.array([place.split(",") for place in line.get("points", "").split()], float)
