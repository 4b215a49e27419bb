"""Pages for people: their links lead somewhere, and the commands that they show exist."""

import importlib
import importlib.util
import re
from pathlib import Path

import pytest

from jaxsim.cli import COMMANDS
from jaxsim.train.experiments import experiment_names
from tests.pages import CODE, LINK, PAGES, ROOT, TODAY, is_module_or_member, names

FILES = [path for folder in ("jaxsim", "tests", "benchmarks", "configs") for path in (ROOT / folder).rglob("*.py")]


def prose(page: Path) -> str:
    return CODE.sub("", page.read_text())


def anchors(page: Path) -> set[str]:
    """Of a page's headings, as GitHub makes them: lower case, without punctuation, a hyphen for a space."""
    result: set[str] = set()
    for heading in re.findall(r"^#+ (.+)$", prose(page), re.MULTILINE):
        text = re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", heading).replace("`", "").strip().lower()
        anchor = base = re.sub(r"[^\w\- ]", "", text).replace(" ", "-")
        count = 0
        while anchor in result:
            count += 1
            anchor = f"{base}-{count}"
        result.add(anchor)
    return result


def commands(page: Path) -> list[list[str]]:
    """Words of every command line of a page: those of blocks, continued lines joined, and those in backticks."""
    blocks = [body for language, body in CODE.findall(page.read_text()) if language in ("", "bash", "sh")]
    lines = [line for body in blocks for line in body.replace("\\\n", " ").splitlines()]
    lines += [" ".join(code.split()) for code in re.findall(r"`([^`]+)`", prose(page))]
    lines = [part.strip() for line in lines for part in line.split("&&")]
    words = [line.split(" # ")[0].split("  #")[0].split() for line in lines]
    # Settings of the environment stand before a command.
    return [line[next((i for i, word in enumerate(line) if "=" not in word), 0) :] for line in words if line]


@pytest.mark.parametrize("page", PAGES, ids=names(PAGES))
def test_every_link_leads_to_a_file_and_a_heading(page):
    lost = []
    for target in LINK.findall(prose(page)):
        if re.match(r"[a-z]+:", target):
            continue
        path, _, anchor = target.partition("#")
        file = (page.parent / path).resolve() if path else page
        if not file.exists() or (anchor and file.suffix == ".md" and anchor not in anchors(file)):
            lost.append(target)
    assert not lost


@pytest.mark.parametrize("page", TODAY, ids=names(TODAY))
def test_every_command_exists(page):
    unknown = [" ".join(words) for words in commands(page) if not exists(words)]
    assert not unknown


@pytest.mark.parametrize("page", TODAY, ids=names(TODAY))
def test_every_file_and_module_of_the_code_that_is_named_exists(page):
    assert not lost_names(prose(page))


@pytest.mark.parametrize("page", TODAY, ids=names(TODAY))
def test_every_table_that_is_named_with_its_file_stands_there(page):
    named = re.findall(r"`([A-Z_]+)`\s+of\s+`(jaxsim/[\w/]+\.py)`", page.read_text())
    assert [(name, file) for name, file in named if not re.search(rf"^{name}\b", (ROOT / file).read_text(), re.M)] == []


def test_what_moved_is_where_the_changelog_says():
    """The last column of its tables; the others name what is no more."""
    rows = re.findall(r"^\|.*\| (.*) \|$", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert any("jaxsim.runs.run" in row for row in rows)
    assert not lost_names("\n".join(rows))


@pytest.mark.parametrize("folder", ["jaxsim", "benchmarks", "configs", "tests"])
def test_every_file_that_the_code_names_exists(folder):
    """In docstrings and comments; examples of files to be written are CONTRIBUTING's."""
    examples = set(re.findall(r"^# (jaxsim/\S+\.py)$", (ROOT / "CONTRIBUTING.md").read_text(), re.MULTILINE))
    files = sorted((ROOT / folder).rglob("*.py"))
    named = [(path, name) for path in files for name in re.findall(r"(?<![\w/.])jaxsim/[\w/]+\.py\b", path.read_text())]
    assert not [(str(path), name) for path, name in named if name not in examples and not (ROOT / name).exists()]


def lost_names(text: str) -> list[str]:
    """Files and modules of ours in backticks that are not there. A file may be named by the end of its path."""
    code = re.findall(r"`([^`\s]+)`", text)
    files = [name for name in code if re.fullmatch(r"(jaxsim|tests|benchmarks|configs)/[\w/.]+", name)]
    ends = [name for name in code if re.fullmatch(r"[a-z_0-9]+(/[a-z_0-9]+)+\.py", name) and name not in files]
    modules = [name for name in code if re.fullmatch(r"jaxsim(\.[a-z_0-9]+)+", name)]
    return [
        *(name for name in files if not (ROOT / name).exists()),
        *(name for name in ends if not any(str(path).endswith(f"/{name}") for path in FILES)),
        *(name for name in modules if not is_module_or_member(name)),
    ]


def exists(words: list[str]) -> bool:
    """Whether what a command line starts is there; True for what is no command of ours."""
    program, *rest = [word.removeprefix(".venv/bin/") for word in words]
    if program == "jaxsim" and rest:
        command, *rest = rest
        if command == "train":
            return command in COMMANDS and is_experiment(rest)
        return command.startswith("-") or is_placeholder(command) or command in COMMANDS
    if program == "make" and rest and re.fullmatch(r"[a-z-]+", rest[0]):
        return re.search(rf"^{rest[0]}:", (ROOT / "Makefile").read_text(), re.MULTILINE) is not None
    if program == "pytest":
        return all((ROOT / word.split("::")[0]).exists() for word in rest if word.startswith("tests"))
    if program != "python" or not rest:
        return True
    if rest[0] == "-m":
        return importlib.util.find_spec(rest[1]) is not None
    if rest[0].endswith(".py"):
        return (ROOT / rest[0]).is_file() and (rest[0] != "train.py" or is_experiment(rest[1:]))
    return True


def is_experiment(words: list[str]) -> bool:
    """Whether `train` takes these words: flags, an experiment's name, or a placeholder."""
    return not words or words[0].startswith("-") or is_placeholder(words[0]) or words[0] in experiment_names()


def is_placeholder(word: str) -> bool:
    return re.fullmatch(r"[A-Z_]+|\.\.\.|.*\.json", word) is not None


def test_every_page_of_docs_is_in_the_index():
    listed = set(LINK.findall((ROOT / "docs/index.md").read_text()))
    assert {path.name for path in (ROOT / "docs").glob("*.md")} - {"index.md"} <= listed


def test_the_paper_is_named_where_it_is_first_spoken_of():
    for page in [ROOT / "README.md", *(ROOT / "docs").glob("*.md")]:
        text = prose(page)
        body = text.split("\n", 1)[1]
        spoken = re.search(r"\b[Tt]he paper\b", body)
        if spoken:
            assert "10.1007/978-3-031-39059-3_28" in body[: spoken.end() + 250], page
