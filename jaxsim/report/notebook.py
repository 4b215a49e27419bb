"""How a notebook shows results, frames and clouds: their `_repr_html_` calls `html_of`."""

from __future__ import annotations

from functools import singledispatch
from typing import Any

import jax
import numpy as np
from markupsafe import Markup

from jaxsim.cloud import points_of
from jaxsim.discover.verdict import Result
from jaxsim.frame import Cloud, PolarImage
from jaxsim.report.discovery import report_page
from jaxsim.report.page import figure, paragraph, whole_page
from jaxsim.report.pictures import depth_panel, intensity_panel, strip
from jaxsim.report.scenes import TurnedScene, side_of, turning
from jaxsim.report.words import verdict_sentence

HEIGHT_REM = 44
"""Of a page inside a notebook."""


@singledispatch
def html_of(value: Any) -> str:
    """The HTML of a value in a notebook. Raises TypeError for what it does not know."""
    raise TypeError(f"notebook: a {type(value).__name__} cannot be shown; Result, PolarImage and Cloud can")


@html_of.register
def _(value: Result) -> str:
    """The sentence, and the report in a frame of its own."""
    page, _, _ = report_page(value)
    return paragraph(verdict_sentence(value.verdict)) + _framed(page)


@html_of.register
def _(value: Cloud) -> str:
    """The cloud, to be turned; of a batch the first."""
    first, words = _first(value, np.ndim(value.intensity) - 1)
    points = points_of(first)
    text = f"{len(points)} points{words}"
    if not len(points):
        return paragraph(text)
    how = "Coloured by intensity, by height or by distance."
    body, scenes = turning([TurnedScene("cloud", (side_of("cloud", points),))], how)
    return _framed(whole_page(title="cloud", sentence=text, facts=(), sections=[body], scenes=scenes))


@html_of.register
def _(value: PolarImage) -> str:
    """Intensity and range as pictures; of a batch the first."""
    first, words = _first(value, np.ndim(value.range_m) - 2)
    valid = np.asarray(first.valid, bool)
    panels = [
        ("intensity (0-0.6)", intensity_panel(np.asarray(first.intensity), valid)),
        ("range (0-60 m)", depth_panel(np.asarray(first.range_m), valid)),
    ]
    rows, columns = valid.shape
    text = f"{rows} rows x {columns} columns, {valid.sum()} returns{words}"
    return figure(strip(panels, width=max(columns, 744)), text)


def _first(value: Any, batch_dims: int) -> tuple[Any, str]:
    """The first of a batch, and words that say so."""
    if batch_dims == 0:
        return value, ""
    shape = np.shape(jax.tree.leaves(value)[0])[:batch_dims]
    return jax.tree.map(lambda leaf: np.asarray(leaf)[(0,) * batch_dims], value), f"; the first of a batch of {shape}"


def _framed(page: str) -> Markup:
    """A page in a frame, so that its style and its script are not the notebook's."""
    frame = '<iframe srcdoc="{}" style="width:100%;height:{}rem;border:0" sandbox="allow-scripts"></iframe>'
    return Markup(frame).format(page, HEIGHT_REM)
