"""`jaxsim watch`: how a sensor changes from day to day."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import tyro

from jaxsim.config.ranges import Checked
from jaxsim.discover.watch import Change, Day, watch_days
from jaxsim.files import check_apart, write_text
from jaxsim.report.results import markdown_table


@dataclass(frozen=True)
class Watch(Checked):
    """Holds a sensor's frames of today against its frames of before: dirt on the window, a dying beam, a drifting
    emitter.

    Folders of polar frames of one sensor (`jaxsim frames`), of any streets; each needs four scenes or more. Ends with 0
    where nothing has changed, with 1 where something has, with 2 where days cannot be held against each other.
    """

    before: Annotated[Path, tyro.conf.Positional]
    """Folder of the day that all others are held against."""
    days: tuple[Path, ...]
    """Folders of later days, in order."""
    out: Path | None = None
    """File for the table (Markdown)."""
    failure: ClassVar = 2
    """A folder that is not there is no change of the sensor, which a nightly job asks for."""

    def __call__(self) -> None:
        if not self.days:
            raise ValueError("watch: --days names no folder; give those of later days, in order")
        for day in self.days:
            if day.exists() and self.before.exists() and day.samefile(self.before):
                raise ValueError(f"watch: {day} is held against itself; give folders of later days to --days")
        if self.out and self.out.is_dir():
            raise ValueError(f"watch: --out {self.out} is a folder; name the file that the table goes to")
        if self.out:
            # The table would be written over a frame.
            of_folders = (file for folder in (self.before, *self.days) for file in folder.glob("*"))
            check_apart(self.out, *(file for file in of_folders if file.suffix in (".npz", ".json")), by="watch")
        watched = watch_days(self.before, self.days)
        page = watch_table(watched)
        print(page)
        if self.out:
            write_text(self.out, page)
        if any(day.changes for day in watched):
            raise SystemExit(1)


def watch_table(days: Sequence[Day]) -> str:
    """A row a thing that has changed, a column a day."""
    changed = [{(change.what, change.channel): change for change in day.changes} for day in days]
    things = dict.fromkeys(thing for of_day in changed for thing in of_day)
    if not things:
        return f"Nothing has changed in {', '.join(day.folder.name for day in days)}.\n"
    # Folders of one name (tuesday/measured) are told apart by the whole path.
    alike = len({day.folder.name for day in days}) < len(days)
    heads = ["", *(f"{day.folder if alike else day.folder.name} ({day.scenes} scenes)" for day in days)]
    rows = [[", ".join(thing), *(_cell(of_day.get(thing)) for of_day in changed)] for thing in things]
    return f"{markdown_table(heads, rows)}\n"


def _cell(change: Change | None) -> str:
    if change is None:
        return ""
    # Nats of intensity are told as a share, too.
    share = float if change.channel == "returns" else math.expm1
    return f"{100 * share(change.value):+.1f} % ({100 * share(change.low):+.1f} .. {100 * share(change.high):+.1f})"
