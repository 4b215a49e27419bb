"""Rules are fixed, and each says what it means and what it was set on."""

import ast
import dataclasses
import re
from pathlib import Path

import pytest

from jaxsim.discover import rules
from jaxsim.discover.rules import RULES

FILES = sorted(path for path in Path(rules.__file__).parent.glob("*.py") if path.stem != "__init__")
SET_ON = r"set on|set,? as|follows from|a convention|the same judgement|a judgement, not calibrated|tests/"


def texts(path: Path) -> dict[str, str]:
    """What stands beside each rule of a file, on one line."""
    [body] = [node.body for node in ast.parse(path.read_text()).body if isinstance(node, ast.ClassDef)]
    told = {}
    for node, after in zip(body, [*body[1:], None], strict=True):
        if isinstance(node, ast.AnnAssign):
            assert isinstance(node.target, ast.Name)
            text = after.value.value if isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant) else ""
            told[node.target.id] = " ".join(str(text).split())
    return told


def test_no_rule_can_be_changed_in_passing():
    with pytest.raises(dataclasses.FrozenInstanceError):
        RULES.bar_nats = 0.0  # pyright: ignore[reportAttributeAccessIssue]


def test_every_rule_stands_in_one_file_in_the_order_in_which_they_act():
    page = ast.get_docstring(ast.parse(Path(rules.__file__).read_text())) or ""
    order = re.findall(r"^    (\w+)  ", page, re.MULTILINE)[: len(FILES)]
    assert sorted(order) == [path.stem for path in FILES]
    names = [name for stem in order for name in texts(Path(rules.__file__).with_name(f"{stem}.py"))]
    assert names == [field.name for field in dataclasses.fields(RULES)]


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_every_rule_says_what_it_was_set_on_and_names_tests_that_are_there(path):
    root = Path(__file__).parents[2]
    for name, text in texts(path).items():
        assert re.search(rf"\([^()]*({SET_ON})", text), f"{name}: {text}"
        assert not [file for file in re.findall(r"tests/[\w/]+\.py", text) if not (root / file).is_file()], name
