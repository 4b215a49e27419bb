"""A closed formula as the file of an effect of one's own: read from a verdict.json, written as Python.

The verdict may be a stranger's, whose file must not say what is run. So a formula is parsed before it becomes code, and
refused where it holds anything but what `search` tries: sums, products, quotients, powers, a step, exp, log and sin of
its own variables and numbers.
"""

from __future__ import annotations

import ast
import keyword
import re
from collections.abc import Collection
from pathlib import Path

import numpy as np

from jaxsim.discover.law.search import LOGARITHMS, VARIABLES
from jaxsim.discover.verdict import ClosedLaw
from jaxsim.discover.verdict.names import NAMED
from jaxsim.effects import EFFECTS
from jaxsim.effects.check import RESERVED
from jaxsim.effects.learned import LIMITS
from jaxsim.files import parse_settings, placed, read_json, write_text

FUNCTIONS = ("exp", "log", "sin")
FITTED_NAMES = ("level", "size", "edge", "exponent", "scale", "period", "phase")
"""Names of what is fitted in a formula."""
LONGEST = 400
"""Characters: four times the longest of the grammar."""
MOST_VALUE = 1e12
"""Largest number that a stranger's law may hold, far beyond what a fit gives."""
_OPERATIONS = (ast.Add, ast.Sub, ast.Mult, ast.Div, ast.Pow)
_FOR_PEOPLE = re.compile(r"[\w .,+\-·*/^()≥π²³]*")
STAGE_OF = {"intensity": "receiver", "range": "ranging", "drop": "detection"}
EDITS = {"intensity": "brighten", "range": "misread", "drop": "lose"}
CHANGE_OF = {"intensity": "ln I, ln P += change", "range": "reading += change", "drop": "keep *= 1 - change"}


def check_law(law: ClosedLaw, variables: dict[str, str]) -> None:
    """Raises ValueError where a law cannot be one that `discover` wrote; `variables` are the names that covariates have
    in formulas."""
    if law.channel not in LIMITS:
        raise ValueError(f"channel {law.channel!r} is not known; known are {', '.join(LIMITS)}")
    for name in law.covariates:
        if name not in variables:
            raise ValueError(f"covariate {name!r} is in no formula; known are {', '.join(variables)}")
    for name in law.parameters:
        if name not in FITTED_NAMES:
            raise ValueError(f"parameter {name!r} is in no formula; known are {', '.join(FITTED_NAMES)}")
    names = [variables[name] for name in law.covariates]
    for name in names:
        low, high = law.limits.get(name, (1.0, 0.0))
        if not low <= high:
            raise ValueError(f"limits of {name} are missing, or do not rise")
    numbers = [n for parameter in law.parameters.values() for n in (parameter.value, parameter.low, parameter.high)]
    everything = np.abs([*numbers, *np.ravel([*law.limits.values()]), law.held_out_nats, law.share])
    if not (everything <= MOST_VALUE).all():
        raise ValueError(f"a number is beyond {MOST_VALUE:g}, or none")
    if not _FOR_PEOPLE.fullmatch(law.formula) or len(law.formula) > LONGEST:
        raise ValueError(f"formula {law.formula[:60]!r} holds what no formula does")
    check_expression(law.expression, [*names, *law.parameters, "pi"])


def check_expression(text: str, names: Collection[str]) -> None:
    """Raises ValueError for an expression that is not of the grammar, or of other names."""
    wrong = f"expression {text[:60]!r} is no formula of {', '.join(names)}"
    if len(text) > LONGEST:
        raise ValueError(f"{wrong}: it is too long")
    try:
        tree = ast.parse(text, mode="eval").body
    except (SyntaxError, ValueError, MemoryError, RecursionError) as error:
        raise ValueError(f"{wrong}: {error}") from None
    # Names of functions are looked at where they are called, operators where they stand.
    called = {id(node.func) for node in ast.walk(tree) if isinstance(node, ast.Call)}
    for node in ast.walk(tree):
        if isinstance(node, ast.expr) and id(node) not in called and not _allowed(node, names):
            raise ValueError(f"{wrong}: it holds {ast.unparse(node)[:40]!r}")


def _allowed(node: ast.expr, names: Collection[str]) -> bool:
    match node:
        case ast.BinOp(left=left, op=op):
            # A power of a mere number could take for ever.
            variable = any(isinstance(part, ast.Name) for part in ast.walk(left))
            return isinstance(op, _OPERATIONS) and (variable or not isinstance(op, ast.Pow))
        case ast.UnaryOp(op=ast.USub()):
            return True
        case ast.Compare(ops=[ast.GtE()]):
            return True
        case ast.Call(func=ast.Name(id=function), args=[_], keywords=[]):
            return function in FUNCTIONS
        case ast.Name(id=name):
            return name in names
        case ast.Constant(value=value):
            return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < MOST_VALUE
    return False


def read_law(path: Path | str) -> ClosedLaw:
    """The `law` of a verdict.json. Raises ValueError where the file is none, or holds no law, or one that is no formula
    of `discover`: it becomes code."""
    path = Path(path)
    if not path.is_file():
        raise ValueError(f"law: no file {path}; `jaxsim discover` writes one as OUT/verdict.json")
    content = read_json(path, by="law")
    if not isinstance(content, dict) or "law" not in content:
        raise ValueError(f"law: {path} is no verdict.json with a `law`; run `jaxsim discover` again")
    if content["law"] is None:
        raise ValueError(
            f"law: {path} holds no formula: nothing was learned there that is near one. If the sensor.json beside "
            "it has `learned`, that can be taken as it is (`jaxsim simulate --effects`)"
        )
    with placed(f"law: {path} holds a `law` that is none", then="run `jaxsim discover` again"):
        law = parse_settings(ClosedLaw, content["law"])
        check_law(law, {covariate: name for covariate, (name, _) in VARIABLES.items()})
        return law


def write_effect(law: ClosedLaw, path: Path | str, *, name: str | None = None) -> Path:
    """Writes a formula as a Python file that ends in `EFFECT`, an effect of this name, by default the file's, as those
    of `jaxsim/effects/catalogue/`. Variables stay within what was seen; fits begin at the formula's numbers.

    Raises ValueError where it is no name for a new effect, or no Python file, or the file is there.
    """
    path = Path(path)
    name = path.stem if name is None else name
    usable = name.isidentifier() and name.islower() and not keyword.iskeyword(name)
    if path.suffix != ".py" or not usable or name in (*EFFECTS, *RESERVED):
        raise ValueError(
            f"law: {name} in {path.name} is no name for an effect; give NAME.py, where NAME is lower-case words like "
            "rain_on_lens that the catalogue does not hold"
        )
    if path.exists():
        raise ValueError(f"law: {path} is there already; give another name, or remove it")
    return write_text(path, _source(law, name))


def _source(law: ClosedLaw, name: str) -> str:
    low, high = LIMITS[law.channel]
    edit = EDITS[law.channel]
    variables = "\n".join(_variable(covariate, law) for covariate in law.covariates)
    parameters = "\n".join(_parameter(law, key) for key in law.parameters)
    starts = {key: float(f"{parameter.value:.6g}") for key, parameter in law.parameters.items() if key != "level"}
    reported = tuple(dict.fromkeys(NAMED.get(covariate, covariate) for covariate in law.covariates))
    along = " and ".join(NAMED.get(covariate, covariate) for covariate in law.covariates)
    title = f"{law.channel} follows {along}"
    formula = f"{CHANGE_OF[law.channel]}; change = {law.expression}"
    signature = f"Residuals of {law.channel} along {along} follow the formula."
    source = f"jaxsim discover: {law.held_out_nats:.0f} nats held out, {100 * law.share:.0f} % of the curve"
    return f'''"""{law.formula}, of {law.channel}: found by `jaxsim discover`, in no catalogue."""

import jax.numpy as jnp

from jaxsim.effects.edits import {edit}
from jaxsim.effects.effect import Effect, Parameter
from jaxsim.effects.rays import READ, Array, Rays


def apply(p: dict[str, Array], rays: Rays) -> Rays:
    """Changes {law.channel} along {along}; beyond what was seen as at its ends."""
{variables}
    change = {_code(law)}
    change = jnp.clip(change, {low}, {high})
    return {edit}(rays, jnp.where(rays.hit, change, 0.0))


EFFECT = Effect(
    name={name!r},
    stage={STAGE_OF[law.channel]!r},
    title={title!r},
    formula={formula!r},
    parameters={{
{parameters}
    }},
    channels=({law.channel!r},),
    signature={signature!r},
    covariates={reported!r},
    look_alikes={{}},
    source={source!r},
    apply=apply,
    starts=({starts!r},),
)
'''


def _variable(covariate: str, law: ClosedLaw) -> str:
    name = VARIABLES[covariate][0]
    low, high = law.limits[name]
    read = f"READ[{covariate!r}](rays).astype(jnp.float32)"
    read = f"jnp.exp({read})" if covariate in LOGARITHMS else read
    return f"    {name} = jnp.clip({read}, {low:.6g}, {high:.6g})"


def _code(law: ClosedLaw) -> str:
    """The expression as JAX reads it."""
    # Where types are promoted strictly, a size multiplies no comparison: it is made 0 or 1.
    code = re.sub(r"\((\w+) >= edge\)", r"jnp.where(\1 >= edge, 1.0, 0.0)", law.expression)
    code = re.sub(r"\b(exp|log|sin|pi)\b", r"jnp.\1", code)
    for name in law.parameters:
        code = re.sub(rf"\b{name}\b", f'p["{name}"]', code)
    return code


def _parameter(law: ClosedLaw, name: str) -> str:
    """A row of the effect's parameters: without size and level it does nothing; other numbers stay near what was
    found."""
    parameter = law.parameters[name]
    half = (parameter.high - parameter.low) / 2
    scale = max(abs(parameter.value), half, 1e-6)
    if name in ("size", "level"):
        bounds, meaning = (0.0, -10 * scale, 10 * scale), f"{name} of the change"
    elif name == "phase":
        bounds, meaning = (parameter.value, parameter.value - 4.0, parameter.value + 4.0), name
        scale = 0.5
    else:
        # Its sign stays, for a period or a scale must not go through 0.
        bounds, meaning = (parameter.value, *sorted([parameter.value / 2, 2 * parameter.value])), name
        scale = abs(parameter.value) / 4
    # The gain takes a level of intensities up; a place of a step has no derivative.
    free = not (name == "edge" or (name == "level" and law.channel == "intensity"))
    numbers = ", ".join(f"{number:.6g}" for number in bounds)
    given = "" if free else ", to_fit=False"
    return f"        {name!r}: Parameter({numbers}, {parameter.unit!r}, {meaning!r}, scale={scale:.6g}{given}),"
