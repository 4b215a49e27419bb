"""How the code is laid out: rules that a reader of folder lists may rely on."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.conftest import DEAREST, NEEDY

ROOT = Path(__file__).parents[1]
ROOM = ROOT / "jaxsim"
MODULES = sorted(path.relative_to(ROOM).as_posix() for path in ROOM.rglob("*.py"))

ROWS = {
    "effects/catalogue": "effects/test_catalogue.py",
    "engines": "engines/test_engines.py",
    "discover/rules": "discover/test_rules.py",
}
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
MOST_LINES = {"cli": 100}
"""Lines of a file in a room, ..."""
MOST_LINES_ELSE = 400
"""... and in all others."""
BY_PLACE = {"instance_norm", "_instance_norm"}
"""Functions of more than three positional parameters: jax.custom_vjp takes its arguments by place."""


def tree(module: str) -> ast.Module:
    return ast.parse((ROOM / module).read_text())


def functions() -> Iterator[tuple[str, ast.FunctionDef | ast.Lambda]]:
    """Every one of the package, after where it stands and its name."""
    for module in MODULES:
        for node in ast.walk(tree(module)):
            if isinstance(node, ast.FunctionDef | ast.Lambda):
                yield f"{module}:{node.lineno} {getattr(node, 'name', 'lambda')}", node


def mirrors(module: str) -> list[str]:
    """Where its test may be: of a package's own file beside its folder's tests, or one above."""
    path = Path(module)
    if path.name != "__init__.py":
        return [(path.parent / f"test_{path.stem}.py").as_posix()]
    own = path.parent.parent / f"test_{path.parent.name}.py"
    return [(path.parent / "test_init.py").as_posix(), *([own.as_posix()] if path.parent.name else [])]


def test_every_module_has_a_test_file_of_its_name():
    """A package's own file needs one only where it does more than to gather names."""
    without = []
    for module in MODULES:
        files = [test for folder, test in ROWS.items() if module.startswith(f"{folder}/")] or mirrors(module)
        does = any(isinstance(node, ast.FunctionDef | ast.ClassDef) for node in tree(module).body)
        needs = module not in WITHOUT and (does or not module.endswith("__init__.py"))
        if needs and not any((ROOT / "tests" / file).is_file() for file in files):
            without.append(f"{module} has none of tests/{files}")
    assert not without


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
    assert [name for name in (*DEAREST, *NEEDY) if not (ROOT / "tests" / name).is_file()] == []


def test_no_exemption_is_left_over():
    assert {*WITHOUT} <= {*MODULES}
    assert all((ROOT / "tests" / test).is_file() and (ROOM / folder).is_dir() for folder, test in ROWS.items())
    needless = [m for m in WITHOUT if any((ROOT / "tests" / file).is_file() for file in mirrors(m))]
    assert not needless


def test_no_file_is_long_and_no_function_takes_more_than_three_by_place():
    lines = {module: (ROOM / module).read_text().count("\n") for module in MODULES}
    most = {module: MOST_LINES.get(Path(module).parts[0], MOST_LINES_ELSE) for module in MODULES}
    assert not {module: count for module, count in lines.items() if count > most[module]}
    many = []
    for place, node in functions():
        names = [one.arg for one in (*node.args.posonlyargs, *node.args.args) if one.arg not in ("self", "cls")]
        if len(names) > 3 and getattr(node, "name", "lambda") not in BY_PLACE:
            many.append(f"{place}({', '.join(names)})")
    assert not many


def test_every_name_of_several_is_given_its_value_in_sight():
    """No tuple is unpacked from what a loop gives, but for a first one and all others; and no three values are given in
    one line."""
    hidden = []
    for module in MODULES:
        for node in ast.walk(tree(module)):
            if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Tuple | ast.List):
                three = isinstance(node.value, ast.Tuple) and len(node.value.elts) > 2
                # [one] = [... for ...] says that there is one.
                several = len(node.targets[0].elts) > 1
                starred = any(isinstance(name, ast.Starred) for name in node.targets[0].elts)
                looped = isinstance(node.value, ast.GeneratorExp | ast.ListComp)
                if three or (looped and several and not starred):
                    hidden.append(f"{module}:{node.lineno}")
    assert not hidden


def test_every_function_works_on_the_host_or_on_the_device():
    """Types in signatures may be of both."""
    on_both = []
    for place, node in functions():
        if isinstance(node, ast.FunctionDef):
            parts = [*node.body, *node.args.defaults, *(one for one in node.args.kw_defaults if one)]
            if {"np", "jnp"} <= {name for part in parts for name in modules_used(part)}:
                on_both.append(place)
    assert not on_both


def modules_used(part: ast.AST) -> set[str]:
    """Names whose attributes are taken in a piece of code, its annotations left out."""
    if isinstance(part, ast.arguments | ast.AnnAssign):
        values = [*part.defaults, *part.kw_defaults] if isinstance(part, ast.arguments) else [part.value]
        return {name for value in values if value for name in modules_used(value)}
    own = {part.value.id} if isinstance(part, ast.Attribute) and isinstance(part.value, ast.Name) else set()
    inner = [child for child in ast.iter_child_nodes(part) if child is not getattr(part, "returns", None)]
    return own.union(*(modules_used(child) for child in inner))


DISCOVER = [module for module in MODULES if module.startswith("discover/")]
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
    """And what decides about an answer is a rule (`discover/rules`)."""
    homes: dict[str, str] = {}
    for module in DISCOVER:
        for name, (value, text) in constants(module).items():
            assert homes.setdefault(name, module) == module, f"{name} of {module} and {homes[name]}"
            values = [node.value for node in ast.walk(value) if isinstance(node, ast.Constant)]
            numbers = [one for one in values if type(one) in (int, float)]
            assert text or not numbers, f"{module}: {name} does not say what it is"
            assert not name.endswith(OF_RULES), f"{module}: {name} decides, and belongs to the rules"


def test_what_discover_compares_with_has_a_name():
    """A number in a comparison decides something: it is a constant, or a rule. Not so a whole number, a half of what is
    drawn between 0 and 1, and what lies a rounding beside 1."""
    unnamed = [
        f"{module}:{node.lineno}: {ast.unparse(node)}"
        for module in DISCOVER
        for node in ast.walk(tree(module))
        if isinstance(node, ast.Compare)
        for value in ast.walk(node)
        if isinstance(value, ast.Constant) and isinstance(value.value, float)
        if value.value != 0.5 and value.value > 1e-5 and abs(value.value - round(value.value)) > 0.002
    ]
    assert not unnamed


@pytest.mark.parametrize("room", ["model", "unpaired"])
def test_the_page_of_a_model_names_its_priors(room):
    """Each name that it gives is there, and no standard deviation of a prior is left out."""
    page = ast.get_docstring(tree(f"discover/{room}/__init__.py")) or ""
    named = set()
    for home, names in re.findall(r"\b([a-z_]+)\.((?:_?[A-Z][A-Z_]+(?:, )?)+)", page):
        paths = [f"discover/{folder}{home}.py" for folder in (f"{room}/", "model/", "find/")]
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
    # These say in standard deviations of the noise which neighbours are of another surface.
    assert priors - named == {"FARTHEST_SD", "OTHER_MATERIAL_SD", "OTHER_WALL_SD"} & priors
