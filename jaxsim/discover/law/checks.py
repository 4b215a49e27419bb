"""What a formula of a verdict.json may be before it becomes code: a stranger's file must not say what is run.

`source.write_effect` writes the formula into a Python file. So it is parsed here, and refused where it holds anything
but what `grammar` has: sums, products, quotients, powers, a step, exp, log and sin of its own variables and numbers.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Collection

import numpy as np

from jaxsim.discover.verdict import ClosedLaw
from jaxsim.effects.learned import LIMITS

FUNCTIONS = ("exp", "log", "sin")
NUMBERS = ("level", "size", "edge", "exponent", "scale", "period", "phase")
"""Names of what is fitted in a formula."""
LONGEST = 400
"""Characters: four times the longest of the grammar."""
MOST = 1e12
_OPERATIONS = (ast.Add, ast.Sub, ast.Mult, ast.Div, ast.Pow)
_FOR_PEOPLE = re.compile(r"[\w .,+\-·*/^()≥π²³]*")


def check_law(law: ClosedLaw, variables: dict[str, str]) -> None:
    """Raises ValueError where a law cannot be one that `discover` wrote; `variables` are the names that covariates have
    in formulas."""
    if law.channel not in LIMITS:
        raise ValueError(f"channel {law.channel!r} is not known; known are {', '.join(LIMITS)}")
    for name in law.covariates:
        if name not in variables:
            raise ValueError(f"covariate {name!r} is in no formula; known are {', '.join(variables)}")
    for name in law.parameters:
        if name not in NUMBERS:
            raise ValueError(f"parameter {name!r} is in no formula; known are {', '.join(NUMBERS)}")
    names = [variables[name] for name in law.covariates]
    for name in names:
        low, high = law.limits.get(name, (1.0, 0.0))
        if not low <= high:
            raise ValueError(f"limits of {name} are missing, or do not rise")
    numbers = [n for one in law.parameters.values() for n in (one.value, one.low, one.high)]
    if (np.abs([*numbers, *np.ravel([*law.limits.values()]), law.held_out_nats, law.share]) > MOST).any():
        raise ValueError(f"a number is beyond {MOST:g}")
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
            variable = any(isinstance(one, ast.Name) for one in ast.walk(left))
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
            return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < MOST
    return False
