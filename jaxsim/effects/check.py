"""What an effect must keep to, so that it can be fitted, simulated and compared with others.

The catalogue's effects are held to the same by tests; one of one's own is checked when it is loaded.
"""

from __future__ import annotations

import math

from jaxsim.effects.catalogue import EFFECTS
from jaxsim.effects.check_apply import check_apply
from jaxsim.effects.effect import CHANNELS, COVARIATES, STAGES, Effect, Parameter, check_bounds, check_names
from jaxsim.effects.origin import OwnEffect

RESERVED = ("new", "check", "nothing")
"""Names that commands and the null have."""


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
    if not (isinstance(name, str) and name.isidentifier() and name.islower()) or name in RESERVED:
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
    for kind, given, known in (("channels", effect.channels, CHANNELS), ("covariates", effect.covariates, COVARIATES)):
        # A tuple of one is often written as a string.
        unknown = [given] if isinstance(given, str) else [one for one in given if one not in known]
        if unknown or (kind == "channels" and not given):
            raise ValueError(f"{kind} are {given!r}; give a tuple of {', '.join(known)}")
    if not effect.parameters or not all(isinstance(p, Parameter) for p in effect.parameters.values()):
        raise ValueError("parameters must be a dict of one Parameter or more by name")
    if not any(p.fitted for p in effect.parameters.values()):
        raise ValueError("no parameter is fitted; let one be, for nothing else can tell that the effect is there")
    for key, p in effect.parameters.items():
        _check_parameter(key, p)
    for start in effect.starts:
        check_names(effect, start)
        for key, value in start.items():
            check_bounds(effect, key, value)


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
