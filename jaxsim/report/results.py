"""Results as files: JSON for programs, Markdown for people, and a page where there is one."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from jaxsim.files import replacing


def write_results(
    folder: Path, name: str, content: Mapping[str, Any], *, text: str, page: str = "", indent: int = 2
) -> Path:
    """Writes NAME.md from `text`, NAME.html if there is a page, and NAME.json from `content`; gives the path of the
    page, or else of the Markdown.

    Each file appears whole or not at all, and JSON last: where it is, the others are.
    """
    files = {"md": f"{text}\n", "html": page, "json": json.dumps(content, indent=indent)}
    for suffix in [suffix for suffix, words in files.items() if words]:
        with replacing(folder / f"{name}.{suffix}") as temporary:
            temporary.write_text(files[suffix], encoding="utf-8")
    return folder / f"{name}.{'html' if page else 'md'}"


def list_facts(about: Mapping[str, Any]) -> str:
    """Facts as a Markdown list, a line `- name: value` each."""
    return "\n".join(f"- {name}: {value}" for name, value in about.items())
