"""A case: two folders of polar frames, measured and simulated, and the key beside them."""

from __future__ import annotations

import json
import time
from dataclasses import asdict, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.blind.raycast.chance import stream
from benchmarks.blind.raycast.effects import EFFECTS, STAGES, Hook, View
from benchmarks.blind.raycast.hall import HEIGHT_M as HALL_HEIGHT_M
from benchmarks.blind.raycast.hall import SPEED_M_S as HALL_SPEED
from benchmarks.blind.raycast.hall import build_hall
from benchmarks.blind.raycast.motorway import HEIGHT_M, SPEED_M_S, build_motorway, lane_of
from benchmarks.blind.raycast.nuisance import Nuisance, draw_nuisance
from benchmarks.blind.raycast.optics import Albedo, Echoes, Place, expose, render, small_turn
from benchmarks.blind.raycast.sensors import SCAN_S, Grid, grid_of
from benchmarks.blind.raycast.simulators import Simulator, as_noisy, draw_simulator, rounded, simulated

PLACES, GIVEN = ("hall", "motorway"), ("all", "bare")
UNITS = Path(__file__).parents[1] / "hidden" / "units.json"
"""The sizes of severity 1, which all hidden worlds share."""
MEASURED = {"range": np.float32, "intensity": np.float32}
SIMULATED = MEASURED | {"incidence": np.float32, "semantic": np.uint8, "instance": np.int32, "rgb": np.uint8}


@cache
def unit_of(effect: str) -> float:
    """The amount at severity 1."""
    return float(json.loads(UNITS.read_text())["units"][effect]["unit"])


def make_case(
    folder: str | Path,
    *,
    effect: str = "none",
    severity: float = 2.0,
    seed: int = 0,
    nuisance: str = "default",
    simulator: str = "ideal",
    place: str = "any",
    sensor: str = "spin64",
    given: str = "all",
    scenes: int = 16,
    rows: int = 0,
    columns: int = 0,
) -> dict[str, Any]:
    """Writes FOLDER/measured, FOLDER/simulated and FOLDER.key.json; returns the key.

    Args:
        effect: 'none', a name of EFFECTS or 'A+B'.
        severity: multiple of the effect's unit in hidden/units.json.
        simulator: one of SIMULATORS: errors of the simulated side.
        place: 'hall', 'motorway' or 'any', which the seed decides.
        given: 'all' arrays that the format has, or 'bare': range and intensity alone.
        rows, columns: 0 for the sensor's own.

    Raises:
        FileExistsError: the folder or its key is there already.
        ValueError: an unknown word, or a number that is not positive.
    """
    folder = Path(folder)
    key_file = folder.absolute().with_name(folder.name + ".key.json")
    if folder.exists() or key_file.exists():
        raise FileExistsError(f"{folder} or its key is there already; give another folder, no case is overwritten")
    names = _names(effect)
    _check("place", place, (*PLACES, "any"))
    _check("given", given, GIVEN)
    for name, value in {"severity": severity, "scenes": scenes}.items():
        if value <= 0:
            raise ValueError(f"{name} is {value}; give a positive number")
    case = f"{seed} {effect} {severity:g} {nuisance} {simulator} {place} {sensor} {given} {scenes} {rows} {columns}"
    own = draw_simulator(simulator, stream(case, "simulator"))
    truth = as_noisy(own, draw_nuisance(stream(case, "nuisance"), nuisance))
    place = str(stream(case, "place").choice(PLACES)) if place == "any" else place
    grid = grid_of(sensor, stream(case, "grid"), rows=rows, columns=columns)
    places = [_place(case, place, number, truth) for number in range(scenes)]
    echoes = [expose(at, grid, case, truth) for at in places]
    hooks, entries = _plant(case, names, severity, _view(grid, echoes))
    planted = {entry["name"]: entry["parameters"] for entry in entries}
    _write_grids(folder, grid, places, given)
    for at, echo in zip(places, echoes, strict=True):
        seen = simulated(own, render(at, grid, case, truth), stream(case, "own", at.frame), full_turn=grid.full_turn)
        reading = read_out(echo, hooks, truth, own, planted, case, at.frame)
        _write(folder, at, grid, reading, seen, given)
    key = {
        "case": stream(case, "id").bytes(8).hex(),
        "seed": seed,
        "severity": severity,
        "level": nuisance,
        "effects": entries,
        "outside": None,
        "nuisance": asdict(truth),
        "made_at": time.time(),
        "simulator": {"name": simulator, **asdict(own)},
        "world": {"name": "raycast", "place": place, "sensor": sensor, "given": given},
    }
    key_file.write_text(json.dumps(key, indent=1))
    return key


def read_out(
    echo: Echoes,
    hooks: dict[str, list[Hook]],
    nuisance: Nuisance,
    simulator: Simulator,
    planted: dict[str, dict[str, Any]],
    case: str,
    frame: int,
) -> dict[str, np.ndarray]:
    """The sensor's reading: effects by stage, shot noise and the receiver's floor before its own, then chance and
    lattices; a hidden lattice takes the place of the one that both sides share."""
    rng, shape = stream(case, "read", frame), echo.hit.shape
    for stage in STAGES:
        if stage == "receiver":
            echo.dim(np.exp(nuisance.shot_sd * rng.normal(size=shape)))
            echo.intensity = np.maximum(echo.intensity + simulator.floor_sd * rng.normal(size=shape), 0)
        for hook in hooks[stage]:
            hook(echo, rng)
    sd = np.hypot(nuisance.range_sd_m, echo.sd_m)
    r = np.where(echo.hit, echo.range_m, 0) + echo.bias_m + sd * rng.normal(size=shape)
    kept = echo.hit & (rng.random(shape) >= echo.lost) & (r > 0.05)
    step = planted.get("range_quantization", {"step_m": simulator.range_step_m})["step_m"]
    levels = 0 if "intensity_quantization" in planted else simulator.levels
    reading = {"range": np.where(kept, r, 0.0), "intensity": np.where(kept, np.clip(echo.intensity, 0, 1), 0.0)}
    return rounded(replace(simulator, range_step_m=step, levels=levels), reading)


def _names(effect: str) -> list[str]:
    names = [] if effect == "none" else effect.split("+")
    for name in names:
        _check("effect", name, ("none", *EFFECTS))
    return sorted(set(names), key=list(EFFECTS).index)


def _check(what: str, given: str, known) -> None:
    if given not in known:
        raise ValueError(f"{what} {given!r} is not known; choose one of {', '.join(known)}")


def _place(case: str, kind: str, number: int, nuisance: Nuisance) -> Place:
    rng = stream(case, "scene", number)
    hall = kind == "hall"
    scene = build_hall(rng) if hall else build_motorway(rng)
    aside = float(rng.normal(0, 0.2)) if hall else lane_of(rng)
    origin = np.array([0.0, aside, rng.uniform(*(HALL_HEIGHT_M if hall else HEIGHT_M))])
    yaw = float(rng.normal(0, 0.3 if hall else 0.02))
    speed = float(rng.uniform(*(HALL_SPEED if hall else SPEED_M_S)))
    heading = float(np.angle(np.exp(1j * (rng.uniform(-np.pi, np.pi) + yaw))))
    albedo = Albedo(case, number, nuisance)
    return Place(number, scene, albedo, small_turn(np.array([0, 0, yaw])), origin, 40.0 * number, speed, heading)


def _view(grid: Grid, echoes: list[Echoes]) -> View:
    thin = max(1, len(echoes) * echoes[0].hit.size // 30000)
    hit = np.concatenate([e.hit.ravel() for e in echoes])[::thin]
    if not hit.any():
        raise ValueError("no ray of the case hits anything; give more rows and columns")
    fields = ("range_m", "theta", "albedo", "semantic")
    values = [np.concatenate([getattr(e, name).ravel() for e in echoes])[::thin][hit] for name in fields]
    half = np.pi if grid.full_turn else float(grid.azimuth[0])
    return View(*values, grid.shape[0], (-half, half))


def _plant(case: str, names: list[str], severity: float, view: View):
    hooks: dict[str, list[Hook]] = {stage: [] for stage in STAGES}
    entries = []
    for name in names:
        effect = EFFECTS[name]
        amount = min(severity * unit_of(name), effect.cap)
        hook, parameters = effect.make(amount, stream(case, "effect", name), view)
        hooks[effect.stage].append(hook)
        about = {"name": name, "channels": list(effect.channels), "covariates": list(effect.covariates)}
        size = {"amount": amount, "severity": severity, "capped": amount >= effect.cap}
        entries.append(about | {"parameters": parameters} | size)
    return hooks, entries


def _write_grids(folder: Path, grid: Grid, places: list[Place], given: str) -> None:
    frames = {}
    for at in places:
        frames[f"{at.frame:04d}"] = {"scene": f"place_{at.frame:03d}"}
        if given == "all":
            motion = {"time": at.time_s, "speed": round(at.speed_m_s, 3), "heading": round(at.heading_rad, 5)}
            frames[f"{at.frame:04d}"] |= motion
    angles = {"azimuth": grid.azimuth.tolist(), "elevation": grid.elevation.tolist()}
    for part in ("measured", "simulated"):
        (folder / part).mkdir(parents=True)
        (folder / part / "grid.json").write_text(json.dumps({**angles, "frames": frames}))


def _write(folder: Path, at: Place, grid: Grid, reading, seen, given: str) -> None:
    """Without compression: no file's size depends on what it holds."""
    name = f"{at.frame:04d}.npz"
    kinds = (MEASURED, SIMULATED if given == "all" else MEASURED)
    fired = np.broadcast_to(SCAN_S * (np.arange(grid.shape[1]) + 0.5) / grid.shape[1], grid.shape)
    more = {"time": fired.astype(np.float32)} if given == "all" else {}
    for part, arrays, kind in zip(("measured", "simulated"), (reading, seen), kinds, strict=True):
        np.savez(folder / part / name, **{k: arrays[k].astype(t) for k, t in kind.items()}, **more)
