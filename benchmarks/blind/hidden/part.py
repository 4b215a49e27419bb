"""A hidden effect that acts in a part alone: from a moment on, under a tag, in some scenes, or in a sector."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from benchmarks.blind.hidden.frames import Grid, Hook, Moment, RayHook, Rays, State
from benchmarks.blind.hidden.plan import Plan

KINDS = ("everywhere", "time", "tag", "scenes", "sector")
TAGS = ("night", "rain", "wet")
"""Facts of frames, each of about half of the scenes; at most one has to do with the effect."""


@dataclass(frozen=True)
class Part:
    """Where an effect acts."""

    kind: str
    scenes: tuple[int, ...]
    azimuth: tuple[float, float] | None
    """From and to, rad, counter-clockwise; None for all around."""
    tag: str | None
    tags: tuple[tuple[str, ...], ...]
    """Of each scene."""

    def holds(self, grid: Grid, moment: Moment) -> np.ndarray:
        """(1, columns): where the effect acts in a frame."""
        inside = np.full((1, len(grid.azimuth)), moment.scene in self.scenes)
        if self.azimuth:
            low, high = self.azimuth
            inside &= (np.mod(grid.azimuth - low, 2 * np.pi) <= np.mod(high - low, 2 * np.pi))[None]
        return inside


def draw_part(kind: str, rng: np.random.Generator, scenes: int, grid: Grid) -> Part:
    """Half of the scenes (an eighth more or less), or a fifth to a third of the columns.

    Raises:
        ValueError: the kind is not known.
    """
    if kind not in KINDS:
        raise ValueError(f"a part is {kind!r}; choose one of {', '.join(KINDS)}")
    few, many = max(1, scenes * 3 // 8), max(1, scenes * 5 // 8)
    halves = [set(rng.permutation(scenes)[: rng.integers(few, many + 1)].tolist()) for _ in TAGS]
    tags = tuple(tuple(tag for tag, half in zip(TAGS, halves, strict=True) if s in half) for s in range(scenes))
    count = int(rng.integers(few, many + 1))
    everyone = tuple(range(scenes))
    if kind == "time":
        return Part(kind, everyone[-count:], None, None, tags)
    if kind == "tag":
        return Part(kind, tuple(sorted(halves[0])), None, TAGS[0], tags)
    if kind == "scenes":
        return Part(kind, tuple(sorted(rng.permutation(scenes)[:count].tolist())), None, None, tags)
    if kind == "everywhere":
        return Part(kind, everyone, None, None, tags)
    span = 2 * np.pi if grid.full_turn else grid.azimuth[0] - grid.azimuth[-1]
    width = span * rng.uniform(0.2, 0.33)
    low = float(rng.uniform(-np.pi, np.pi) if grid.full_turn else rng.uniform(-span / 2, span / 2 - width))
    return Part(kind, everyone, (low, low + float(width)), None, tags)


def confined(plan: Plan, part: Part) -> Plan:
    """The plan, acting in the part alone."""
    rays = [_ray_hook(hook, part) for hook in plan.rays]
    return Plan(plan.parameters, rays, [(stage, _hook(hook, part)) for stage, hook in plan.hooks])


def _ray_hook(hook: RayHook, part: Part) -> RayHook:
    def act(rays: Rays, grid: Grid, moment: Moment) -> None:
        inside = part.holds(grid, moment)[..., None]
        trial = Rays(rays.direction.copy(), rays.offset.copy())
        hook(trial, grid, moment)
        rays.direction = np.where(inside, trial.direction, rays.direction)
        rays.offset = np.where(inside, trial.offset, rays.offset)

    return act


def _hook(hook: Hook, part: Part) -> Hook:
    def act(state: State) -> None:
        inside = part.holds(state.grid, state.moment)
        rasters = [f.name for f in fields(State) if _is_raster(getattr(state, f.name), state.hit.shape)]
        trial = replace(state, early=list(state.early), **{name: getattr(state, name).copy() for name in rasters})
        hook(trial)
        if trial.round_m != state.round_m:
            raise ValueError("rounding cannot be hidden in a part of the rays; hide another effect")
        for name in rasters:
            now, then = getattr(trial, name), getattr(state, name)
            setattr(state, name, np.where(inside if now.ndim == 2 else inside[..., None], now, then))
        for probability, early_m, early_i in trial.early[len(state.early) :]:
            state.early.append((np.where(inside, probability, 0.0), early_m, early_i))
        state.outshine = trial.outshine

    return act


def _is_raster(value: object, shape: Sequence[int]) -> bool:
    return isinstance(value, np.ndarray) and value.shape[:2] == tuple(shape)
