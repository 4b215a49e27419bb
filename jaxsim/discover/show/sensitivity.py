"""What these frames could show: of every effect the gain that naming could expect, once nuisances have had their share.

An answer of *none* says little where an effect could not have been seen. So each effect of the catalogue is put on the
very rays that were compared, at `Rules.testable_share` of a clearly visible size, and the expected difference of the
log-likelihoods with and without it is read off (twice the Kullback-Leibler divergence is the squared distance that
Fisher's information measures), the nuisances of the null being free to take up what they can: levels of classes,
streets, surfaces and strips, each frame's pose, the scale of ranges, the rates of loss. No measurement is drawn and
nothing is fitted: levels and poses follow in closed form (`model.random_effects`), at the weights of the null.

Effects whose readings lie outside of what the null calls possible (early returns, readings between two surfaces, empty
columns) count by how many such readings are expected. Those that round or cut off readings are read off the readings
themselves and are not asked here.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from jaxsim.discover.model.evidence import Evidence
from jaxsim.discover.model.fit import Problem, rays_for
from jaxsim.discover.model.gradients import effect_with_gradient
from jaxsim.discover.model.likelihood import log_reported
from jaxsim.discover.model.noise import DEGREES, MOST, Noise, reading_variance
from jaxsim.discover.model.parameters import fitted_parameters, to_z
from jaxsim.discover.model.random_effects import NormalEquations, of_own_surface, pose_shift, reflectance
from jaxsim.discover.name.look_alikes import visible
from jaxsim.discover.rules import RULES
from jaxsim.discover.scenes import clipped
from jaxsim.discover.verdict import Sensitivity
from jaxsim.effects import Effect
from jaxsim.effects.rays import Rays
from jaxsim.frame import Array
from jaxsim.products import einsum, matmul

OF_MEAN = (DEGREES + 1) / (DEGREES + 3)
"""Fisher's information of a Student-t in its location, over that of a normal of the same scale ..."""
OF_SCALE = DEGREES / (DEGREES + 3)
"""... and in its scale."""
TAKERS = {
    "intensity": "levels of classes, streets and surfaces",
    "range": "the frames' own poses and the noise of ranges",
    "drop": "usual rates of loss",
}
"""Nuisances by the channel in which they take up what an effect does."""
NEED = {
    "class": "scenes that hold its surfaces, many and at different angles and ranges",
    "step": "scenes with more depth steps",
    "speed": "drives at speed, with `speed` in grid.json",
    "time": "drives at speed, with `speed` in grid.json",
    "frame": "a longer recording, with `time` in grid.json: best of a sensor that stands still, for then surfaces keep "
    "their levels",
    "heading": "drives under several headings, with `heading` in grid.json",
    "rgb": "frames with colours",
    "azimuth": "scenes whose surfaces fill that azimuth",
    "incidence": "surfaces at more different angles",
    "range": "surfaces at more different ranges, near and far",
    "power": "darker and farther surfaces",
    "intensity": "darker and brighter surfaces",
    "row": "scenes whose surfaces fill more rows",
}
"""What to record, by the first covariate of an effect that stands here."""
HeldAndFree = tuple[Float[Array, " b"], Float[Array, " b"]]


def sensitivities(problem: Problem, effects: Iterable[Effect]) -> tuple[Sensitivity, ...]:
    """What the frames of a fitted null could show of each effect; least first."""
    answers = [sensitivity(problem, effect) for effect in effects if not effect.of_recording]
    return tuple(sorted(answers, key=lambda one: -(np.inf if one.times is None else one.times)))


def sensitivity(problem: Problem, effect: Effect) -> Sensitivity:
    """What the frames of a fitted null could show of one effect."""
    rows = problem.ev.rays.row.shape[-1]
    needed, asked = needed_nats(effect, rows), []
    for values in _sizes(effect, rows):
        held, free = expected_gains(problem, effect, values)
        times = _times(free, needed)
        asked.append((values, held, free, times))
        # Borders (a gate, a threshold) do nothing at half of a size: larger ones are asked until one could be seen.
        if held.sum() > RULES.bar_nats or (times or np.inf) <= 1:
            break
    else:
        values, held, free, times = max(asked, key=lambda one: one[2].sum())
    testable = times is not None and times <= 1
    taken = max(1 - float(free.sum() / held.sum()), 0.0) if held.sum() > 0 else 0.0
    return Sensitivity(
        name=effect.plain_name,
        size={name: _size(values[name] - p.neutral) for name, p in effect.parameters.items() if name in values},
        nats=float(clipped(free).sum()),
        needed=needed,
        taken=taken,
        times=times,
        testable=testable,
        why="" if testable else _why(effect, held, taken=taken),
        record="" if testable else _record(effect, len(free), times=times),
    )


def _sizes(effect: Effect, rows: int) -> list[dict[str, Any]]:
    """Values at which an effect is asked: at a share of what is clearly visible; for one that does nothing there, at
    what is, and where its fits begin."""
    clear = visible(effect, rows)
    # Half of what is clearly visible: an effect that is only seen at its largest was not looked for.
    share = RULES.testable_share
    part = {name: p.neutral + share * (np.asarray(clear[name]) - p.neutral) for name, p in effect.parameters.items()}
    return [part, clear, *effect.starts]


def expected_gains(
    problem: Problem, effect: Effect, values: Mapping[str, Any]
) -> tuple[Float[np.ndarray, " s"], Float[np.ndarray, " s"]]:
    """Expected gain of each scene, nats, with the effect's parameters at `values`: with the nuisances held where the
    null has them, and with them free."""
    before = rays_for(effect, problem.ev)
    z = to_z(effect, dict(values), before.row.shape[-1])
    # The programs of naming, which are compiled already.
    effected = effect_with_gradient(effect, z, before, scan=problem.scan)
    after = replace(before, **effected.fields, **effected.constant)
    held, free = _expected(problem.ev, before, after, noise=problem.noise, equations=problem.equations)
    return problem.ev.by_scene(np.asarray(held, float)), problem.ev.by_scene(np.asarray(free, float))


def needed_nats(effect: Effect, rows: int) -> float:
    """What all find scenes together must be expected to gain: the bar, and half a nat for each number that is fitted,
    which is what it loses on scenes that the fit has not seen."""
    return RULES.bar_nats + sum(int(np.prod(p.dims(rows))) for p in fitted_parameters(effect).values()) / 2


def could_pass(effect: Effect, by_scene: Float[np.ndarray, " s"], *, rows: int) -> bool:
    """Whether such gains could pass the bar and the test over scenes."""
    times = _times(by_scene, needed_nats(effect, rows))
    return times is not None and times <= 1


def _size(change: Any) -> float:
    return float(np.sqrt(np.mean(np.square(change))))


def _times(by_scene: Float[np.ndarray, " s"], needed: float) -> float | None:
    """The multiple of the size from which on naming could pass its bar and its test over scenes; None if never."""
    # Naming asks for the sum and for agreement: the weakest of the scenes that must agree decides.
    gained = np.where(np.abs(by_scene) > RULES.rounding_nats, by_scene, 0)
    order = np.sort(gained)[::-1]
    total = clipped(gained).sum()
    agree = min(len(order), RULES.agreeing_scenes) - 1
    few = min(len(order), RULES.decisive_scenes) - 1
    if total <= 0 or order[few] <= 0:
        return None
    # Gains grow with the square of a size. Many scenes must say something, or a few very much.
    many = 1 / order[agree] if order[agree] > 0 else np.inf
    least = max(needed / total, min(many, RULES.sudden_nats / order[few]))
    return float(np.sqrt(least))


def _why(effect: Effect, held: Float[np.ndarray, " s"], *, taken: float) -> str:
    if held.sum() < RULES.bar_nats:
        return "hardly a ray that was compared changes by it"
    if taken < RULES.taken_share:
        return "too few rays show it"
    takers = [words for channel, words in TAKERS.items() if channel in effect.channels]
    return f"{' and '.join(takers)} take up {100 * taken:.0f} % of what it does"


def _record(effect: Effect, scenes: int, *, times: float | None) -> str:
    advice = next((NEED[name] for name in effect.covariates if name in NEED), "other scenes")
    # What every scene adds is the same, so that gains grow with their number; hundreds of times as many are no advice.
    if times is None or times > RULES.testable_times:
        return advice
    return f"{advice}; or about {int(np.ceil(times**2 * scenes))} scenes like these to find with, in place of {scenes}"


@jax.jit
def _expected(ev: Evidence, before: Rays, after: Rays, *, noise: Noise, equations: NormalEquations) -> HeldAndFree:
    """Expected gain of each block, nats: with nuisances held where they are, and with them free."""
    parts = [
        _of_intensity(ev, before, after, equations=equations),
        _of_range(ev, before, after, equations=equations),
        _of_spread(ev, before, after, noise=noise),
        _of_loss(ev, before, after, noise=noise),
    ]
    # No nuisance takes up what the null has no place for.
    strange = RULES.strange_nats * _strange(before, after).sum((1, 2))
    strange = strange + RULES.empty_column_nats * _more(before.column_loss, after.column_loss).mean(-1).sum(-1)
    return sum(held for held, _ in parts) + strange, sum(free for _, free in parts) + strange


def _of_intensity(ev: Evidence, before: Rays, after: Rays, *, equations: NormalEquations) -> HeldAndFree:
    change = jnp.minimum(after.log_intensity, jnp.log(after.intensity_top)) - before.log_intensity
    change = jnp.where(ev.compared & after.hit, change, 0)
    weight = OF_MEAN * equations.intensity
    # All blocks are fitted: what is asked is what levels could take up.
    explained, cost = reflectance(ev, equations, jnp.ones(len(ev.scene)), residual=change)
    return _nats(weight, change).sum((1, 2)), _nats(weight, change - explained).sum((1, 2)) + OF_MEAN * cost


def _of_range(ev: Evidence, before: Rays, after: Rays, *, equations: NormalEquations) -> HeldAndFree:
    change = jnp.where(ev.smooth & after.hit, after.reading_m - before.reading_m, 0)
    near = of_own_surface(change, before.range_m)
    read = replace(ev, range_m=jnp.where(near, before.reading_m + change, before.reading_m))
    shift, cost = pose_shift(read, equations, before.reading_m, on=ev.smooth)
    weight = OF_MEAN * equations.range_
    other = jnp.where(near, 0, RULES.ray_nats).sum((1, 2))
    held = _nats(weight, jnp.where(near, change, 0)).sum((1, 2))
    free = _nats(weight, jnp.where(near, change - shift, 0)).sum((1, 2))
    return held + other, free + other + OF_MEAN * cost


def _nats(weight: Float[Array, "b c r"], off: Float[Array, "b c r"]) -> Float[Array, "b c r"]:
    return jnp.minimum(0.5 * weight * off**2, RULES.ray_nats)


def _of_spread(ev: Evidence, before: Rays, after: Rays, *, noise: Noise) -> HeldAndFree:
    usual = reading_variance(before, ev, noise)
    widened = jnp.where(ev.smooth, jnp.log(reading_variance(after, ev, noise) / usual), 0)
    # By the null's own scales the variance changes as their shares in it: of a direction, and of all ranges.
    aim = jnp.exp(2 * noise.aim) * jnp.sum(ev.pose[..., 3:] ** 2, axis=-1) / usual
    of_null = jnp.where(ev.smooth[..., None], jnp.stack([jnp.exp(2 * noise.range_) / usual, aim], axis=-1), 0)
    gram = einsum("bcri,bcrj->ij", of_null, of_null) + 1e-6 * jnp.eye(2)
    taken = matmul(of_null, jnp.linalg.solve(gram, einsum("bcri,bcr->i", of_null, widened)))
    # A normal of which ln variance is off by d loses d^2 / 4.
    weight = jnp.full_like(widened, OF_SCALE / 2)
    return _nats(weight, widened).sum((1, 2)), _nats(weight, widened - taken).sum((1, 2))


def _of_loss(ev: Evidence, before: Rays, after: Rays, *, noise: Noise) -> HeldAndFree:
    """Nats that single rays gain; each kind of place has a rate of its own, up to what the null allows."""
    usual = jnp.exp(log_reported(before, ev, noise))
    survival = jnp.where(after.hit, usual * jnp.exp(jnp.minimum(after.log_keep - before.log_keep, 0)), 0.0)
    lost = jnp.clip(1 - survival, 1e-6, 1 - 1e-6)
    counted = before.hit
    sky = counted & ~jnp.isfinite(before.beside_m).all(-1)
    stepped = counted & (ev.edge | ev.step) & ~sky
    smooth = counted & ~stepped & ~sky
    rate = 1 - jnp.clip(usual, 1e-6, 1 - 1e-6)
    held = rate
    for rays, name in ((smooth, "drop"), (stepped, "drop_edge"), (sky, None)):
        mean = jnp.where(rays, lost, 0).sum() / jnp.maximum(rays.sum(dtype=jnp.float32), 1)
        bound = 1.0 if name is None else 1 / (1 + jnp.exp(-MOST[name]))
        # It may fall below what the null has, and rise to the bound.
        held = jnp.where(rays, jnp.clip(mean, 1e-6, jnp.maximum(bound, rate)), held)
    return _bernoulli(lost, rate, counted), _bernoulli(lost, held, counted)


def _bernoulli(p: Float[Array, "b c r"], q: Float[Array, "b c r"], where: Bool[Array, "b c r"]) -> Float[Array, " b"]:
    nats = p * jnp.log(p / q) + (1 - p) * jnp.log((1 - p) / (1 - q))
    return jnp.where(where, jnp.minimum(nats, RULES.ray_nats), 0).sum((1, 2))


def _strange(before: Rays, after: Rays) -> Float[Array, "b c r"]:
    """Readings to expect of each ray that the null has no place for."""
    apart = jnp.abs(after.between_m - after.reading_m) > RULES.other_surface_m
    between = jnp.where(apart, _more(before.between, after.between), 0)
    beyond = jnp.abs(after.ghost_m - after.reading_m) > RULES.other_surface_m
    ghost = jnp.where(beyond, _more(before.ghost, after.ghost), 0)
    return between + ghost + _more(before.clutter, after.clutter)


def _more(before: Array, after: Array) -> Array:
    return jnp.maximum(after - before, 0)
