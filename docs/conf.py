"""The site: `make docs` builds docs/build/html from these pages, the README and the docstrings, without warnings."""

from __future__ import annotations

import re
from importlib import import_module
from importlib.metadata import version as version_of
from pathlib import Path
from typing import Any

import jupytext

ROOT = Path(__file__).parents[1]

project = "jaxsim"
author = "The jaxsim developers"
copyright = "the jaxsim developers"
release = version = version_of("jaxsim-lidar")
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx_copybutton"]
root_doc = "index"
exclude_patterns = ["build"]
source_suffix = {".md": "markdown"}
html_theme = "furo"
html_title = f"jaxsim {release}"
html_static_path = []
html_show_sphinx = False
# They are read from the pages, which no browser lets a page do that is opened from disk.
html_show_search_summary = False
myst_enable_extensions = ["colon_fence", "dollarmath"]
myst_heading_anchors = 4
# Blocks of commands and of JSON with gaps are no language that a lexer knows.
highlight_language = "none"
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_default_options = {"members": True}
default_role = "code"
nitpicky = False

SITE_PAGE = {
    "README.md": "site/readme.md",
    "CONTRIBUTING.md": "site/contributing.md",
    "CHANGELOG.md": "site/changes.md",
    "SECURITY.md": "site/security.md",
    "docs/notebooks/discover_a_hidden_effect.py": "site/discover_a_hidden_effect.md",
    "docs/notebooks/learn_and_simulate.py": "site/learn_and_simulate.md",
}
"""Where the site shows pages of the checkout's root, and notebooks."""
LINK = re.compile(r"(!?)\[((?:[^][]|\[[^]]*\])*)\]\(([^)\s]+)\)")


def relinked(text: str, *, page: Path, shown_at: Path) -> str:
    """A page's text with links that lead where the site has what they mean; files of the checkout that it does not
    show are named instead. `page` is the file, `shown_at` the place in docs/ that it is shown at."""

    def link(match: re.Match[str]) -> str:
        picture, words, target = match.groups()
        if re.match(r"[a-z]+:|#", target):
            return match[0]
        path, _, anchor = target.partition("#")
        file = (page.parent / path).resolve()
        name = file.relative_to(ROOT).as_posix() if file.is_relative_to(ROOT) else path
        if name in SITE_PAGE:
            file = ROOT / "docs" / SITE_PAGE[name]
        elif not name.startswith("docs/") or file.suffix == ".py":
            return words if words.strip("`/") == name else f"{words} (`{name}`)"
        up = "../" * (len(shown_at.parent.relative_to(ROOT / "docs").parts))
        there = f"{up}{file.relative_to(ROOT / 'docs').as_posix()}"
        return f"{picture}[{words}]({there}{'#' + anchor if anchor else ''})"

    # Code is left as it is.
    parts = re.split(r"(^```.*?^```)", text, flags=re.DOTALL | re.MULTILINE)
    return "".join(part if part.startswith("```") else LINK.sub(link, part) for part in parts)


def toctrees(text: str) -> str:
    """The index's own lists as the site's menu: a caption and its pages for each bold line."""
    menu = [("Start", ["site/readme", "start"])]
    for line in text.splitlines():
        if head := re.fullmatch(r"\*\*(.+?)\*\*.*", line):
            menu.append((head[1], []))
        elif item := re.match(r"- \[[^]]+\]\(([\w/-]+\.(?:md|py))\)", line):
            menu[-1][1].append(SITE_PAGE.get(f"docs/{item[1]}", item[1]).removesuffix(".md"))
    menu.append(("The project", ["site/api", "site/changes", "site/contributing", "site/security"]))
    blocks = []
    for caption, pages in filter(lambda part: part[1], menu):
        listed = "\n".join(dict.fromkeys(pages))
        blocks.append(f"```{{toctree}}\n:hidden:\n:caption: {caption}\n\n{listed}\n```")
    return "\n\n".join(blocks)


PACKAGES = ("frame", "geometry", "data", "prepare", "cloud", "effects", "simulate", "discover", "metrics", "report")


def api() -> str:
    """Directives for the public names of each package; a name that several give stands with the first."""
    seen: set[int] = set()
    blocks = []
    for package in PACKAGES:
        module = import_module(f"jaxsim.{package}")
        public = getattr(module, "__all__", None) or [n for n, v in vars(module).items() if is_own(v, module.__name__)]
        lines = [f"## jaxsim.{package}", "", "```{eval-rst}"]
        for name in public:
            value = getattr(module, name)
            kind = "autoclass" if isinstance(value, type) else "autofunction" if callable(value) else ""
            if kind and id(value) not in seen and not name.startswith("_"):
                seen.add(id(value))
                lines += [f".. {kind}:: jaxsim.{package}.{name}", ""]
        blocks.append("\n".join([*lines, "```"]))
    return "\n\n" + "\n\n".join(blocks) + "\n"


def is_own(value: Any, module: str) -> bool:
    return getattr(value, "__module__", "") == module and isinstance(value, type)


def read_source(app: Any, name: str, content: list[str]) -> None:
    """Pages of docs/ as the site needs them."""
    page = shown = ROOT / "docs" / f"{name}.md"
    if name.startswith("site/") and (root := {v: k for k, v in SITE_PAGE.items()}.get(f"{name}.md")):
        page = ROOT / root
        notebook = page.suffix == ".py"
        content[0] = jupytext.writes(jupytext.read(page), fmt="md") if notebook else page.read_text(encoding="utf-8")
    more = f"\n\n{toctrees(content[0])}\n" if name == "index" else api() if name == "site/api" else ""
    content[0] = relinked(content[0], page=page, shown_at=shown) + more


def as_markup(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Docstrings are prose with `code` in single backticks, and lists or drawings that stand as they are."""
    blocks = "\n".join(lines).split("\n\n")
    lines[:] = "\n\n".join(map(block_as_markup, blocks)).split("\n")


def block_as_markup(block: str) -> str:
    """One paragraph; what is drawn or aligned by spaces becomes a literal block."""
    if not block.strip():
        return block
    if re.search(r"\S {2,}\S|^[ \t|]|^- |^\d+\. ", block, re.MULTILINE):
        return "::\n\n" + "\n".join(f"    {line}" for line in block.split("\n"))
    parts = re.split(r"(`[^`]*`)", block)
    return "".join(f"`{part}`" if part.startswith("`") else re.sub(r"([*_|\\])", r"\\\1", part) for part in parts)


def setup(app: Any) -> dict[str, bool]:
    app.connect("source-read", read_source)
    app.connect("autodoc-process-docstring", as_markup)
    return {"parallel_read_safe": True}
