"""What a KITTI tree was made with and what became of each frame: OUT/export.json, by which a killed export goes on."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jaxsim.cloud.kitti_tree import files_of
from jaxsim.files import claim, replacing


@dataclass
class TreeRecord:
    """OUT/export.json: what the tree is made with, and what became of each frame."""

    settings: dict[str, Any]
    frames: dict[str, dict[str, Any]]

    @classmethod
    def open(cls, out: Path, settings: dict[str, Any]) -> TreeRecord:
        """The record of `out`, a new one where there is none.

        Raises ValueError where the tree was made with other settings, or by something else.
        """
        path = out / "export.json"
        frames: dict[str, dict[str, Any]] = {}

        def read(record: bytes) -> dict[str, Any]:
            content = json.loads(record)
            frames.update(content["frames"])
            begun = frames or any((out / "training").glob("*/*"))
            return content["settings"] if begun else settings

        filled = path.is_file() or any((out / "training").glob("*/*"))
        claim(path, settings, by="export", filled=filled, read=read)
        return cls(settings, frames)

    def check_names(self, out: Path, names: dict[str, str]) -> None:
        """Raises ValueError where the tree holds another frame under a number than `names` has there."""
        other = [number for number, name in names.items() if self.frames.get(number, {"name": name})["name"] != name]
        if other:
            was, now = self.frames[other[0]]["name"], names[other[0]]
            raise ValueError(
                f"export: {out} holds {was} as {other[0]}, which is {now} now ({len(other)} such): the data set "
                "has gained or lost frames; give another --out, or delete the folder"
            )

    def has(self, out: Path, number: str) -> bool:
        """Whether a frame is done: all its files are there, or it was left out."""
        about = self.frames.get(number)
        return about is not None and (bool(about["left_out"]) or all(path.is_file() for path in files_of(out, number)))

    def save(self, out: Path) -> None:
        with replacing(out / "export.json") as path:
            path.write_text(
                json.dumps({"settings": self.settings, "frames": dict(sorted(self.frames.items()))}, indent=1)
            )
