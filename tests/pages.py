"""Pages for people, and what is told of them."""

import importlib
import importlib.util
import re
from pathlib import Path

from tests.programs import ROOT

MEASURED = sorted((ROOT / "benchmarks/blind/measured").glob("*/*.md"))
PAGES = [*sorted(ROOT.glob("*.md")), *sorted((ROOT / "docs").glob("*.md")), *MEASURED]
TODAY = [page for page in PAGES if page.name != "CHANGELOG.md"]
"""Those that show no commands of earlier versions."""
LINK = re.compile(r"\]\(([^)\s]+)\)")
CODE = re.compile(r"^```(\w*)\n(.*?)^```", re.DOTALL | re.MULTILINE)


def names(paths: list[Path]) -> list[str]:
    return [str(path.relative_to(ROOT)) for path in paths]


def is_module_or_member(name: str) -> bool:
    parent, _, last = name.rpartition(".")
    try:
        return importlib.util.find_spec(name) is not None or hasattr(importlib.import_module(parent), last)
    except ModuleNotFoundError:
        return hasattr(importlib.import_module(parent), last)
