"""Make a case: two folders of polar frames that show what a sensor saw and a simulator predicted, and the key."""

from __future__ import annotations

import json
import time
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.blind.hidden import frames as f
from benchmarks.blind.hidden import simulator as own
from benchmarks.blind.hidden.catalogue import COVARIATES, EFFECTS, OUTSIDE, Choice, amount_of, choose
from benchmarks.blind.hidden.laws import About
from benchmarks.blind.hidden.nuisance import Nuisance, Surfaces, draw_nuisance, stream
from benchmarks.blind.hidden.part import Part, confined, draw_part
from benchmarks.blind.hidden.placed import Placed
from benchmarks.blind.hidden.plan import Plan
from benchmarks.blind.hidden.street import Drive, build_drive

MEASURED = {"range": np.float32, "intensity": np.float32}
SIMULATED = MEASURED | {"incidence": np.float32, "semantic": np.uint8, "instance": np.int32, "rgb": np.uint8}


@dataclass(frozen=True)
class Key:
    """What a case hides; written beside the case folder, for the scorer alone.

    effects: [{name, channels, covariates (where it shows), parameters in the catalogue's terms, amount, severity,
    capped}]; outside: {name, channel, covariates, character, near, amount} or None; nuisance: what any finder has to
    live with; simulator: the name and the errors of the simulated side; placed: where and when the sensor stood, or
    None; part: where alone the effects act, or None.
    """

    case: str
    seed: int
    severity: float
    level: str
    effects: list[dict[str, Any]]
    outside: dict[str, Any] | None
    nuisance: dict[str, float]
    made_at: float
    simulator: dict[str, Any] = field(default_factory=lambda: {"name": "ideal"})
    placed: dict[str, Any] | None = None
    part: dict[str, Any] | None = None


@dataclass(frozen=True)
class Setting:
    """Everything of a case but its effects: reproducible from entropy alone."""

    entropy: tuple[int, ...]
    nuisance: Nuisance
    grid: f.Grid
    drives: list[Drive]
    surfaces: list[Surfaces]
    moments: list[f.Moment]
    simulator: own.Simulator = own.SIMULATORS["ideal"]
    planted: tuple[str, ...] = ()


def make_setting(
    entropy: tuple[int, ...],
    level: str,
    scenes: int,
    per_scene: int,
    rows: int,
    columns: int,
    simulator: str = "ideal",
) -> Setting:
    """Draw streets, drives, times, nuisances and the simulator's own errors."""
    rng = stream(entropy, "setting")
    drawn = own.draw_simulator(simulator, stream(entropy, "simulator"))
    nuisance = own.sensor_like(drawn, draw_nuisance(stream(entropy, "nuisance"), level))
    grid = f.make_grid(rng, rows, columns, bool(rng.random() < 0.5))
    drives = [build_drive(stream(entropy, "drive", s)) for s in range(scenes)]
    surfaces = [Surfaces(entropy, nuisance, s) for s in range(scenes)]
    starts = np.cumsum(rng.uniform(0.4, 1.6, scenes)) * rng.uniform(40, 100)
    starts -= starts[0]
    moments = []
    for s, drive in enumerate(drives):
        for k in range(per_scene):
            since = 0.5 * k
            heading = drive.compass_rad + drive.yaw_rad + drive.turn_rad_s * since
            heading = float(np.angle(np.exp(1j * heading)))
            moments.append(f.Moment(len(moments), s, float(starts[s] + since), since, drive.speed_m_s, heading))
    return Setting(entropy, nuisance, grid, drives, surfaces, moments, drawn)


def predict(setting: Setting) -> list[dict[str, np.ndarray]]:
    """The ideal simulator's frames; `_write` adds the errors of the others."""
    return [
        f.simulate(
            setting.drives[m.scene], m, setting.grid, setting.surfaces[m.scene], setting.nuisance, setting.entropy
        )
        for m in setting.moments
    ]


def look_at(setting: Setting, simulated: list[dict[str, np.ndarray]]) -> About:
    """The surfaces of a case as the effects' sizes and best fits need them: about 20 000 hit rays, no noise."""
    step = max(1, len(simulated) * simulated[0]["range"].size // 30000)
    gain = np.exp(setting.nuisance.gain)
    rows, columns = simulated[0]["range"].shape
    row = np.repeat(np.arange(rows), columns)[::step]
    azimuth = np.tile(setting.grid.azimuth, rows)[::step]
    parts = []
    for m, s in zip(setting.moments, simulated, strict=True):
        r, theta, kind = (s[k].ravel()[::step] for k in ("range", "true_theta", "true_semantic"))
        hit = r > 0
        i = gain * setting.surfaces[m.scene].true_table[kind] * np.cos(theta)
        parts.append([x[hit] for x in (r, theta, kind, i, row, azimuth)])
    r, theta, kind, i, row, azimuth = (np.concatenate(x) for x in zip(*parts, strict=True))
    if not len(r):
        raise ValueError("no ray of the case hits anything; give more rows and columns")
    edge = (-np.pi, np.pi) if setting.grid.full_turn else (-np.pi / 3, np.pi / 3)
    minutes = max((setting.moments[-1].time_s - setting.moments[0].time_s) / 60, 1e-3)
    return About(r, theta, kind, i, i / (r / 10) ** 2, row, azimuth, edge, rows, minutes)


def measure(setting: Setting, simulated: list[dict[str, np.ndarray]], plans: list[Plan]) -> list[f.State]:
    """The sensor's frames before chance, with the planned effects in them."""
    rays = [hook for p in plans for hook in p.rays]
    hooks = own.floor_noise(setting.simulator) + [hook for p in plans for hook in p.hooks]
    return [
        f.expose(
            setting.drives[m.scene], m, setting.grid, setting.surfaces[m.scene], setting.nuisance, setting.entropy, s,
            rays, hooks,
        )
        for m, s in zip(setting.moments, simulated, strict=True)
    ]  # fmt: skip


def make_case(
    folder: str | Path,
    *,
    effect: str | list[str] | tuple[str, ...] | None = "random",
    severity: float = 2.0,
    seed: int = 0,
    nuisance: str = "default",
    scenes: int = 16,
    frames: int = 1,
    rows: int = 48,
    columns: int = 384,
    simulator: str = "ideal",
    placed: Placed | None = None,
    part: str | Part | None = None,
) -> Key:
    """Write FOLDER/measured, FOLDER/simulated and FOLDER.key.json.

    Every choice (effect, severity, nuisance level, size) enters the seed of every random stream, so that two cases
    share no street: a null of the same seed tells nothing about a planted case.

    Args:
        effect: 'none', a name, 'A+B', 'outside:NAME', 'random' or a list of names.
        severity: multiple of the effect's unit (units.json).
        frames: frames a scene, half a second apart.
        simulator: one of simulator.SIMULATORS: the errors that the simulated side has of its own.
        placed: where and when the sensor stood, if not where the simulator has it; streets are those of a case without.
        part: one of part.KINDS, or a part: the effects act there alone, and frames have tags.

    Raises:
        FileExistsError: the folder or its key is there already.
        ValueError: an unknown name, level or simulator, a size or severity that is not positive.
    """
    folder = Path(folder)
    key_file = key_path(folder)
    for there in (folder / "measured", folder / "simulated", key_file):
        if there.exists():
            raise FileExistsError(f"{there} is there already; give another folder, a case is never overwritten")
    for name, value in {
        "severity": severity,
        "scenes": scenes,
        "frames": frames,
        "rows": rows,
        "columns": columns,
    }.items():
        if value <= 0:
            raise ValueError(f"{name} is {value}; give a positive number")
    # The ideal simulator adds no word: cases from before there were others stay what they are.
    other = () if simulator == "ideal" else (simulator,)
    other += () if part is None else (part.kind if isinstance(part, Part) else part,)
    entropy = _entropy(seed, effect, severity, nuisance, scenes, frames, rows, columns, *other)
    choice = choose(effect, stream(entropy, "choice"))
    setting = make_setting(entropy, nuisance, scenes, frames, rows, columns, simulator)
    setting = replace(setting, planted=choice.effects)
    simulated = predict(setting)
    plans, key = plant(choice, severity, setting, look_at(setting, simulated))
    where = draw_part(part, stream(entropy, "part"), scenes, setting.grid) if isinstance(part, str) else part
    if where:
        plans = [confined(plan, where) for plan in plans]
    seen = replace(setting, moments=placed.moments(setting.moments)) if placed else setting
    states = measure(seen, simulated, [*plans, placed.plan()] if placed else plans)
    case = stream(entropy, "id").bytes(8).hex()
    about = {"name": simulator, **setting.simulator.as_dict()}
    out = Key(case, seed, severity, nuisance, key[0], key[1], setting.nuisance.as_dict(), time.time(), about)
    out = replace(out, placed=asdict(placed) if placed else None, part=asdict(where) if where else None)
    _write(folder, setting, simulated, states, where)
    key_file.write_text(json.dumps(asdict(out), indent=1))
    return out


def plant(
    choice: Choice, severity: float, setting: Setting, about: About
) -> tuple[list[Plan], tuple[list[dict[str, Any]], dict[str, Any] | None]]:
    """Plans of the chosen effects and their entries of the key."""
    plans, entries = [], []
    for name in choice.effects:
        amount = amount_of(name, severity)
        plan = EFFECTS[name].make(amount, stream(setting.entropy, "effect", name), about)
        plans.append(plan)
        capped = amount >= EFFECTS[name].cap
        entries.append(
            {
                "name": name,
                "channels": list(EFFECTS[name].channels),
                "covariates": list(COVARIATES[name]),
                "parameters": plan.parameters,
                "amount": amount,
                "severity": severity,
                "capped": capped,
            }
        )
    if choice.outside is None:
        return plans, (entries, None)
    kind = OUTSIDE[choice.outside]
    amount = amount_of(choice.outside, severity)
    plans.append(kind.make(amount, stream(setting.entropy, "effect", choice.outside), about))
    outside = {
        "name": choice.outside,
        "channel": kind.channel,
        "covariates": list(kind.covariates),
        "character": kind.character,
        "near": list(kind.near),
        "amount": amount,
    }
    return plans, (entries, outside)


def key_path(folder: str | Path) -> Path:
    """The key's place: beside the case folder, so that nobody who gets the folder gets the key."""
    folder = Path(folder).absolute()
    return folder.with_name(folder.name + ".key.json")


def case_name(seed: int) -> str:
    """A folder name in hex that tells nothing, for benchmarks that make many cases."""
    return np.random.default_rng([seed, 0xCA5E]).bytes(6).hex()


def _entropy(seed: int, *choices: Any) -> tuple[int, ...]:
    rng = stream((seed,), *(json.dumps(c) for c in choices))
    return tuple(int(x) for x in rng.integers(0, 1 << 32, 4))


def _write(
    folder: Path,
    setting: Setting,
    simulated: list[dict[str, np.ndarray]],
    states: list[f.State],
    part: Part | None = None,
) -> None:
    """Arrays of fixed dtype without compression: no file's size depends on what it holds."""
    grid = {
        "azimuth": [float(x) for x in setting.grid.azimuth],
        "elevation": [float(x) for x in setting.grid.elevation],
        "origin": [0.0] * len(setting.grid.elevation),
        "frames": {
            f"{m.frame:04d}": {
                "scene": f"drive_{m.scene:03d}",
                "time": round(m.time_s, 3),
                "speed": round(m.speed_m_s, 3),
                "heading": round(m.heading_rad, 5),
            }
            | ({"tags": list(part.tags[m.scene])} if part else {})
            for m in setting.moments
        },
    }
    for part in ("measured", "simulated"):
        (folder / part).mkdir(parents=True)
        (folder / part / "grid.json").write_text(json.dumps(grid))
    lattice = own.coarser_than(setting.simulator, setting.planted)
    for m, s, state in zip(setting.moments, simulated, states, strict=True):
        reading = own.on_lattice(lattice, f.read_out(state, setting.nuisance))
        rng = stream(setting.entropy, "simulator", m.frame)
        s = own.rendered(setting.simulator, s, rng, full_turn=setting.grid.full_turn)
        name = f"{m.frame:04d}.npz"
        np.savez(folder / "measured" / name, **{k: reading[k].astype(t) for k, t in MEASURED.items()})
        np.savez(folder / "simulated" / name, **{k: s[k].astype(t) for k, t in SIMULATED.items()})
