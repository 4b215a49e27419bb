"""Rules are fixed, and each says what it means."""

import ast
import dataclasses
from pathlib import Path

import pytest

from jaxsim.discover import rules
from jaxsim.discover.rules import RULES


def test_no_rule_can_be_changed_in_passing():
    with pytest.raises(dataclasses.FrozenInstanceError):
        RULES.bar_nats = 0.0  # pyright: ignore[reportAttributeAccessIssue]


def test_every_rule_has_its_meaning_beside_it():
    module = ast.parse(Path(rules.__file__).read_text())
    [body] = [node.body for node in module.body if isinstance(node, ast.ClassDef)]
    after = [
        following for node, following in zip(body, [*body[1:], None], strict=True) if isinstance(node, ast.AnnAssign)
    ]
    assert len(after) == len(dataclasses.fields(RULES))
    assert all(isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) for node in after)
