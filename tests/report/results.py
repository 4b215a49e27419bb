"""Answers of discover made by hand, for the tests of what draws and prints them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from jaxsim.discover.verdict import (
    Contrast,
    CurveLine,
    Gap,
    Interval,
    JudgeFrame,
    Named,
    Rank,
    Repeat,
    Result,
    Unexplained,
    Verdict,
    Where,
)
from jaxsim.discover.verdict.parts import Gained
from jaxsim.effects.chain import SensorModel
from jaxsim.effects.learned import Learned
from jaxsim.frame import PolarGrid
from jaxsim.report.discovery import write_report

ROWS, COLUMNS = 16, 96
GAIN = tuple(np.round(0.2 * np.sin(1.7 * np.arange(ROWS)), 3).tolist())


def page(folder: Path, result: Result) -> str:
    """The report of an answer."""
    return write_report(folder, result).read_text(encoding="utf-8")


def grid() -> PolarGrid:
    azimuth = np.linspace(np.pi, -np.pi, COLUMNS, endpoint=False) - np.pi / COLUMNS
    return PolarGrid(azimuth, np.linspace(0.04, -0.4, ROWS), np.zeros(ROWS))


def maps(intensity: np.ndarray) -> dict[str, np.ndarray]:
    """Residuals of each channel; nothing was compared in the top row."""
    noise = np.random.default_rng(0).normal(size=(3, ROWS, COLUMNS)) * np.array([0.05, 0.02, 0.03])[:, None, None]
    noise[0] += intensity
    noise[:, 0] = np.nan
    return dict(zip(("intensity", "range", "drop"), noise, strict=True))


def named() -> Result:
    """One gain a beam, with a look-alike, and an effect of one number."""
    gain = Named(
        name="beam_gain",
        look_alikes=("focal_compensation",),
        tell_apart={"focal_compensation": "follow one beam over range"},
        channels=("intensity",),
        p_value=0.0039,
        gain=Interval(211.4, 160.0, 270.0, "nats per scene"),
        parameters={"gain": tuple(Interval(g, g - 0.03, g + 0.03, "nats") for g in GAIN)},
    )
    scale = Named(
        name="range_scale",
        look_alikes=(),
        tell_apart={},
        channels=("range",),
        p_value=0.0078,
        gain=Interval(31.0, 12.0, 44.0, "nats per scene"),
        parameters={"scale": Interval(0.0021, 0.0018, 0.0024, "1")},
        does={"range": Interval(0.021, 0.008, 0.05, "m")},
    )
    x = np.arange(ROWS, dtype=float)
    bright, far = Gained(180, 150, 210, 193, 41.5, 1), Gained(24, 11, 37, 30, 0, 0.83)
    lost = Gained(0.1, -2, 2, 0, 0, 0.5)
    verdict = Verdict(
        verdict="named",
        effects=(gain, scale),
        where=(Where("intensity", "row", 0.0002, 0.41), Where("range", "range", 0.004, 0.07)),
        unexplained=None,
        gap={
            "intensity": Gap(0.21, 0.09, 0.11, 0.13, "mean absolute error of ln I", 0.08, 0.17, 1.0, bright),
            "range": Gap(0.052, 0.041, 0.008, 0.014, "mean absolute error, m", 0.04, 0.052, 0.83, far),
            "drop": Gap(0.12, 0.12, -0.001, 0.001, "log loss of return, nats a ray", 0.11, 0.12, 0.5, lost),
        },
        closure=Interval(0.93, 0.88, 0.97, "share of what free curves gain"),
        find=("drive 1", "drive 2", "drive <b>3</b> & Co", "drive 4"),
        judge=("drive 5", "drive 6"),
        sha256="ab" * 32,
        frames=16,
        seconds=41.2,
        moved={"intensity": (-1.5, -2.3), "drop": (-4.0, -4.1), "range_": (-3.2, -3.9)},
        ranking=(
            Rank("beam_gain", 211.4, 0.0039, 1.0, ""),
            Rank("focal_compensation", 198.0, 0.0039, 1.0, "these data cannot tell it from the one that is named"),
            Rank("range_falloff", 40.2, 0.03, 1.0, "it explains clearly less than the one that is named"),
            Rank("oren_nayar", -0.4, 0.6, 1.0, "its gain is within what a null reaches"),
        ),
        notes=("4 scenes to find with are few",),
    )
    curve = CurveLine(
        *("intensity", "row", "ln I, measured minus simulated"),
        *(x, np.array(GAIN), np.zeros(ROWS), np.full(ROWS, 0.04)),
        edges=np.append(x, np.inf),
    )
    sensor = SensorModel((("beam_gain", {"gain": GAIN}), ("range_scale", {"scale": 0.0021})))
    return Result(verdict, sensor, grid(), maps(np.array(GAIN)[:, None]), maps(np.zeros((ROWS, 1))), (curve,))


def with_frames() -> Result:
    """The same, with two frames of which every ray is known: off by its beam's gain before, by nothing after."""
    result = named()
    row, column = (index.ravel() for index in np.indices((ROWS, COLUMNS)))
    zero = np.zeros(len(row))
    before = {"intensity": np.array(GAIN)[row], "range": zero + 0.01, "drop": zero + np.nan}
    after = {"intensity": zero, "range": zero, "drop": zero + np.nan}

    def frame(name: str, range_m: float, time_s: float) -> JudgeFrame:
        ranges = range_m + 4 * np.sin(column / 9)
        return JudgeFrame(name, "drive 5", row, column, ranges, zero == 0, before, after, (row,), time_s)

    return replace(result, frames=(frame("0005", 12.0, 40.0), frame("0007", 20.0, 130.0)))


def none() -> Result:
    """Nothing is missing."""
    result = named()
    gap = {name: replace(g, after=g.before, placebo=g.before, win_rate=0.0) for name, g in result.verdict.gap.items()}
    verdict = replace(
        result.verdict, verdict="none", effects=(), where=(), gap=gap, closure=None, ranking=result.verdict.ranking[3:]
    )
    flat = maps(np.zeros((ROWS, 1)))
    return replace(result, verdict=verdict, effects_model=SensorModel(), maps_before=flat, maps_after=flat, curves=())


def contrast() -> Contrast:
    """A simulator that blurs, and makes up most of what differs within a class."""
    slopes = {"cells": (1.38, 1.3, 1.46), "patches": (1.0, 0.9, 1.1), "road": (0.1, 0.05, 0.14)}
    slopes |= {"building": (0.2, 0.15, 0.25), "other_classes": (0.6, 0.3, 0.9)}
    told = {scale: Interval(*ends, unit="") for scale, ends in slopes.items()}
    return Contrast(told, Interval(40.0, 30.0, 50.0, "nats per scene"), 0.01)


def not_in_catalogue() -> Result:
    """A wave along the logarithm of range."""
    x = np.linspace(0.5, 4.3, 19)
    wave = Unexplained(
        "intensity",
        "range",
        "periodic",
        "Δ ln I ≈ 0.01 + 0.2·sin(6·x +0.4)",
        tuple(x.tolist()),
        tuple((0.2 * np.sin(6 * x + 0.4)).tolist()),
        (0.03,) * len(x),
    )
    result = none()
    return replace(result, verdict=replace(result.verdict, verdict="not_in_catalogue", unexplained=wave))


def repeating() -> Result:
    """A gain that ripples over the columns, and nothing else."""
    formula = "Δ ln I ≈ 0.2·cos(2π·(16·column/384) +1)"
    size = Interval(0.2, 0.19, 0.21, "nats")
    ripple = Repeat(
        "intensity", "wave", "column", "periods: 16 over the columns", 24.0, formula, size, p_value=0.001, p_judge=0.03
    )
    law = Learned("intensity", "wave", ("column",), ((16 / 384,),), (0.11, -0.17), (0.004, 0.004))
    left = Unexplained("intensity", "column", "periodic", formula)
    more = {"verdict": "not_in_catalogue", "unexplained": left, "repeats": (ripple,), "learned": (law,)}
    result = none()
    return replace(result, verdict=replace(result.verdict, **more))
