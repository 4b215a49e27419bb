"""Flags of earlier versions under their names of today."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from typing import Any

from jaxsim.cli.flags import DataSource


def in_new_spelling(words: Sequence[str], flags: Any) -> list[str]:
    """The words of a command line, with flags that were called otherwise in earlier versions under their names of
    today; a first word that is no flag, where `flags` has no place for it, is the kind of data set."""
    today = _old_spellings(flags)
    result = []
    for word in words:
        flag, equals, value = word.partition("=")
        result.append(today.get(flag.replace("_", "-"), flag) + equals + value)
    takes_a_word = any("Positional" in str(field.type) for field in fields(flags))
    if words and not words[0].startswith("-") and _groups(flags) == ["data"] and not takes_a_word:
        result.insert(0, "--data.kind")
    return result


def _old_spellings(flags: Any) -> dict[str, str]:
    """Earlier spelling of a flag -> its name: `--root` -> `--data.root`, `--data` -> `--data.kind`, `--sensor` ->
    `--effects`. A flag that the command itself has is never an earlier spelling."""
    names = {field.name for field in fields(flags)}
    table = {"--sensor": "--effects"} if "effects" in names else {}
    for group in _groups(flags):
        before = "" if group == "data" else f"{group}-"
        table |= {f"--{before}{field.name}": f"--{group}.{field.name}" for field in fields(DataSource)}
        table[f"--{group}"] = f"--{group}.kind"
    return {old: new for old, new in table.items() if old[2:] not in names or old[2:] in _groups(flags)}


def _groups(flags: Any) -> list[str]:
    """Names of the fields that are a `DataSource`."""
    return [field.name for field in fields(flags) if isinstance(field.default, DataSource)]
