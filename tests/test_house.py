"""How the code is laid out: rules that a reader of folder lists may rely on."""

import ast
import re
from pathlib import Path

import pytest

from tests.conftest import DEAREST

ROOT = Path(__file__).parents[1]
ROOM = ROOT / "jaxsim"
MODULES = sorted(path.relative_to(ROOM).as_posix() for path in ROOM.rglob("*.py"))

ROWS = {"effects/catalogue": "effects/test_catalogue.py", "engines": "engines/test_engines.py"}
"""Folders whose files are rows of one table, and the test of that table, which goes through all of them."""
WITHOUT = {
    "__main__.py": "two lines, by which every test of the programs as users start them begins",
    "config/data.py": "settings without behaviour; config/test_ranges.py checks the ranges of all",
    "config/depth.py": "the same",
    "config/detector.py": "the same",
    "config/intensity.py": "the same",
    "config/studies.py": "the same",
    "frame.py": "structs without behaviour, of which nearly all tests are made",
}
"""Modules that need no test file of their name, and why."""
MOST_LINES = 400
BY_PLACE = {"instance_norm", "_instance_norm"}
"""Functions of more than three positional parameters: jax.custom_vjp takes its arguments by place."""


def tree(module: str) -> ast.Module:
    return ast.parse((ROOM / module).read_text())


def mirrors(module: str) -> list[str]:
    """Where its test may be: of a package's own file beside its folder's tests, or one above."""
    path = Path(module)
    if path.name != "__init__.py":
        return [(path.parent / f"test_{path.stem}.py").as_posix()]
    own = path.parent.parent / f"test_{path.parent.name}.py"
    return [(path.parent / "test_init.py").as_posix(), *([own.as_posix()] if path.parent.name else [])]


@pytest.mark.parametrize("module", MODULES)
def test_every_module_has_a_test_file_of_its_name(module):
    """A package's own file needs one only where it does more than to gather names."""
    if module in WITHOUT:
        return
    if module.endswith("__init__.py") and not any(
        isinstance(node, ast.FunctionDef | ast.ClassDef) for node in tree(module).body
    ):
        return
    files = [test for folder, test in ROWS.items() if module.startswith(f"{folder}/")] or mirrors(module)
    assert any((ROOT / "tests" / file).is_file() for file in files), f"{module} has none of tests/{files}"


@pytest.mark.parametrize("module", [module for module in MODULES if module.endswith("/__init__.py")])
def test_a_rooms_first_page_names_its_files_and_no_others(module):
    """Where there are more than two; a command is a file of its own name, and so is an effect."""
    folder = (ROOM / module).parent
    files = {path.stem for path in folder.iterdir() if path.suffix == ".py" or (path / "__init__.py").is_file()}
    files -= {"__init__", "__main__"}
    page = ast.get_docstring(tree(module)) or ""
    assert {name for name in re.findall(r"\b(\w+)\.py\b", page) if not (ROOM / name).exists()} <= files
    if len(files) > 2 and folder.name not in ("catalogue", "cli"):
        assert not sorted(name for name in files if not re.search(rf"\b{name}\b", page))


@pytest.mark.parametrize("folder", ["tests", "benchmarks"])
def test_nothing_is_imported_from_tests(folder):
    """What tests share stands in modules without tests: imported twice, a fixture or a patch would act on one alone."""
    lines = [
        f"{path}: {line}"
        for path in sorted((ROOT / folder).rglob("*.py"))
        for line in path.read_text().splitlines()
        if re.match(r"(from|import) tests\.(\w+\.)*test_", line)
    ]
    assert not lines


def test_files_that_begin_first_are_there():
    assert [name for name in DEAREST if not (ROOT / "tests" / name).is_file()] == []


def test_no_exemption_is_left_over():
    assert {*WITHOUT} <= {*MODULES}
    assert all((ROOT / "tests" / test).is_file() and (ROOM / folder).is_dir() for folder, test in ROWS.items())
    needless = [m for m in WITHOUT if any((ROOT / "tests" / file).is_file() for file in mirrors(m))]
    assert not needless


@pytest.mark.parametrize("module", MODULES)
def test_no_file_is_long_and_no_function_takes_more_than_three_by_place(module):
    text = (ROOM / module).read_text()
    assert text.count("\n") <= MOST_LINES
    for node in ast.walk(tree(module)):
        if isinstance(node, ast.FunctionDef | ast.Lambda):
            names = [one.arg for one in (*node.args.posonlyargs, *node.args.args) if one.arg not in ("self", "cls")]
            name = getattr(node, "name", "lambda")
            assert len(names) <= 3 or name in BY_PLACE, f"{module}:{node.lineno} {name}({', '.join(names)})"


@pytest.mark.parametrize("module", MODULES)
def test_every_name_of_several_is_given_its_value_in_sight(module):
    """No tuple is unpacked from a generator, and no three values are given in one line."""
    for node in ast.walk(tree(module)):
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Tuple | ast.List):
            assert not isinstance(node.value, ast.GeneratorExp), f"{module}:{node.lineno}"
            assert not (isinstance(node.value, ast.Tuple) and len(node.value.elts) > 2), f"{module}:{node.lineno}"


@pytest.mark.parametrize("module", MODULES)
def test_every_function_works_on_the_host_or_on_the_device(module):
    """Types in signatures may be of both."""
    for node in ast.walk(tree(module)):
        if isinstance(node, ast.FunctionDef):
            parts = [*node.body, *node.args.defaults, *(one for one in node.args.kw_defaults if one)]
            assert not {"np", "jnp"} <= {name for part in parts for name in modules_used(part)}, (
                f"{module}:{node.lineno} {node.name}"
            )


def modules_used(part: ast.AST) -> set[str]:
    """Names whose attributes are taken in a piece of code, its annotations left out."""
    if isinstance(part, ast.arguments | ast.AnnAssign):
        values = [*part.defaults, *part.kw_defaults] if isinstance(part, ast.arguments) else [part.value]
        return {name for value in values if value for name in modules_used(value)}
    own = {part.value.id} if isinstance(part, ast.Attribute) and isinstance(part.value, ast.Name) else set()
    inner = [child for child in ast.iter_child_nodes(part) if child is not getattr(part, "returns", None)]
    return own.union(*(modules_used(child) for child in inner))


DISCOVER = [module for module in MODULES if module.startswith("discover/") and module != "discover/rules.py"]
OF_RULES = ("_NATS", "_LEVEL", "_SHARE")
"""Ends of the names of thresholds on an answer: gains, probabilities of tests, and shares of either."""


def constants(module: str) -> dict[str, tuple[ast.expr, str]]:
    """Values and texts of a module's constants, by name."""
    body = tree(module).body
    result = {}
    for node, after in zip(body, [*body[1:], None], strict=True):
        text = after.value if isinstance(after, ast.Expr) else None
        if isinstance(node, ast.Assign):
            said = text.value if isinstance(text, ast.Constant) and isinstance(text.value, str) else ""
            names = [name.id for name in ast.walk(node.targets[0]) if isinstance(name, ast.Name)]
            result |= {name: (node.value, said) for name in names if name.isupper()}
    return result


def test_a_constant_of_discover_has_one_value_and_a_text_where_it_is_a_number():
    """And what decides about an answer is a rule (`discover/rules.py`)."""
    homes: dict[str, str] = {}
    for module in DISCOVER:
        for name, (value, text) in constants(module).items():
            assert homes.setdefault(name, module) == module, f"{name} of {module} and {homes[name]}"
            values = [node.value for node in ast.walk(value) if isinstance(node, ast.Constant)]
            numbers = [one for one in values if type(one) in (int, float)]
            assert text or not numbers, f"{module}: {name} does not say what it is"
            assert not name.endswith(OF_RULES), f"{module}: {name} decides, and belongs to the rules"


@pytest.mark.parametrize("room", ["model", "unpaired"])
def test_the_page_of_a_model_names_its_priors(room):
    """Each name that it gives is there, and no standard deviation of a prior is left out."""
    page = ast.get_docstring(tree(f"discover/{room}/__init__.py")) or ""
    named = set()
    for home, names in re.findall(r"\b([a-z_]+)\.((?:_?[A-Z][A-Z_]+(?:, )?)+)", page):
        paths = [f"discover/{folder}{home}.py" for folder in (f"{room}/", "model/", "")]
        known = constants(next(path for path in paths if path in MODULES))
        assert {*names.removesuffix(", ").split(", ")} <= {*known}, f"{home} has not all of {names}"
        named |= {*names.split(", ")}
    priors = {
        name
        for module in DISCOVER
        if module.startswith(f"discover/{room}/")
        for name in constants(module)
        if name.endswith(("_SD", "_PRECISION"))
    }
    # These two say in standard deviations of the noise which neighbours are of another surface.
    assert priors - named == {"FARTHEST_SD", "OTHER_MATERIAL_SD"} & priors
