"""What an effect must keep to, so that it can be fitted, simulated and compared with others.

The catalogue's effects are held to the same by tests; one of one's own is checked when it is loaded. They are tried on
rays of `small_street`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from keyword import iskeyword
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxsim.effects.catalogue import EFFECTS
from jaxsim.effects.chain import apply_law
from jaxsim.effects.effect import CHANNELS, COVARIATE_NAMES, STAGES, Effect, Parameter, check_bounds, check_names
from jaxsim.effects.origin import OwnEffect
from jaxsim.effects.places import all_rays
from jaxsim.effects.rays import Rays, Scan
from jaxsim.effects.street import small_street
from jaxsim.files import first_line

RESERVED = ("new", "check", "nothing")
"""Names that commands and the null have."""
CHANGED = {
    **dict.fromkeys(("log_intensity", "intensity_top"), "intensity"),
    **dict.fromkeys(("reading_m", "noise_m", "between", "ghost"), "range"),
    **dict.fromkeys(("log_keep", "column_loss"), "drop"),
}
"""The channel in which a field of rays shows."""
IDLE = {"between_m": "between", "ghost_m": "ghost"}
"""What means nothing where a probability is 0."""
AIM = ("turned_rad", "moved_m")
CATALOGUE_ALONE = {
    **dict.fromkeys(
        ("clutter", "clutter_power", "clutter_scale_m", "clutter_from_m", "clutter_log_intensity"),
        "early false returns are a part of the likelihood that fog_backscatter, precipitation_clutter and "
        "interference alone have",
    ),
    **dict.fromkeys(
        ("intensity_step", "range_step_m"),
        "steps are read off the readings, for intensity_quantization and range_quantization alone",
    ),
}
"""Fields that effects of the catalogue alone may change, and why; words of an error."""
SILENT = ("log_power", *IDLE)
"""Fields that show in no channel by themselves."""
NEUTRAL = 1e-6
"""Relative and absolute change of a ray that counts as none."""


def check_effect(effect: Effect) -> None:
    """Raises ValueError with what an effect gets wrong: its texts and parameters, then its `apply` on rays of a small
    street, at neutral, at its bounds, at its starts and at a visible size."""
    try:
        check_row(effect)
        check_apply(effect)
    except ValueError as error:
        raise ValueError(f"{effect.name}: {str(error).removeprefix(f'{effect.name}: ')}") from error


def check_row(effect: Effect) -> None:
    """Raises ValueError for a name, text, channel, covariate or parameter that cannot be right."""
    name = effect.name
    if not may_be_called(name):
        raise ValueError(f"the name is {name!r}; give lower-case words like rain_on_lens, not {', '.join(RESERVED)}")
    if name in EFFECTS and not isinstance(EFFECTS[name], OwnEffect):
        raise ValueError("the catalogue has an effect of this name (`jaxsim effects` lists it); choose another")
    if effect.stage not in STAGES:
        raise ValueError(f"the stage is {effect.stage!r}; it must be one of {', '.join(STAGES)}")
    if (effect.stage == "geometry") != (effect.casts > 0):
        raise ValueError(
            f"stage {effect.stage} with casts={effect.casts}; stage geometry is for what turns or moves rays, with "
            "casts=2 or more, and casts for that stage alone"
        )
    for text in ("title", "formula"):
        if not isinstance(getattr(effect, text), str) or not getattr(effect, text).strip():
            raise ValueError(f"its {text} is empty; say in a line what it is")
    for kind, given, known in (
        ("channels", effect.channels, CHANNELS),
        ("covariates", effect.covariates, COVARIATE_NAMES),
    ):
        # A tuple of one is often written as a string.
        unknown = [given] if isinstance(given, str) else [one for one in given if one not in known]
        if unknown or (kind == "channels" and not given):
            raise ValueError(f"{kind} are {given!r}; give a tuple of {', '.join(known)}")
    if not effect.parameters or not all(isinstance(p, Parameter) for p in effect.parameters.values()):
        raise ValueError("parameters must be a dict of one Parameter or more by name")
    if not any(p.to_fit for p in effect.parameters.values()):
        raise ValueError("no parameter is fitted; let one be, for nothing else can tell that the effect is there")
    for key, p in effect.parameters.items():
        _check_parameter(key, p)
    for start in effect.starts:
        check_names(effect, start)
        for key, value in start.items():
            check_bounds(effect, key, value)


def may_be_called(name: Any) -> bool:
    """Whether an effect may have a name, if it is not taken."""
    lower = isinstance(name, str) and name.isascii() and name.isidentifier() and name.islower()
    return lower and not iskeyword(name) and name not in RESERVED


def _check_parameter(name: str, p: Parameter) -> None:
    if not all(math.isfinite(value) for value in (p.neutral, p.low, p.high, p.scale)):
        raise ValueError(
            f"{name} has neutral {p.neutral}, bounds {p.low}..{p.high}, scale {p.scale}; all must be finite"
        )
    if not p.low < p.high:
        raise ValueError(f"{name} has bounds {p.low:g}..{p.high:g}; the lower must come first")
    if not p.low <= p.neutral <= p.high:
        raise ValueError(f"{name} is {p.neutral:g} at neutral, outside its bounds {p.low:g}..{p.high:g}; widen them")
    if not p.scale > 0:
        raise ValueError(f"{name} has scale {p.scale:g}; give a typical distance from neutral, above 0")
    if p.shape not in ("scalar", "row", "class"):
        raise ValueError(f"{name} has shape {p.shape!r}; it must be scalar, row (one a beam) or class")


def check_apply(effect: Effect) -> None:
    """Raises ValueError for an `apply` that does something at neutral, changes shapes, gives NaN, slopes that are not
    finite or none at all, gives other rays each time, or changes what the effect does not declare."""
    scan, before = _street()
    rows = scan.range_m.shape[1]
    touched: set[str] = set()
    climbed: set[str] = set()
    for setting, given in trial_values(effect):
        values = effect.values(given, rows)
        after = _applied(effect, values, before, setting=setting)
        _check_fields(effect, before, after, setting=setting)
        _check_same(after, _applied(effect, values, before, setting=setting), setting=setting)
        climbed |= _slopes(effect, values, before, scan=scan, setting=setting)
        if not given:
            _check_neutral(before, after)
            continue
        touched |= _touched(effect, before, after, scan=scan, values=values)
    # The fit climbs the declared channels alone: what is changed elsewhere would never be held against the data.
    undeclared = sorted(touched - set(effect.channels))
    if undeclared:
        raise ValueError(
            f"apply changes the channel {', '.join(undeclared)}, and channels are {effect.channels}; declare it, or "
            "leave it alone"
        )
    idle = [] if effect.casts else sorted(set(effect.channels) - touched)
    if idle:
        raise ValueError(f"channels name {', '.join(idle)}, which apply never changes; leave it out")
    level = [name for name, p in effect.parameters.items() if p.to_fit and name not in climbed]
    if level:
        raise ValueError(
            f"apply's derivative in {level[0]} is 0 at all that was tried, so no fit moves it; rounding and comparing "
            "have none: make the border soft, or say to_fit=False"
        )


@cache
def _street() -> tuple[Scan, Rays]:
    """Rays of every kind on a small street: seen head on and edge on, bright and next to dark, hit and lost."""
    scan = small_street(frames=2, rows=8, columns=60)
    rays = all_rays(scan)
    rng = np.random.default_rng(0)
    angle = np.where(rays.hit, rng.uniform(0, np.pi / 2, rays.hit.shape), 0).astype(np.float32)
    # Head on and edge on exactly, where tangents and logarithms of cosines end.
    angle[:, 2, ::2], angle[:, 3, ::2] = 0, np.pi / 2
    dark = np.where(rng.random(angle.shape) < 0.2, np.log(1e-4), np.asarray(rays.log_intensity)).astype(np.float32)
    more = jax.device_put(dark) - rays.log_intensity
    return scan, replace(
        rays,
        incidence_rad=jax.device_put(angle),
        log_intensity=rays.log_intensity + more,
        log_power=rays.log_power + more,
    )


def trial_values(effect: Effect) -> list[tuple[str, dict[str, float]]]:
    """Values that an effect must bear, each with what errors call it: neutral first."""
    parameters = effect.parameters
    seen = {
        name: min(max(p.neutral + p.scale if p.neutral + p.scale <= p.high else p.neutral - p.scale, p.low), p.high)
        for name, p in parameters.items()
    }
    # Bounds too: fits stop there, and must find numbers.
    many = [seen, {n: p.low for n, p in parameters.items()}, {n: p.high for n, p in parameters.items()}]
    many += [dict(start) for start in effect.starts]
    return [
        ("neutral parameters", {}),
        *((", ".join(f"{name} = {value:g}" for name, value in given.items()), given) for given in many),
    ]


def _applied(effect: Effect, values: dict[str, Any], rays: Rays, *, setting: str) -> Rays:
    try:
        after = effect.apply(values, rays)
    # What apply does is its author's; whatever it raises is to be told.
    except Exception as error:
        raise ValueError(f"apply raised {type(error).__name__} at {setting}: {error}") from error
    if not isinstance(after, Rays):
        raise ValueError(f"apply gives {type(after).__name__} at {setting}; it must give Rays: end with `return ...`")
    return after


def _check_fields(effect: Effect, before: Rays, after: Rays, *, setting: str) -> None:
    """Shapes, dtypes, numbers that are none, probabilities, and fields that are not an effect's to change."""
    allowed = {*CHANGED, *SILENT, *(AIM if effect.casts else ())}
    for name, was in _fields(before).items():
        now = getattr(after, name)
        if np.shape(now) != was.shape or getattr(now, "dtype", None) != was.dtype:
            raise ValueError(
                f"apply makes {name} {_kind(now)} at {setting}, it was {_kind(was)}; keep shape and dtype (a number "
                "for each ray, or jnp.broadcast_to)"
            )
        value, old = np.asarray(now), np.asarray(was)
        if np.isnan(value.astype(float)).any():
            raise ValueError(
                f"apply gives NaN in {name} at {setting}; keep logarithms, roots and quotients away from 0 "
                "(jaxsim/effects/edits.py has safe functions)"
            )
        if name in allowed or np.array_equal(value, old):
            continue
        if name in CATALOGUE_ALONE:
            raise ValueError(f"apply changes {name} at {setting}; {CATALOGUE_ALONE[name]}: put it into the catalogue")
        if name in AIM:
            raise ValueError(f"apply changes {name} at {setting} with casts=0; say stage='geometry' and casts=2")
        raise ValueError(
            f"apply changes {name} at {setting}, which is the ray itself or what it meets; change "
            f"{', '.join(CHANGED)}, or turn and move rays (edits.displace, with stage='geometry' and casts=2)"
        )
    if (np.asarray(after.log_keep) > NEUTRAL).any():
        raise ValueError(f"apply makes log_keep more than 0 at {setting}; it is the logarithm of a probability")
    for name in ("column_loss", "between", "ghost"):
        value = np.asarray(getattr(after, name))
        if not ((value >= 0) & (value <= 1)).all():
            raise ValueError(f"apply makes {name} {value.min():g}..{value.max():g} at {setting}; it is a probability")


def _check_neutral(before: Rays, after: Rays) -> None:
    for name, was in _fields(before).items():
        now = np.asarray(getattr(after, name))
        if name in IDLE and (np.asarray(getattr(after, IDLE[name])) == 0).all():
            continue
        if not np.allclose(now, np.asarray(was), rtol=NEUTRAL, atol=NEUTRAL):
            most = np.nanmax(np.abs(now.astype(float) - np.asarray(was, float)))
            raise ValueError(
                f"apply changes {name} by up to {most:.3g} at neutral parameters; there rays must come back as they "
                "were: correct `neutral` or the formula"
            )


def _check_same(first: Rays, second: Rays, *, setting: str) -> None:
    for name, value in _fields(first).items():
        if not np.array_equal(value, np.asarray(getattr(second, name))):
            raise ValueError(
                f"apply gives another {name} the second time at {setting}; draw nothing in it: give probabilities and "
                "noise, which the simulation draws"
            )


def _slopes(effect: Effect, values: dict[str, Any], before: Rays, *, scan: Scan, setting: str) -> set[str]:
    """The parameters that move any ray. Raises ValueError for derivatives that are not there, or not finite."""

    def total(p: dict[str, Any]) -> Any:
        floats = (x for x in jax.tree.leaves(apply_law(effect, p, before, scan=scan)) if x.dtype == jnp.float32)
        return sum((jnp.where(jnp.abs(x) < 1e9, x, 0.0).sum() for x in floats), jnp.float32(0))

    try:
        # Fits compile it, to which an `if` on a parameter is one on an unknown number.
        jax.eval_shape(total, values)
        slopes = jax.grad(total)(values)
    except Exception as error:
        raise ValueError(
            f"apply has no derivative at {setting}: {type(error).__name__}: {first_line(error)}; write it with "
            "jax.numpy, without `if` on arrays or parameters (jnp.where)"
        ) from error
    for name, slope in slopes.items():
        if not jnp.isfinite(slope).all():
            raise ValueError(
                f"apply's derivative in {name} is not finite at {setting}; keep logarithms, roots and quotients away "
                "from 0 on every ray, also where jnp.where does not choose them"
            )
    return {name for name, slope in slopes.items() if jnp.any(slope != 0)}


def _touched(effect: Effect, before: Rays, after: Rays, *, scan: Scan, values: Mapping[str, Any]) -> set[str]:
    """The channels that an effect changes."""
    met = apply_law(effect, dict(values), before, scan=scan) if effect.casts else after
    channels = {
        channel
        for name, channel in CHANGED.items()
        if not np.array_equal(np.asarray(getattr(met, name)), np.asarray(getattr(before, name)))
    }
    return channels | ({"drop"} if not np.array_equal(np.asarray(met.hit), np.asarray(before.hit)) else set())


def _fields(rays: Rays) -> dict[str, Any]:
    return {name: value for name, value in vars(rays).items() if value is not None}


def _kind(value: Any) -> str:
    return f"{np.shape(value)} {getattr(value, 'dtype', type(value).__name__)}"
