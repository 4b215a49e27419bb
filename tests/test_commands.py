"""The command lines of pages: their own parsers take them, and of each block it is said which test runs it, or why none
does.

The line before a block is a comment of the page: `<!-- run by tests/... -->` or `<!-- not run: WHY -->`. `run below by`
and `not run below` hold to the page's end, or the next such line.
"""

from __future__ import annotations

import argparse
import re
import runpy
import shlex
import sys
from pathlib import Path
from typing import Any

import pytest
import tyro

from jaxsim.cli import main
from tests.pages import CODE, MEASURED, ROOT, TODAY, names

# A module that an earlier line ran is run once more.
pytestmark = pytest.mark.filterwarnings("ignore:.*found in sys.modules after import:RuntimeWarning")

MARK = re.compile(r"<!-- (?:not )?run(?P<below> below)?(?: by (?P<test>\S+)|: (?P<why>.+?)) -->", re.DOTALL)
OURS = re.compile(r"(jaxsim|python -m (benchmarks|tests)\.\S+|python benchmarks/\S+)\s")
STARTS = ("jaxsim ", "python ", "pip ", "make ", "docker ", "conda ", "dask ")
NO_PARSER = ("tests.fuzz", "tests.kills", "tests.data.many_frames", "tests.evaluate.many_frames")
"""Programs of words by place."""


def blocks(page: Path) -> list[tuple[int, str, list[str]]]:
    """Where each block with commands begins, what stands between it and the block before, and its command lines."""
    text = page.read_text()
    found = []
    last = 0
    for block in CODE.finditer(text):
        lines = [" ".join(line.split()) for line in block[2].replace("\\\n", " ").splitlines()]
        # Settings of the environment stand before a command, and its explanation after it.
        plain = [re.sub(r"^([A-Z_]+=\S+ )+", "", re.sub(r"\s# .*$", "", line)) for line in lines]
        commands = [line for line in plain if line.startswith(STARTS)]
        if block[1] in ("", "bash", "sh") and commands:
            found.append((block.start(), text[last : block.start()], commands))
        last = block.end()
    return found


PAGES = [page for page in TODAY if blocks(page)]


class Parsed(BaseException):
    """A command line was taken: nothing else is done with it."""


@pytest.fixture
def parses_alone(monkeypatch, tmp_path):
    """Commands end where their words are parsed."""
    taken, given = tyro.cli, argparse.ArgumentParser.parse_args

    def cli(*args: Any, **kwargs: Any) -> Any:
        taken(*args, **kwargs)
        raise Parsed

    def parse_args(self: argparse.ArgumentParser, *args: Any, **kwargs: Any) -> Any:
        given(self, *args, **kwargs)
        raise Parsed

    monkeypatch.setattr(tyro, "cli", cli)
    monkeypatch.setattr(argparse.ArgumentParser, "parse_args", parse_args)


def words_of(line: str) -> list[str]:
    """Of a command line, with all that it may leave out, and an experiment where it shows a placeholder."""
    words = shlex.split(re.sub(r"[\[\]]", "", line))
    return [{"CONFIG": "demo"}.get(word, word) for word in words if word != "..."]


def start(words: list[str]) -> None:
    """Starts a program of ours as the shell does."""
    if words[0] == "jaxsim":
        main(words[1:])
    elif words[1] == "-m":
        sys.argv[:] = words[2:]
        runpy.run_module(words[2], run_name="__main__", alter_sys=True)
    else:
        sys.argv[:] = words[1:]
        runpy.run_path(str(ROOT / words[1]), run_name="__main__")


@pytest.mark.parametrize("page", PAGES, ids=names(PAGES))
def test_the_parsers_take_every_command_line(page, parses_alone, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", list(sys.argv))
    refused = []
    for line in dict.fromkeys(line for _, _, lines in blocks(page) for line in lines if OURS.match(line)):
        words = words_of(line)
        if set(words) & {*NO_PARSER, "--help"}:
            continue
        try:
            start(words)
        except Parsed:
            continue
        except BaseException as refusal:  # SystemExit too: so parsers refuse
            # What an extra brings may not be installed here.
            if isinstance(refusal, ModuleNotFoundError) and "pip install" in str(refusal):
                continue
            refused.append((line, repr(refusal), capsys.readouterr().err[-600:]))
        else:
            refused.append((line, "it has no parser", ""))
    assert not refused


FOR_READERS = [page for page in PAGES if page not in MEASURED]
"""Not the records of what was measured, whose commands are what made them."""


@pytest.mark.parametrize("page", FOR_READERS, ids=names(FOR_READERS))
def test_every_block_says_which_test_runs_it_or_why_none_does(page):
    silent = []
    below = None
    for at, before, lines in blocks(page):
        marks = list(MARK.finditer(before))
        below = next((mark for mark in reversed(marks) if mark["below"]), below)
        # A mark of one block stands right before it.
        own = next((mark for mark in marks if not before[mark.end() :].strip()), None)
        mark = own or below
        if mark is None:
            silent.append((page.read_text()[:at].count("\n") + 1, lines[0]))
        elif mark["test"]:
            file, _, name = mark["test"].partition("::")
            assert (ROOT / file).is_file(), mark[0]
            assert name in (ROOT / file).read_text(), mark[0]
        else:
            assert len(mark["why"].split()) > 2
    assert not silent


@pytest.mark.slow
@pytest.mark.parametrize("page", ["README.md", "docs/start.md"])
def test_a_newcomer_finds_the_hidden_effect(page, tmp_path, monkeypatch, capsys, standard_promotion):
    """The page's own lines, in a folder of one's own; their small form is that parsers take them."""
    (lines,) = (lines for _, _, lines in blocks(ROOT / page) if any("hidden make case" in line for line in lines))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", list(sys.argv))
    for line in lines:
        status = None
        try:
            start(words_of(line))
        except SystemExit as end:
            status = end.code
        assert not status, line
    assert "beam_gain" in capsys.readouterr().out
    assert (tmp_path / "case/out/report.html").is_file()
