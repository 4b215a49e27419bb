"""Flags that several commands share."""

from pathlib import Path

from jaxsim.cli.commands import parse
from jaxsim.cli.effects import Effects
from jaxsim.cli.export import Export


def test_files_of_effects_may_be_several_and_the_folder_is_the_commands_own():
    words = ["--effects-from", "a.py", "--effects-from", "b.py"]
    assert parse(Effects, words, name="effects", example="").effects_from == (Path("a.py"), Path("b.py"))
    asked = parse(Export, ["--out", "tree", "--cluster", "tcp://a:1", *words], name="export", example="")
    assert (asked.writes_to, asked.cluster, len(asked.effects_from)) == (Path("tree"), "tcp://a:1", 2)
