"""Effects planted on given frames, say real scans: `plant_on` makes of them what a sensor with the effect reads.

The given range and intensity are the truth, and what a simulator predicts; effects, noise and lost returns are those
of the generated streets, but nothing is cast anew: effects that move rays cannot be planted, nor the simulator's
errors of pose. Angles of incidence follow from the range image.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from benchmarks.blind.hidden import frames as f
from benchmarks.blind.hidden import simulator as own
from benchmarks.blind.hidden.case import Key
from benchmarks.blind.hidden.catalogue import COVARIATES, EFFECTS, OUTSIDE, amount_of
from benchmarks.blind.hidden.laws import About
from benchmarks.blind.hidden.nuisance import Nuisance, draw_nuisance, stream

STEEPEST_RAD = np.deg2rad(85.0)
UNPLANTABLE = ("blooming", "emitter_drift", "material_dropout", "retroreflection", "specular_lobe")
"""They act on traffic signs, vehicles or classes, or in the course of a recording: scans alone tell none of these."""

OUTSIDE_HERE = (
    "gain_step_scan",
    "azimuth_periodic_gain",
    "column_parity_gain",
    "row_parity_offset",
    "azimuth_periodic_range_bias",
    "azimuth_periodic_drop",
    "range_periodic_drop",
)
"""Kinds from outside the catalogue that need no class, colour, speed or time."""


class Scan(NamedTuple):
    """One frame: (rows, columns) of range (m, 0 = nothing there) and intensity (0..1), and where its view looks."""

    range_m: np.ndarray
    intensity: np.ndarray
    heading_rad: float


def list_plantable() -> list[str]:
    """Effects that need neither other rays nor classes or times."""
    rng, about = np.random.default_rng(0), _example()
    return [n for n in EFFECTS if n not in UNPLANTABLE and not EFFECTS[n].make(amount_of(n, 1.0), rng, about).rays]


def plant_on(
    scans: Sequence[Scan],
    grid: f.Grid,
    *,
    effect: str,
    severity: float,
    seed: int,
    simulator: own.Simulator = own.SIMULATORS["ideal"],
) -> tuple[list[dict[str, np.ndarray]], Key]:
    """What the sensor reads, {range, intensity} a frame, and the key.

    Args:
        effect: 'none', a name of list_plantable() or 'outside:NAME' of OUTSIDE_HERE.
        severity: multiple of the effect's unit (units.json).
        simulator: the errors that the simulated side has of its own (`simulated_of`); the sensor's noise is alike.

    Raises:
        ValueError: the effect cannot be planted on given frames, or the frames do not fit the grid.
    """
    shape = (len(grid.elevation), len(grid.azimuth))
    for number, scan in enumerate(scans):
        if scan.range_m.shape != shape or scan.intensity.shape != shape:
            raise ValueError(f"scan {number} is {scan.range_m.shape}, {scan.intensity.shape}; the grid is {shape}")
    outside = effect.removeprefix("outside:") if effect.startswith("outside:") else None
    plantable = ("none", *list_plantable(), *(f"outside:{name}" for name in OUTSIDE_HERE))
    if effect not in plantable:
        raise ValueError(f"{effect!r} cannot be planted on given frames; choose one of {', '.join(plantable)}")
    entropy = tuple(int(x) for x in stream((seed,), effect, f"{severity:g}").integers(0, 1 << 32, 4))
    nuisance = own.sensor_like(simulator, draw_nuisance(stream(entropy, "nuisance"), "default"))
    states = [_state(scan, grid, number, entropy) for number, scan in enumerate(scans)]
    about, rng = _about(states, grid), stream(entropy, "effect", effect)
    effects: list[dict[str, Any]] = []
    other: dict[str, Any] | None = None
    hooks = own.floor_noise(simulator)
    if effect != "none":
        name = outside or effect
        amount = amount_of(name, severity)
        plan = (OUTSIDE[name] if outside else EFFECTS[name]).make(amount, rng, about)
        hooks = hooks + plan.hooks
        if outside:
            kind = OUTSIDE[name]
            other = {"name": name, "channel": kind.channel, "covariates": list(kind.covariates), "amount": amount}
        else:
            entry = {"name": name, "channels": list(EFFECTS[name].channels), "covariates": list(COVARIATES[name])}
            effects = [entry | {"parameters": plan.parameters, "amount": amount, "severity": severity}]
    lattice = own.coarser_than(simulator, (effect,))
    measured = [own.on_lattice(lattice, _read(state, hooks, nuisance)) for state in states]
    case = stream(entropy, "id").bytes(8).hex()
    return measured, Key(case, seed, severity, "default", effects, other, nuisance.as_dict(), time.time())


def simulated_of(scan: Scan, simulator: own.Simulator, *, seed: int, number: int) -> dict[str, np.ndarray]:
    """The given frame, {range, intensity}, as a simulator with errors of its own writes it. It knows no class."""
    nothing = np.zeros(scan.range_m.shape)
    frame = {"range": scan.range_m, "intensity": scan.intensity}
    frame |= dict.fromkeys(("texture", "true_theta", "incidence", "semantic", "instance"), nothing)
    return own.rendered(simulator, frame, stream((seed,), "simulator", str(number)), full_turn=False)


def _read(state: f.State, hooks: Sequence[tuple[str, f.Hook]], nuisance: Nuisance) -> dict[str, np.ndarray]:
    state.scale(np.exp(nuisance.gain + nuisance.texture_sd * state.random("texture").normal(0, 1, state.hit.shape)))
    state.lose(nuisance.drop + nuisance.edge_drop * f.silhouette(state.range_m, state.grid.full_turn))
    for stage in f.STAGES:
        if stage == "receiver":
            state.scale(np.exp(nuisance.intensity_sd * state.random("shot").normal(0, 1, state.hit.shape)))
        for at, hook in hooks:
            if at == stage:
                hook(state)
    return f.read_out(state, nuisance)


def _state(scan: Scan, grid: f.Grid, number: int, entropy: tuple[int, ...]) -> f.State:
    """The frame as light finds it: no effect, no noise."""
    hit, shape = scan.range_m > 0, scan.range_m.shape
    range_m = np.where(hit, scan.range_m, np.inf).astype(float)
    intensity = np.where(hit, scan.intensity, 0.0).astype(float)
    nothing = np.zeros(shape, int)
    return f.State(
        grid=grid, moment=f.Moment(number, number, float(number), 0.0, 0.0, scan.heading_rad),
        simulated={"intensity": intensity}, hit=hit, range_m=range_m, theta=incidence_of(range_m, grid),
        semantic=nothing, instance=nothing, intensity=intensity,
        power=np.where(hit, intensity / np.where(hit, range_m / 10, 1) ** 2, 0.0), drop=np.zeros(shape),
        bias_m=np.zeros(shape), sd_m=np.zeros(shape), entropy=entropy, rgb=np.zeros((*shape, 3), np.uint8),
    )  # fmt: skip


def incidence_of(range_m: np.ndarray, grid: f.Grid) -> np.ndarray:
    """Angle (rad) between each ray and the normal of the plane through its neighbours two columns aside and one row
    off; where they do not lie on one surface, the median of the frame."""
    ray = f.nominal(grid).direction
    point = ray * np.where(np.isfinite(range_m), range_m, np.nan)[..., None]
    along, across = np.full_like(point, np.nan), np.full_like(point, np.nan)
    along[:, 2:-2] = point[:, 4:] - point[:, :-4]
    across[1:-1] = point[2:] - point[:-2]
    normal = np.cross(along, across)
    length = np.linalg.norm(normal, axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        angle = np.arccos(np.clip(np.abs((normal * ray).sum(-1)) / length, 0, 1))
        smooth = np.linalg.norm(along, axis=-1) < 0.5 + 0.1 * range_m
    known = np.isfinite(angle) & smooth & (angle < STEEPEST_RAD)
    middle = float(np.median(angle[known])) if known.any() else 0.0
    return np.where(known, angle, middle)


def _about(states: Sequence[f.State], grid: f.Grid) -> About:
    """The surfaces as the effects' sizes and best fits need them: about 20 000 hit rays."""
    step = max(1, len(states) * states[0].hit.size // 30000)
    fields = ("range_m", "theta", "semantic", "intensity", "power", "row", "azimuth")
    parts = [[getattr(s, name).ravel()[::step][s.hit.ravel()[::step]] for name in fields] for s in states]
    values = dict(zip(fields, (np.concatenate(column) for column in zip(*parts, strict=True)), strict=True))
    if not len(values["range_m"]):
        raise ValueError("no ray of the frames hits anything; give frames with returns")
    width = (grid.azimuth[0] - grid.azimuth[-1]) / (len(grid.azimuth) - 1)
    edge = (float(grid.azimuth[-1] - width / 2), float(grid.azimuth[0] + width / 2))
    minutes = max(len(states) / 60, 1e-3)
    return About(**values, edge_azimuth=edge, rows=len(grid.elevation), minutes=minutes)


def _example() -> About:
    """Any surfaces: enough to make a plan and see what it needs."""
    rng = np.random.default_rng(0)
    r, theta, i = rng.uniform(3, 60, 4000), rng.uniform(0, 1.3, 4000), rng.uniform(0.05, 0.5, 4000)
    row, kind = rng.integers(0, 16, 4000), rng.choice([7, 11, 21, 26], 4000)
    return About(r, theta, kind, i, i / (r / 10) ** 2, row, rng.uniform(-0.7, 0.7, 4000), (-0.7, 0.7), 16, 1.0)
