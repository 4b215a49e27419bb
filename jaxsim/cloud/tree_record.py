"""What a KITTI tree was made with and what became of each frame: OUT/export.json, by which a killed export goes on."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jaxsim.cloud.kitti_tree import files_of
from jaxsim.files import replacing


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
        filled = any((out / "training").glob("*/*"))
        if not path.is_file():
            if filled:
                raise ValueError(f"export: {out} holds a training/ that this command did not make; give another --out")
            return cls(settings, {})
        try:
            content = json.loads(path.read_text())
            was, frames = content["settings"], content["frames"]
        except (ValueError, KeyError) as error:
            raise ValueError(f"export: {path} cannot be read ({error!r}); give another --out, or delete it") from error
        other = [key for key, value in settings.items() if was.get(key) != value]
        if other and (frames or filled):
            told = ", ".join(f"{key} {was.get(key)} instead of {settings[key]}" for key in other)
            moved = f" (where it has only moved, write the new root into {path.name})" if other == ["root"] else ""
            raise ValueError(
                f"export: {out} holds frames made with {told}; give another --out, or delete the folder{moved}"
            )
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
