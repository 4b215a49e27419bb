"""The frames that a run learned from, by name: text such as `0-18` names others once drives join the data set."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from jaxsim.data import select
from jaxsim.data.select import select_or_all
from jaxsim.files import check_name, parse_settings, placed, read_json, replacing

_log = logging.getLogger(__name__)

FRAMES = "frames.json"
"""File of a run's folder; runs of earlier versions have none."""


@dataclass(frozen=True)
class RunFrames:
    """Names of a run's frames, as its data set has them."""

    train: tuple[str, ...]
    """Those that it learns from."""
    validation: tuple[str, ...]
    """Those that judge it meanwhile."""

    def __post_init__(self) -> None:
        for part in (self.train, self.validation):
            if not part:
                raise ValueError("a run has frames that it learns from and frames that judge it; none of one are named")
            for name in part:
                check_name(name, by="run")

    @classmethod
    def at(cls, dataset: Any, train: Sequence[int], *, validation: Sequence[int]) -> RunFrames:
        """Those at these positions of a data set."""
        return cls(tuple(map(dataset.name_of, train)), tuple(map(dataset.name_of, validation)))


def read_frames(folder: Path | str) -> RunFrames | None:
    """The frames of the run in a folder; None where it keeps no record of them. Raises ValueError for a damaged one."""
    path = Path(folder) / FRAMES
    if not path.is_file():
        return None
    again = "copy it again, or remove it: frames are then told by their positions alone"
    content = read_json(path, by="run", hint=again)
    with placed(f"run: {path} is no record of a run's frames", then=again):
        return parse_settings(RunFrames, content)


def write_frames(folder: Path, frames: RunFrames) -> None:
    """Keeps a run's frames in its folder, whole or not at all."""
    with replacing(folder / FRAMES) as path:
        path.write_bytes(TypeAdapter(RunFrames).dump_json(frames, indent=0))


def check_frames(folder: Path, frames: RunFrames, *, by: str = "--data.train") -> None:
    """Raises ValueError where the run in a folder has learned from other frames, before time goes into these; warns
    where others validated it. `by` is what chose them."""
    # Without a config.json no run has begun there.
    was = read_frames(folder) if (folder / "config.json").is_file() else None
    if was and (other := change(was.train, frames.train)):
        raise ValueError(
            f"run: {folder} learned from other frames than {by} names today: {other}. Give the data set back what it "
            "held (a folder of links will do), or give another --run.name; drives and lists that are called by name "
            "(--data.train drive_0009) stay the same when others join them"
        )
    if was and (other := change(was.validation, frames.validation)):
        _log.warning(f"{folder}: other frames validate from here on: {other}")


def shared_frames(folders: Sequence[Path], *, by: str) -> RunFrames | None:
    """The frames that all of the runs in these folders learned from; None where one keeps no record.

    What validated a run changed nothing in it: those are the first run's. Raises ValueError where runs learned from
    others than the first that says so; `by` names the command.
    """
    recorded = {folder: frames for folder in folders if (frames := read_frames(folder))}
    first = next(iter(recorded), folders[0])
    for folder, frames in recorded.items():
        if other := change(recorded[first].train, frames.train):
            raise ValueError(
                f"{by}: {folder} learned from other frames than {first}: {other}; name runs that learned from the same"
            )
    return recorded[first] if len(recorded) == len(folders) else None


def change(was: Sequence[str], now: Sequence[str]) -> str:
    """In words, which of a run's frames are no longer named, and which are new; empty where they are the same."""
    known, named = set(was), set(now)
    lists = {
        f"of its {len(was)} are not among them": [name for name in was if name not in named],
        "are new": [name for name in now if name not in known],
    }
    return ", ".join(f"{len(names)} {what} (the first: {names[0]})" for what, names in lists.items() if names)


def positions_of(names: Sequence[str] | None, dataset: Any, *, text: str, part: str) -> list[int]:
    """Positions in a data set of a run's frames as its record names them, those that are still there; of a run without
    a record (None) those that `text` names.

    Warns where `text` names others today, and where some are gone. Raises ValueError where all are, and as `select`.
    """
    if names is None:
        return select(text, dataset)
    try:
        chosen = {dataset.name_of(i): i for i in select(text, dataset)}
        other = change(names, list(chosen))
    except ValueError as error:  # fewer are there, or a part is gone
        chosen, other = {}, str(error)
    places = chosen
    if other:
        # Only now, for the embedded world has a million names.
        holds = getattr(dataset, "holds", lambda position: True)
        places = {dataset.name_of(i): i for i in range(len(dataset)) if holds(i)}
        here = sum(name in places for name in names)
        if not here:
            raise ValueError(
                f"run: none of the run's {len(names)} {part} frames is in the data set (the first: {names[0]}); give "
                "it back what it held"
            )
        taken = (
            "those of the run are taken" if here == len(names) else f"the run's {here} that are still here are taken"
        )
        _log.warning(f"{part} frames {text!r} are no longer those of the run: {other}; {taken}, by name ({FRAMES})")
    return [places[name] for name in names if name in places]


def judges_of(recorded: RunFrames | None, dataset: Any, *, frames: str, validation: str) -> list[int]:
    """The positions that `frames` names; where it is empty, those of the run's validation frames, which `validation`
    names where they are not `recorded`; all where both are empty.

    Warns as `positions_of`. Raises ValueError as `positions_of` and `select`.
    """
    if frames or not validation:
        return select_or_all(frames, dataset)
    return positions_of(recorded and recorded.validation, dataset, text=validation, part="validation")
