"""Make a case: streets, what a sensor says of them, what a simulator says of them, and the truth beside."""

from __future__ import annotations

import json
import time
import zlib
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.blind.mitsuba import sensors
from benchmarks.blind.mitsuba.effects import EFFECTS, Plan
from benchmarks.blind.mitsuba.measure import hide, measure
from benchmarks.blind.mitsuba.render import View, look
from benchmarks.blind.mitsuba.streets import make_street

MEASURED = {"range": np.float32, "intensity": np.float32}
GIVEN = ("all", "bare")


@dataclass(frozen=True)
class Truth:
    """What a case hides, written beside its folder; `benchmarks.blind.hidden score` reads it too.

    level: the simulator; effects: [{name, channels, covariates, parameters in the catalogue's terms where the law has
    them, amount, severity, right: names of which any is no mistake}], empty for a null; outside: always None;
    nuisance: what the sensor has of its own; made_at: seconds since 1970.
    """

    world: str
    case: str
    seed: int
    severity: float
    level: str
    sensor: str
    given: str
    effects: list[dict[str, Any]]
    outside: None
    nuisance: dict[str, float]
    made_at: float


def make_case(
    seed: int,
    *,
    effect: str = "none",
    severity: float = 2.0,
    simulator: str = "ideal",
    sensor: str = "turn",
    given: str = "all",
    out: Path | str,
    scenes: int = 16,
    rows: int = 48,
    columns: int = 384,
) -> Truth:
    """Writes OUT/measured, OUT/simulated (polar frames) and OUT.key.json; streets follow from the seed alone.

    Args:
        effect: none, or a name of `EFFECTS`; severity: multiple of its unit.
        simulator: ideal or noisy; sensor: a name of `sensors.SENSORS`.
        given: all (classes, objects, incidence, colours, speed, heading, time) or bare (range and intensity).

    Raises:
        ValueError: a name is not known, or a number is not positive. FileExistsError: OUT or its key is there.
    """
    out = Path(out)
    _check(effect, simulator, sensor, given, {"severity": severity, "scenes": scenes, "rows": rows, "columns": columns})
    for there in (out / "measured", out / "simulated", key_path(out)):
        if there.exists():
            raise FileExistsError(f"{there} is there already; give another folder, a case is never overwritten")
    optics = sensors.SENSORS[sensor]
    azimuth, elevation = sensors.make_grid(optics, rows, columns)
    chance = sensors.draw_chance(stream(seed, "chance"))
    amount = severity * EFFECTS[effect].unit if effect != "none" else 0.0
    lobe = 4 * amount if effect == "specular_lobe" else 1.0
    views = [
        look(make_street(stream(seed, "street", k), lobe), azimuth, elevation, stream(seed, "yaw", k).normal(0, 0.06))
        for k in range(scenes)
    ]
    plan, light = hide(effect, amount, views, stream(seed, "effect"), rows, optics.half_turn_rad)
    frames = _drives(scenes, stream(seed, "drives"), told=given == "all")
    for part in ("measured", "simulated"):
        (out / part).mkdir(parents=True)
        (out / part / "grid.json").write_text(
            json.dumps({"azimuth": azimuth.tolist(), "elevation": elevation.tolist(), "frames": frames})
        )
    for k, (name, view) in enumerate(zip(frames, views, strict=True)):
        seen, known = light(view)
        reading = measure(view, seen, azimuth, plan, chance, optics, stream(seed, "noise", k))
        told = sensors.simulate(simulator, optics, view.range_m, sensors.WHITE * known, stream(seed, "simulator", k))
        if given == "all":
            told |= _rasters(view, told["range"] > 0, stream(seed, "colours", k))
        np.savez(out / "measured" / f"{name}.npz", **{key: reading[key].astype(t) for key, t in MEASURED.items()})
        np.savez(
            out / "simulated" / f"{name}.npz", **{key: x.astype(MEASURED.get(key, x.dtype)) for key, x in told.items()}
        )
    truth = Truth(
        world="mitsuba",
        case=f"{effect} {severity:g} {simulator} {sensor} {given} {seed}",
        seed=seed,
        severity=severity,
        level=simulator,
        sensor=sensor,
        given=given,
        effects=[_entry(effect, severity, plan)] if effect != "none" else [],
        outside=None,
        nuisance=asdict(chance),
        made_at=time.time(),
    )
    key_path(out).write_text(json.dumps(asdict(truth), indent=1))
    return truth


def key_path(out: Path | str) -> Path:
    """The key's place: beside the case's folder."""
    out = Path(out).absolute()
    return out.with_name(out.name + ".key.json")


def stream(seed: int, *tags: str | int) -> np.random.Generator:
    """Random numbers that follow from the seed and what they are for."""
    return np.random.default_rng([seed, *(zlib.crc32(str(tag).encode()) for tag in tags)])


def _check(effect: str, simulator: str, sensor: str, given: str, numbers: dict[str, float]) -> None:
    for what, name, known in (
        ("effect", effect, ("none", *EFFECTS)),
        ("simulator", simulator, sensors.SIMULATORS),
        ("sensor", sensor, tuple(sensors.SENSORS)),
        ("given", given, GIVEN),
    ):
        if name not in known:
            raise ValueError(f"{what} {name!r} is not known; choose one of {', '.join(known)}")
    for what, value in numbers.items():
        if value <= 0:
            raise ValueError(f"{what} is {value}; give a positive number")


def _entry(effect: str, severity: float, plan: Plan) -> dict[str, Any]:
    row = EFFECTS[effect]
    return {
        "name": effect,
        "channels": list(row.channels),
        "covariates": list(row.covariates),
        "parameters": plan.parameters,
        "amount": severity * row.unit,
        "severity": severity,
        "right": list(row.right or (effect,)),
    }


def _drives(scenes: int, rng: np.random.Generator, *, told: bool) -> dict[str, dict[str, Any]]:
    """Entries of grid.json: a frame a scene; with time, speed and heading where they are told."""
    time_s = np.cumsum(rng.uniform(30, 120, scenes))
    facts = [{"time": round(t - time_s[0], 3), "speed": round(v, 3), "heading": round(h, 5)} for t, v, h in zip(
        time_s.tolist(), rng.uniform(0, 14, scenes).tolist(), rng.uniform(-np.pi, np.pi, scenes).tolist(), strict=True
    )]  # fmt: skip
    return {f"{k:04d}": {"scene": f"drive_{k:03d}", **(fact if told else {})} for k, fact in enumerate(facts)}


def _rasters(view: View, hit: np.ndarray, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Classes, objects, incidence and colours: a hue an object (of ground: a class), lit from the front."""
    hue = rng.uniform(30, 230, (1024, 3))
    base = hue[np.where(view.instance > 0, 64 + view.instance % 960, view.semantic)]
    light = 0.6 + 0.4 * np.cos(view.incidence_rad)[..., None]
    colours = np.where((view.range_m > 0)[..., None], base * light + rng.normal(0, 6, base.shape), (150, 180, 220))
    return {
        "semantic": view.semantic.astype(np.uint8),
        "instance": view.instance.astype(np.int32),
        "incidence": np.where(hit, view.incidence_rad, 0).astype(np.float32),
        "rgb": np.clip(colours, 0, 255).astype(np.uint8),
    }
