"""What an effect of one's own looks like: each catalogue effect fitted to its expectation, ray by ray.

The cheap form of the question that naming asks of data: nothing is drawn, and no nuisance but the levels of classes is
fitted. Both effects' changes of a ray are taken in typical standard deviations (`TYPICAL_SD`), and a look-alike
reproduces most of the sum of their squares: about the share of a gain in likelihood that it would take over
(`Rules.alike_share`).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy.optimize import minimize

from jaxsim.discover.model.noise_levels import FINEST
from jaxsim.discover.model.parameters import prior, ravel, restorer, to_values, to_z
from jaxsim.discover.rules import RULES
from jaxsim.effects import EFFECTS, Effect
from jaxsim.effects.chain import apply_law
from jaxsim.effects.check import trial_values
from jaxsim.effects.origin import LookAlike, OwnEffect
from jaxsim.effects.rays import Rays, Scan
from jaxsim.frame import CLASSES, Array

TYPICAL_SD = {
    "log_intensity": RULES.typical_nats,
    "reading_m": RULES.typical_m,
    "noise_m": RULES.typical_m,
    "keep": RULES.typical_probability,
    "between": RULES.typical_probability,
    "ghost": RULES.typical_probability,
    "clutter": RULES.typical_probability,
}
"""Standard deviations of a ray, in which a change is counted: nats, m, m, and probabilities."""
MOST_RAYS = 5000
"""Compared at most."""
IMITATION_STEPS = 30
"""Steps of the optimiser: the share in common needs two digits, no more."""
PART_BINS = 12
"""Bins of a covariate along which two effects may part."""


def with_look_alikes(effects: Iterable[Effect], rays: Rays, scan: Scan) -> list[Effect]:
    """The effects, those of one's own with their look-alikes on these rays (blocks, columns, rows) of the scan."""
    return [described(effect, rays, scan) if isinstance(effect, OwnEffect) else effect for effect in effects]


def described(effect: OwnEffect, rays: Rays, scan: Scan) -> OwnEffect:
    """The effect with its look-alikes on these rays, beside those that its author names."""
    alike = look_alikes(effect, rays, scan)
    return replace(effect, alike=alike, look_alikes={like.name: like.apart for like in alike} | effect.look_alikes)


def look_alikes(effect: Effect, rays: Rays, scan: Scan) -> tuple[LookAlike, ...]:
    """The catalogue's effects of its channels that reproduce most of what `effect` does at a visible size, nearest
    first."""
    # Every so many blocks and columns, so that MOST_RAYS are left or fewer.
    step = int(np.ceil(np.sqrt(rays.row.size / MOST_RAYS)))
    rays = jax.tree.map(lambda leaf: leaf[::step, ::step] if leaf.ndim >= 3 else leaf, rays)
    # At a visible size: near neutral any two effects are as good as linear, and more of them look alike.
    change = np.asarray(_change(effect, visible(effect, scan.range_m.shape[1]), rays, scan=scan))
    size = float(np.square(change).sum())
    others = [known for known in EFFECTS.values() if not isinstance(known, OwnEffect) and known.name not in FINEST]
    alike: list[LookAlike] = []
    for other in others if size > 0 else ():
        if not {*other.channels} & {*effect.channels}:
            continue
        remainder = change - _imitated(other, change, rays, scan=scan)
        # The more two effects share, the less of the sum of squares is left.
        share = 1 - float(np.square(remainder).sum()) / size
        if share >= RULES.alike_share:
            alike.append(LookAlike(other.name, share, _apart(remainder, rays, share=share)))
    return tuple(sorted(alike, key=lambda like: -like.share))


def visible(effect: Effect, rows: int) -> dict[str, Any]:
    """Parameters at which an effect is clearly seen; numbers of beams and classes differ from one another."""
    rng = np.random.default_rng(0)
    values: dict[str, Any] = dict(trial_values(effect)[1][1])
    for name, p in effect.parameters.items():
        if p.shape != "scalar":
            # A vector alike for all beams would look like a single number of another effect.
            values[name] = np.clip(p.neutral + p.scale * rng.standard_normal(p.dims(rows)), p.low, p.high)
    return values


def _change(effect: Effect, values: dict[str, Any], rays: Rays, *, scan: Scan) -> Float[Array, "k n"]:
    """What an effect changes of each ray's expectation, in standard deviations; a class's mean intensity is free."""
    after = apply_law(effect, effect.values(values, scan.range_m.shape[1]), rays, scan=scan)
    return _difference(_expected(after), _expected(rays), rays)


def _expected(rays: Rays) -> dict[str, Array]:
    """What of each ray the channels show, by the names of TYPICAL_SD."""
    keep = jnp.where(rays.hit, jnp.exp(rays.log_keep) * (1 - rays.column_loss), 0.0)
    # Above saturation nothing differs.
    bright = jnp.minimum(rays.log_intensity, jnp.log(rays.intensity_top))
    return {"log_intensity": bright, "keep": keep} | {
        name: getattr(rays, name) for name in ("reading_m", "noise_m", "between", "ghost", "clutter")
    }


def _difference(after: dict[str, Array], before: dict[str, Array], rays: Rays) -> Float[Array, "k n"]:
    hit = rays.hit.ravel()
    parts = []
    for name, sd in TYPICAL_SD.items():
        change = (after[name] - before[name]).ravel() / sd
        # Bounded, and still with a slope from afar.
        change = jnp.where(hit, RULES.most_changed_sd * jnp.tanh(change / RULES.most_changed_sd), 0.0)
        if name == "log_intensity":
            # A class's reflectance is a nuisance: an effect that shifts whole classes alone shows nothing.
            kind = rays.semantic.ravel()
            count = jnp.zeros(CLASSES, jnp.float32).at[kind].add(hit.astype(jnp.float32))
            mean = jnp.zeros(CLASSES, jnp.float32).at[kind].add(change) / jnp.maximum(count, 1.0)
            change = jnp.where(hit, change - mean[kind], 0.0)
        parts.append(change)
    return jnp.stack(parts)


def _imitated(other: Effect, changed: np.ndarray, rays: Rays, *, scan: Scan) -> np.ndarray:
    """The change by `other` that is nearest to the own one, by least squares within its bounds."""
    rows = scan.range_m.shape[1]
    restore = restorer(to_z(other, {}, rows))
    target = jax.device_put(changed.astype(np.float32))

    def slope(x: Float[np.ndarray, " n"]) -> tuple[tuple[Array, Array], dict[str, Array]]:
        return _slope(restore(x), target, rays, effect=other, scan=scan)

    def loss(x: Float[np.ndarray, " n"]) -> tuple[float, Float[np.ndarray, " n"]]:
        (value, _), by_z = slope(x)
        gradient = ravel(by_z)
        finite = np.isfinite(float(value)) and np.isfinite(gradient).all()
        return (float(value), gradient) if finite else (1e6, np.zeros_like(x))

    limits = prior(other, rows)
    bounds = [*zip(limits.low, limits.high, strict=True)]
    starts = [ravel(to_z(other, start, rows)) for start in ({}, trial_values(other)[1][1], *other.starts)]
    # At neutral some have no slope; from afar some have another basin.
    begin = [starts[0], min(starts[1:], key=lambda x: loss(x)[0])]
    fits = [
        minimize(loss, x, jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": IMITATION_STEPS})
        for x in begin
    ]
    best = min(fits, key=lambda fit: float(fit.fun))
    return np.asarray(slope(best.x)[0][1])


# A program that runs a hundred times on few rays: LLVM would work far longer than it. One serves all effects of one's
# own, as what they change is its argument.
@partial(jax.jit, static_argnames="effect", compiler_options={"xla_backend_optimization_level": 0})
def _slope(
    z: dict[str, Array], target: Float[Array, "k n"], rays: Rays, *, effect: Effect, scan: Scan
) -> tuple[tuple[Array, Array], dict[str, Array]]:
    """The square of what `effect` at z leaves of `target`, as a share of it, with the effect's change; and its
    gradient."""

    def both(z: dict[str, Array]) -> tuple[Array, Array]:
        change = _change(effect, to_values(effect, z), rays, scan=scan)
        return jnp.square(target - change).sum() / jnp.square(target).sum(), change

    return jax.value_and_grad(both, has_aux=True)(z)


def _apart(remainder: np.ndarray, rays: Rays, *, share: float) -> str:
    """The covariate that what one effect cannot imitate of the other depends on most, in words."""
    if share > RULES.same_share:
        return "no frames like these can; it takes other streets, or the sensor's maker"
    part = remainder[int(np.square(remainder).sum(1).argmax())]
    hit = np.asarray(rays.hit).ravel()
    of = {
        "range": rays.range_m,
        "incidence": rays.incidence_rad,
        "row": rays.row,
        "azimuth": rays.azimuth_rad,
        "class": rays.semantic,
        "intensity": rays.met_log_intensity,
    }
    explained = {name: _between(part[hit], np.asarray(x).ravel()[hit]) for name, x in of.items()}
    name, most = max(explained.items(), key=lambda pair: pair[1])
    return f"frames that span more {name}: on it depends {100 * most:.0f} % of what is left of the two's difference"


def _between(value: np.ndarray, covariate: np.ndarray) -> float:
    """Share of the variance that lies between bins of a covariate."""
    edges = np.unique(np.quantile(covariate, np.linspace(0, 1, PART_BINS + 1)[1:-1]))
    group = np.searchsorted(edges, covariate, side="right")
    count = np.maximum(np.bincount(group), 1)
    mean = np.bincount(group, value) / count
    return float((count * np.square(mean - value.mean())).sum() / max(np.square(value - value.mean()).sum(), 1e-12))
