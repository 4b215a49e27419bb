"""What noise on a simulator does to conclusions, in two pictures:

    python -m benchmarks.blind.noise_pictures docs/pictures

makes a null of the hidden world with a noisy simulator (development seed) and holds it against the sensor twice: as the
simulator wrote its frames, and as it means them (`jaxsim.discover.model.simulator`). Writes noisy_slope.svg, measured
against simulated detail within surfaces, and noisy_gains.svg, what effects on intensities gain on held-out scenes where
nothing is missing; prints slopes and gains.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Sequence
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from benchmarks.blind.hidden import make_case
from jaxsim.compilation import enable_compilation_cache
from jaxsim.discover import Comparison, read_comparison
from jaxsim.discover.find.division import Division, NullModel
from jaxsim.discover.model.cast import with_planes
from jaxsim.discover.model.evidence import Evidence, gather
from jaxsim.discover.model.fit import Problem
from jaxsim.discover.model.null_model import fit_null
from jaxsim.discover.name.candidates import rank_effects
from jaxsim.discover.rules import RULES
from jaxsim.effects import EFFECTS
from jaxsim.report.canvas import AFTER, BEFORE, FAINT, INK, RULE, Canvas, save_figure
from jaxsim.report.charts import label, ticks

ASKED = ("gamma_response", "intensity_offset", "incidence_cosine", "oren_nayar", "range_falloff", "beam_gain")
REACH = 0.45
"""Nats that the axes of the slope reach."""
DOTS = 2500
"""Drawn of each kind."""
SIZE, GAP, LEFT, TOP = 300, 70, 70, 46


def main(argv: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--seed", type=int, default=31)
    args = parser.parse_args(argv)
    enable_compilation_cache()
    with tempfile.TemporaryDirectory() as folder:
        case = Path(folder) / "case"
        make_case(case, effect="none", severity=1.0, seed=args.seed, nuisance="exact", simulator="noisy")
        comparison = read_comparison(case / "simulated", case / "measured")
    problems = {"as written": as_written(comparison), "as meant": as_meant(comparison)}
    details = {name: detail(one.ev) for name, one in problems.items()}
    for name, (x, y) in details.items():
        print(f"{name}: slope {slope(x, y):.2f} over {len(x)} rays")
    gains = {name: gains_of(one) for name, one in problems.items()}
    for name in ASKED:
        print(f"{name}: {gains['as written'][name]:.0f} nats as written, {gains['as meant'][name]:.0f} as meant")
    save_figure(args.out, "noisy_slope", slopes(details), words="Measured against simulated detail within surfaces")
    save_figure(args.out, "noisy_gains", bars(gains), words="What effects gain where nothing is missing")


def as_meant(comparison: Comparison) -> Problem:
    """The null as discover has it."""
    return NullModel.of(Division.of(comparison)).problem


def as_written(comparison: Comparison) -> Problem:
    """The null of the same rays, the simulated frames taken at their word."""
    division = Division.of(comparison)
    keep, scene = division.blocks_of(division.parts.find)
    given = jax.tree.map(jnp.asarray, comparison.scan)
    measured = jax.tree.map(jnp.asarray, comparison.measured)
    scan = with_planes(given)
    chosen = {"frame": division.blocks.frame[keep], "column": division.blocks.column[keep], "scene": scene}
    ev = gather(scan, measured, **chosen, given_rad=given.incidence_rad)
    return fit_null(scan, ev)


def detail(ev: Evidence) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Simulated and measured ln I over the mean of their surface, of compared rays."""
    counts = np.asarray(ev.compared)
    surface = np.asarray(ev.surface)[np.asarray(ev.strip)][counts]
    _, of = np.unique(surface, return_inverse=True)
    many = np.bincount(of)[of] >= 10
    sides = []
    for value in (ev.rays.log_intensity, ev.log_intensity):
        x = np.asarray(value, float)[counts]
        sides.append((x - (np.bincount(of, x) / np.bincount(of))[of])[many])
    return sides[0], sides[1]


def slope(x: Float[np.ndarray, " n"], y: Float[np.ndarray, " n"]) -> float:
    """Of least squares."""
    return float(x @ y / (x @ x))


def gains_of(problem: Problem) -> dict[str, float]:
    """Nats that each of ASKED gains on held-out scenes, all find scenes together."""
    return {one.effect.name: one.total for one in rank_effects(problem, [EFFECTS[name] for name in ASKED])}


def slopes(details: dict[str, tuple[np.ndarray, np.ndarray]]) -> Canvas:
    """One panel a kind: measured against simulated detail, its line, and the line of equality."""
    canvas = Canvas(LEFT + 2 * SIZE + GAP + 20, TOP + SIZE + 56)
    for k, (name, (x, y)) in enumerate(details.items()):
        left = LEFT + k * (SIZE + GAP)
        place = _Panel(left)
        colour = (BEFORE, AFTER)[k]
        canvas.text(left, 18, f"The simulator's detail {name}", size=14)
        canvas.text(left, 36, f"slope {slope(x, y):.2f} where the truth is 1", size=12, colour=colour)
        some = np.random.default_rng(0).permutation(len(x))[:DOTS]
        for a, b in zip(x[some], y[some], strict=True):
            if max(abs(a), abs(b)) < REACH:
                canvas.dot(*place(a, b), colour="#b9b9b9", radius=1.0)
        canvas.line([place(-REACH, -REACH), place(REACH, REACH)], colour=INK, width=1.0)
        end = min(REACH, REACH / max(slope(x, y), 1e-6))
        canvas.line([place(-end, -end * slope(x, y)), place(end, end * slope(x, y))], colour=colour, width=2.5)
        for value in ticks(-REACH, REACH, 4):
            a, b = place(value, -REACH)
            canvas.text(a, b + 16, label(value), anchor="middle", size=11, colour=FAINT)
            a, b = place(-REACH, value)
            canvas.text(a - 6, b + 4, label(value), anchor="end", size=11, colour=FAINT)
        corners = [(-REACH, -REACH), (REACH, -REACH), (REACH, REACH), (-REACH, REACH), (-REACH, -REACH)]
        canvas.line([place(*corner) for corner in corners], colour=RULE)
        below = TOP + SIZE + 38
        canvas.text(left + SIZE / 2, below, "simulated ln I over its surface's mean", anchor="middle", size=12)
    canvas.text(18, TOP + SIZE / 2, "measured ln I over its surface's mean", anchor="middle", size=12, turned=True)
    return canvas


class _Panel:
    """Where a value of the axes -REACH..REACH lies on the canvas."""

    def __init__(self, left: float):
        self.left = left

    def __call__(self, x: float, y: float) -> tuple[float, float]:
        return self.left + (x + REACH) / (2 * REACH) * SIZE, TOP + (REACH - y) / (2 * REACH) * SIZE


def bars(gains: dict[str, dict[str, float]]) -> Canvas:
    """Gains on a logarithmic scale from 1 nat on, two bars an effect, and the bar that naming asks for."""
    names: Sequence[str] = sorted(ASKED, key=lambda name: -gains["as written"][name])
    left, wide, high, step = 190, 470, 34, 40
    canvas = Canvas(left + wide + 50, 62 + step * len(names) + 40)
    most = np.ceil(np.log10(max(10.0, *(max(one.values()) for one in gains.values()))))

    def across(nats: float) -> float:
        return left + wide * float(np.log10(max(nats, 1.0))) / most

    canvas.text(left, 18, "Nothing is missing: what each effect gains all the same", size=14)
    for k, (name, colour) in enumerate(zip(gains, (BEFORE, AFTER), strict=True)):
        at = left + 240 * k
        canvas.area([(at, 30), (at + 12, 30), (at + 12, 42), (at, 42)], colour=colour)
        canvas.text(at + 18, 41, f"the simulator's frames {name}", size=12)
    top, bottom = 58, 58 + step * len(names)
    for power in range(int(most) + 1):
        x = across(10.0**power)
        canvas.line([(x, top), (x, bottom)], colour="#e6e6e6")
        canvas.text(x, bottom + 16, label(10**power), anchor="middle", size=11, colour=FAINT)
    for k, name in enumerate(names):
        canvas.text(left - 8, top + k * step + high / 2 + 6, name, anchor="end", size=12)
        for j, (kind, colour) in enumerate(zip(gains, (BEFORE, AFTER), strict=True)):
            y, nats = top + k * step + 4 + j * high / 2, gains[kind][name]
            end = max(across(nats), left + 1)
            canvas.area([(left, y), (end, y), (end, y + high / 2 - 2), (left, y + high / 2 - 2)], colour=colour)
            canvas.text(end + 5, y + 12, f"{round(nats)}", size=11, colour=FAINT)
    bar = across(RULES.bar_nats)
    canvas.line([(bar, top - 6), (bar, bottom)], colour=INK, width=1.5)
    canvas.text(left + wide / 2, bottom + 34, "nats on held-out scenes; the line is the bar that naming asks for",
                anchor="middle", size=12)  # fmt: skip
    return canvas


if __name__ == "__main__":
    main()
