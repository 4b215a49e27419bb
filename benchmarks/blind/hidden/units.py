"""How large is severity 1: the size that an oracle detects half the time, or the smallest that matters.

The oracle knows the streets, the exact form and all noise levels, and asks 'planted or not' by the likelihood ratio
of the residuals; its power at 5 % is one half where the noncentrality λ = 1.645. Approximations: intensity residuals
are normal in the log with texture, shot noise and normals noise a pixel, a random level a thing or a 5 m patch of
ground, and a free level a class; range residuals are normal with a random pose a frame (its effect on the ground and
along the beam), at most 3 sd each; lost and early returns are Bernoulli, lattices are seen at any step. With 300 000
rays the oracle sees sizes that no engineer cares about, so a unit is never below `floor`, a quarter of the catalogue's
default size; the table says which of the two it is.
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np
from scipy.special import ndtr

from benchmarks.blind.hidden.case import Setting, look_at, make_setting, measure, predict
from benchmarks.blind.hidden.catalogue import EFFECTS, OUTSIDE, UNITS_FILE, cap_of, floor_of, maker_of
from benchmarks.blind.hidden.frames import HEIGHT_M, State
from benchmarks.blind.hidden.nuisance import Nuisance, stream

LAMBDA = 1.645
EARLY_RATE = 1e-4
LATTICES = ("intensity_quantization", "range_quantization")
COMMAND = "python -m benchmarks.blind.hidden units"


def noncentrality(base: list[State], planted: list[State], nuisance: Nuisance) -> float:
    """λ of the oracle's test between two versions of the same frames with the same random numbers."""
    total = _intensity(base, planted, nuisance)
    for a, b in zip(base, planted, strict=True):
        total += _range(a, b, nuisance) + _returns(a, b)
    return float(np.sqrt(max(total, 0.0)))


def _intensity(base: list[State], planted: list[State], n: Nuisance) -> float:
    d, w, group, kind, things = [], [], [], [], []
    for a, b in zip(base, planted, strict=True):
        both = a.hit & b.hit & (a.instance == b.instance) & (a.semantic == b.semantic)
        step = np.log(np.clip(b.intensity, 1e-4, 1)[both] / np.clip(a.intensity, 1e-4, 1)[both])
        slope = np.minimum(np.tan(a.theta[both]) * n.normals_sd_rad, 1.0)
        variance = n.texture_sd**2 + n.intensity_sd**2 + slope**2
        d.append(np.clip(step, -3 * np.sqrt(variance), 3 * np.sqrt(variance)))
        w.append((1 - b.drop[both]) / variance)
        thing = a.instance[both] > 0
        x, y = (np.floor(a.range_m[both] * f(a.azimuth[both]) / 5 + 50) for f in (np.cos, np.sin))
        patch = 1000 + (a.semantic[both] * 101 + x) * 101 + y
        group.append(np.where(thing, a.instance[both], patch) + a.moment.scene * 10_000_000)
        kind.append(a.semantic[both])
        things.append(thing)
    d, w, group, kind, things = (np.concatenate(x) for x in (d, w, group, kind, things))
    _, first, of = np.unique(group, return_index=True, return_inverse=True)
    tau2 = np.where(things[first], 1.0, 0.8**2) * n.instance_sd**2
    a, b, c = (np.bincount(of, x) for x in (w, w * d, w * d * d))
    shrink = 1 + a * tau2
    level, weight = (np.bincount(kind[first], x / shrink, 64) for x in (b, a))
    return float((c - b**2 * tau2 / shrink).sum() - (level**2 / np.maximum(weight, 1e-12)).sum())


def _range(a: State, b: State, n: Nuisance) -> float:
    both = a.hit & b.hit
    r, az, ground = a.range_m[both], a.azimuth[both], np.isin(a.semantic[both], (7, 8, 22))
    d = (b.range_m + b.bias_m)[both] - (a.range_m + a.bias_m)[both]
    sd = np.hypot(n.range_sd_m, a.sd_m[both])
    d = np.clip(d, -3 * sd, 3 * sd) / sd
    keep = np.sqrt(1 - b.drop[both])
    d = d * keep
    lean = ground * np.minimum(r * r / HEIGHT_M, 1e3)
    jacobian = np.stack([lean * np.cos(az), lean * np.sin(az), ground * r / HEIGHT_M, np.cos(az), np.sin(az)], 1)
    sizes = np.array([n.pose_rad, n.pose_rad, n.pose_m, n.pose_m, n.pose_m])
    x = jacobian * sizes / sd[:, None] * keep[:, None]
    bent = x.T @ d
    total = d @ d - bent @ np.linalg.solve(np.eye(5) + x.T @ x, bent)
    ratio = np.log(np.hypot(n.range_sd_m, b.sd_m[both]) / sd)
    return float(total + (2 * ratio**2 * keep**2).sum())


def _information(p: np.ndarray, q: np.ndarray) -> float:
    """Twice the Bernoulli divergence of p from q."""
    p, q = np.clip(p, 1e-9, 1 - 1e-9), np.clip(q, 1e-9, 1 - 1e-9)
    return float(2 * (p * np.log(p / q) + (1 - p) * np.log((1 - p) / (1 - q))).sum())


def _returns(a: State, b: State) -> float:
    hit = a.hit & b.hit
    total = _information(b.drop[hit], a.drop[hit])
    for probability, early_m, _ in b.early:
        ahead = (early_m < np.where(b.hit, b.range_m, 200) - 0.5) | b.outshine
        p = np.where(ahead, probability, 0)
        p = p[p > 1e-6]
        total += _information(p, np.full(p.shape, EARLY_RATE))
    return total


def oracle_amount(name: str, setting: Setting, simulated: list, base: list[State]) -> tuple[float, bool]:
    """Amount at which λ = 1.645, by the secant rule in the logarithms between floor / 300 and the cap.

    Returns:
        The amount, and whether it is only a bound: the oracle detects more than half even of floor / 300, as with
        effects that shift silhouettes or that have no continuous limit.
    """
    about, make = look_at(setting, simulated), maker_of(name)
    low, high = np.log(floor_of(name) / 300), np.log(min(cap_of(name), floor_of(name) * 300))
    x, tried = np.log(floor_of(name)), []
    for _ in range(6):
        plan = make(float(np.exp(x)), stream(setting.entropy, "effect", name), about)
        found = noncentrality(base, measure(setting, simulated, [plan]), setting.nuisance)
        y = float(np.log(max(found, 1e-3) / LAMBDA))
        tried.append((x, y))
        if abs(y) < 0.05 or (x == low and y > 0):
            break
        slope = 1.0
        if len(tried) > 1:
            (x0, y0), (x1, y1) = tried[-2:]
            slope = float(np.clip((y1 - y0) / (x1 - x0), 0.3, 3)) if x1 != x0 else 1.0
        x = float(np.clip(x - y / slope, low, high))
    x, y = min(tried, key=lambda t: abs(t[1]))
    return float(np.exp(x)), y > 0.3


def oracle_power(key: dict[str, Any]) -> float:
    """Chance that the oracle's test at 5 % detects what a key hides, by the table of units; 0.05 of nothing.

    λ grows with the amount as in the table's case; several effects add their squares.
    """
    table = json.loads(UNITS_FILE.read_text())["units"]
    hidden = key["effects"] + ([key["outside"]] if key["outside"] else [])
    if any(table[entry["name"]]["oracle"] == 0 for entry in hidden):
        return 1.0
    squares = [(LAMBDA * entry["amount"] / table[entry["name"]]["oracle"]) ** 2 for entry in hidden]
    return float(ndtr(np.sqrt(sum(squares)) - LAMBDA))


def make_table(seed: int = 1, scenes: int = 16, rows: int = 48, columns: int = 384) -> dict:
    """Oracle size, minimal relevant size and unit of everything that can be hidden; a default case of that seed."""
    setting = make_setting((seed, 0), "default", scenes, 1, rows, columns)
    simulated = predict(setting)
    base = measure(setting, simulated, [])
    units = {}
    for name in (*EFFECTS, *OUTSIDE):
        oracle, bound = (0.0, True) if name in LATTICES else oracle_amount(name, setting, simulated, base)
        unit = max(oracle, floor_of(name))
        units[name] = {
            "unit": float(f"{unit:.3g}"),
            "oracle": float(f"{oracle:.3g}"),
            "oracle_is_upper_bound": bound,
            "floor": float(f"{floor_of(name):.3g}"),
            "by": "oracle" if oracle > floor_of(name) else "floor",
            "amount": EFFECTS[name].amount if name in EFFECTS else OUTSIDE[name].amount,
        }
    return {"command": COMMAND, "frames": scenes, "rows": rows, "columns": columns, "seed": seed, "units": units}


def write_table() -> dict:
    """Compute the table and store it beside this file."""
    table = make_table()
    head = json.dumps({k: v for k, v in table.items() if k != "units"})[:-1]
    rows = ",\n".join(f"  {json.dumps(name)}: {json.dumps(row)}" for name, row in table["units"].items())
    UNITS_FILE.write_text(f'{head},\n "units": {{\n{rows}\n }}}}\n')
    return table
