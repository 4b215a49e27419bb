"""Pairs of folders that are out of the ordinary, and what is answered to each:

    python -m benchmarks.blind.unusual OUT --simulator ideal noisy

Streets of the hidden world in which nothing of the catalogue is hidden in its usual form: mountings and moments that
are off, arrays that are missing, laws in another form than the catalogue's, readings that have nothing to do with each
other (KINDS). One JSON line a case goes to OUT/cases.jsonl; the same command again goes on where it stopped. `--table`
runs nothing. Writes OUT/summary.md, also printed. Development seeds alone: nothing here is sealed.
"""

from __future__ import annotations

import argparse
import json
import shutil
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from benchmarks.blind.hidden import key_path, make_case
from benchmarks.blind.hidden.placed import Placed
from benchmarks.blind.hidden.simulator import SIMULATORS
from benchmarks.blind.plan import DEVELOPMENT
from benchmarks.blind.rows import code_version, run_cases
from jaxsim.discover import discover_folders

Row = dict[str, Any]
Frame = dict[str, np.ndarray]
"""One side's arrays, each (rows, columns)."""
Edit = Callable[[Frame, Frame, np.random.Generator], None]
"""Changes the first, measured, frame in place; the second is simulated."""
CLASSES = ("semantic", "instance", "rgb")


def _nothing(measured: Frame, simulated: Frame, rng: np.random.Generator) -> None:
    """Leaves the frame as it was made."""


def lose(measured: Frame, lost: np.ndarray) -> None:
    """Returns that are no more."""
    for name in ("range", "intensity"):
        measured[name] = np.where(lost, 0, measured[name])


def brighten(measured: Frame, nats: Float[np.ndarray, "r c"]) -> None:
    """Intensities times exp(nats), at most 1."""
    measured["intensity"] = np.clip(measured["intensity"] * np.exp(nats), 0, 1)


def _drop(measured: Frame, simulated: Frame, rng: np.random.Generator) -> None:
    lose(measured, rng.random(measured["range"].shape) < 0.06)


def _ripple(measured: Frame, simulated: Frame, rng: np.random.Generator) -> None:
    columns = measured["range"].shape[1]
    brighten(measured, np.log1p(0.2 * np.sin(2 * np.pi * 16 * np.arange(columns) / columns + 0.7))[None])


def _noise(sd_m: float) -> Edit:
    def edit(measured: Frame, simulated: Frame, rng: np.random.Generator) -> None:
        hit = measured["range"] > 0
        noisy = measured["range"] + sd_m * rng.normal(size=hit.shape)
        measured["range"] = np.where(hit, np.maximum(noisy, 0.05), 0)

    return edit


def _angles(measured: Frame, simulated: Frame, rng: np.random.Generator) -> None:
    """An edge is where the line between the ends of two neighbouring rays stands at less than 3 degrees to the ray."""
    r = np.where(simulated["range"] > 0, simulated["range"], 1e3)
    edge = np.zeros(r.shape, bool)
    for axis, step_rad in ((0, np.deg2rad(0.6)), (1, 2 * np.pi / r.shape[1])):
        beside = np.roll(r, 1, axis)
        beside.swapaxes(0, axis)[0] = r.swapaxes(0, axis)[0]
        near, far = np.minimum(r, beside), np.maximum(r, beside)
        steep = np.arctan2(near * np.sin(step_rad), far - near * np.cos(step_rad)) < np.deg2rad(3)
        edge |= steep | np.roll(steep, -1, axis)
    lose(measured, edge & (rng.random(r.shape) < 0.6))


def _kernel(measured: Frame, simulated: Frame, rng: np.random.Generator) -> None:
    """An edge is where the ranges of the nine rays about one differ by more than a fifth of its own."""
    r = np.where(simulated["range"] > 0, simulated["range"], np.nan)
    wide = np.pad(r, 1, mode="edge")
    rows, columns = r.shape
    around = np.stack([wide[a : a + rows, b : b + columns] for a in range(3) for b in range(3)])
    spread = np.where(np.isfinite(around), around, -np.inf).max(0) - np.where(np.isfinite(around), around, np.inf).min(
        0
    )
    lose(measured, (spread > 0.2 * np.nan_to_num(r, nan=np.inf)) & (rng.random(r.shape) < 0.6))


def _photons(measured: Frame, simulated: Frame, rng: np.random.Generator) -> None:
    """The power of a sensor that a simulator's reflectivity was never taken to: r^-2.9 beyond 8 m, less within."""
    r = np.maximum(simulated["range"], 0.5)
    brighten(measured, -2.9 * np.log(np.maximum(r, 8) / 8) - 0.8 * np.exp(-((r / 3) ** 2)))


@dataclass(frozen=True)
class Kind:
    """Something out of the ordinary."""

    want: str
    """In words, what an answer should be."""
    right: Callable[[dict[str, Any]], bool]
    """Of verdict.json."""
    edit: Edit = _nothing
    about: dict[str, Any] = field(default_factory=dict)
    """Of `make_case`."""
    without: tuple[str, ...] = ()
    """Arrays and facts of frames that are not given."""
    mixed: bool = False
    """Measured intensities are those of another frame."""


def names(verdict: dict[str, Any]) -> list[str]:
    return [effect["name"] for effect in verdict["effects"]]


def _is(*wanted: str) -> Callable[[dict[str, Any]], bool]:
    """Named is exactly one of `wanted`."""
    return lambda verdict: len(names(verdict)) == 1 and names(verdict)[0] in wanted


def _none(verdict: dict[str, Any]) -> bool:
    return verdict["verdict"] == "none"


def _level(name: str, value: float) -> Callable[[dict[str, Any]], bool]:
    """The missing level is told, and nothing else is named. The sensors of these streets have noise of their own, up to
    1.5 cm, which an ideal simulator lacks too."""

    def right(verdict: dict[str, Any]) -> bool:
        [level] = [one for one in verdict["levels"] if one["name"] == name]
        most = 1.1 * np.hypot(value, 0.015)
        return 0.9 * value < level["missing"]["value"] < most and set(names(verdict)) <= {name}

    return right


def _repeats(period: float) -> Callable[[dict[str, Any]], bool]:
    def right(verdict: dict[str, Any]) -> bool:
        told = [one["period"] for one in verdict["repeats"] if one["period"]]
        return verdict["verdict"] == "not_in_catalogue" and any(abs(one - period) < 0.05 * period for one in told)

    return right


KINDS = {
    "late": Kind("none", _none, about={"placed": Placed(late_s=0.3)}),
    "elevation": Kind("beam_elevation_error", _is("beam_elevation_error"), about={"placed": Placed(lifted_deg=0.5)}),
    "azimuth": Kind("extrinsic_rotation", _is("extrinsic_rotation"), about={"placed": Placed((0.0, 0.0, 0.4))}),
    "no_speed": Kind(
        "motion_distortion",
        _is("motion_distortion"),
        about={"effect": "motion_distortion", "severity": 4.0},
        without=("speed",),
    ),
    "drop_bare": Kind("random_dropout", _is("random_dropout"), _drop, without=CLASSES),
    "ripple": Kind("not in the catalogue, 24 columns", _repeats(24.0), _ripple),
    "noise_2cm": Kind("range noise of 2 cm", _level("range_noise", 0.02), _noise(0.02)),
    "noise_4cm": Kind("range noise of 4 cm", _level("range_noise", 0.04), _noise(0.04)),
    "edge_angle": Kind("edge_dropout", _is("edge_dropout"), _angles),
    "edge_kernel": Kind("edge_dropout", _is("edge_dropout"), _kernel),
    "photons": Kind(
        "range_falloff and near_range_overlap",
        lambda verdict: set(names(verdict)) == {"range_falloff", "near_range_overlap"},
        _photons,
    ),
    "unrelated": Kind("unrelated", lambda verdict: verdict["unrelated"] and not names(verdict), mixed=True),
    "bare": Kind("none", _none, without=(*CLASSES, "incidence", "speed", "time", "heading")),
}


def main(argv: list[str] | None = None) -> None:
    args = _arguments(argv)
    cases = {
        f"{kind} {simulator}": partial(run, kind, simulator, folder=args.out / kind / simulator, seed=args.seed)
        for simulator in args.simulator
        for kind in args.only or KINDS
    }
    run_cases(args.out, {} if args.table else cases, summary=summary)


def run(name: str, simulator: str, *, folder: Path, seed: int) -> Row:
    """A case made and answered; its verdict stays."""
    kind = KINDS[name]
    shutil.rmtree(folder, ignore_errors=True)
    key_path(folder).unlink(missing_ok=True)
    make(kind, folder, simulator, seed)
    row: Row = {"key": f"{name} {simulator}", "kind": name, "simulator": simulator, "seed": seed}
    row |= {"code": code_version(), "want": kind.want}
    began = time.process_time()
    try:
        verdict = discover_folders(simulated=folder / "simulated", measured=folder / "measured").verdict
    except ValueError as refusal:
        return row | {"answer": f"refused: {refusal}", "right": False}
    finally:
        for side in ("simulated", "measured"):
            shutil.rmtree(folder / side)
    verdict.save(folder)
    plain = verdict.to_json()
    return row | {
        "answer": answer_of(plain),
        "right": bool(kind.right(plain)),
        "cpu_seconds": round(time.process_time() - began, 1),
    }


def make(kind: Kind, folder: Path, simulator: str, seed: int) -> None:
    """Two folders of polar frames with what is out of the ordinary."""
    make_case(folder, **{"effect": "none", "severity": 1.0, "seed": seed, "simulator": simulator} | kind.about)
    files = sorted((folder / "measured").glob("*.npz"))
    sides = [[dict(np.load(folder / side / file.name)) for file in files] for side in ("measured", "simulated")]
    lights = [frame["intensity"] for frame in sides[0]]
    for k, (measured, simulated) in enumerate(zip(*sides, strict=True)):
        if kind.mixed:
            other = lights[(k + 1) % len(lights)]
            # Where the other frame has no return, a middling value.
            measured["intensity"] = np.where(measured["range"] > 0, np.where(other > 0, other, np.median(other)), 0)
        kind.edit(measured, simulated, np.random.default_rng([seed, k]))
        np.savez(files[k], **{name: array.astype(np.float32) for name, array in measured.items()})
        kept = {name: array for name, array in simulated.items() if name not in kind.without}
        np.savez(folder / "simulated" / files[k].name, **kept)
    for side in ("measured", "simulated"):
        path = folder / side / "grid.json"
        grid = json.loads(path.read_text())
        for frame in grid["frames"].values():
            for name in kind.without:
                frame.pop(name, None)
        path.write_text(json.dumps(grid))


def answer_of(verdict: dict[str, Any]) -> str:
    """In a line: what is named, what is left, what repeats, and levels that are missing."""
    told = [verdict["verdict"], *names(verdict)]
    told += [f"(unconfirmed {effect['name']})" for effect in verdict["unconfirmed"]]
    if unexplained := verdict["unexplained"]:
        told.append(f"{unexplained['channel']} on {unexplained['covariate']}: {unexplained['formula']}")
    told += [f"repeats {one['channel']} {one['place']}" for one in verdict["repeats"][:2]]
    told += ["unrelated"] if verdict["unrelated"] else []
    lacks = [one for one in verdict["levels"] if one["missing"]["low"] > 0]
    return "; ".join(told + [f"lacks {one['name']} {one['missing']['value']:.3g}" for one in lacks])


def summary(rows: Sequence[Row]) -> str:
    """A line a case."""
    lines = [f"{len(rows)} cases; code {', '.join(sorted({row['code'] for row in rows}))}.", ""]
    lines += [_line(["kind", "simulator", "should be", "answer", "right"]), "|---" * 5 + "|"]
    for row in rows:
        right = "yes" if row["right"] else "no"
        lines.append(_line([row["kind"], row["simulator"], row["want"], row["answer"], right]))
    return "\n".join(lines)


def _line(cells: Iterable[Any]) -> str:
    return f"| {' | '.join(map(str, cells))} |"


def _arguments(argv: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--simulator", nargs="+", choices=SIMULATORS, default=["ideal"])
    parser.add_argument("--only", nargs="+", choices=tuple(KINDS), metavar="KIND", help="these alone")
    parser.add_argument("--seed", type=int, default=4711, help=f"of the streets, below {DEVELOPMENT}")
    parser.add_argument("--table", action="store_true", help="run nothing; show what OUT holds")
    args = parser.parse_args(argv)
    if args.seed >= DEVELOPMENT:
        parser.error(f"--seed {args.seed} is sealed; give one below {DEVELOPMENT}")
    return args


if __name__ == "__main__":
    main()
