"""A log as a folder of polar frames: what `jaxsim frames` does.

OUT/grid.json, OUT/NAME.npz   the frames, as docs/polar-frames.md has them
OUT/log.json                  the log, how it was read, and the sensor that was told from it
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from itertools import chain, islice
from pathlib import Path
from typing import Any

import numpy as np

from jaxsim.data.logs.gridding import FIRST, ScanLayout, infer_layout, to_sweep
from jaxsim.data.logs.scan import Item, LogOptions, LogScan, Source, naming_log
from jaxsim.data.polar_frames import Announced, about_frame, frame_anew, read_grid, write_frame
from jaxsim.data.sweeps import Sweep
from jaxsim.files import CHANGED, claim, file_of, parse_json, placed, read_json, stamp, tell_anew, write_text
from jaxsim.frame import PolarGrid
from jaxsim.geometry import same_grid
from jaxsim.progress import Progress, counted

RECORD = "log.json"
LEAST_TURN = 0.5
"""A turn that fills fewer of the grid's columns is not written."""
TELL_HIDDEN = 1e-3
PARTIAL = "they fill less than half of the columns, as they begin or end within the recording, or lost points"


@dataclass(frozen=True)
class Written:
    """What became of a log."""

    frames: int
    already: int
    partial: int
    """Turns that were begun or ended within the recording, or lost their points, and were passed over."""
    rows: int
    columns: int
    filled: float
    """Share of cells with a return, of the frames that were written."""
    hidden: float
    """Share of firings whose cell holds a nearer one, of the same frames."""
    layout: ScanLayout | None
    """None where the log's frames came with a grid of their own."""

    def words(self, out: Path) -> str:
        """Tells of the frames in `out`, and of the sensor that was told from them."""
        lines = [f"{counted(self.frames, 'frame')} of {self.rows} x {self.columns} cells in {out}"]
        if self.frames:
            lines.append(f"  {100 * self.filled:.1f} % of the cells hold a return")
            if self.hidden > TELL_HIDDEN:
                lines.append(
                    f"  {100 * self.hidden:.1f} % of the returns share a cell with a nearer one, which was kept"
                )
        if self.already:
            lines.append(f"  {self.already} were there")
        if self.partial:
            lines.append(f"  {counted(self.partial, 'turn')} passed over: {PARTIAL}")
        layout = self.layout
        if layout is not None:
            top, bottom = np.rad2deg(layout.beams.elevation_rad[[0, -1]])
            lines.append(
                f"  beams from {top:.2f} to {bottom:.2f} degrees; points miss them by {layout.beams.off_deg:.3f}"
            )
            if layout.beams.ring.min() > 0:
                lines.append(
                    "  rings count from 1, as the first scans have it; if a ring 0 saw nothing in them, give "
                    f"--log.lines {len(layout.beams.ring) + 1}, with another --out"
                )
            lines.append(f"  intensity 0..{layout.full_scale:g} became 0..1")
            if not np.allclose(layout.cloud_from_sensor, np.eye(4)):
                x, y, z = layout.cloud_from_sensor[:3, 3]
                lines.append(f"  the sensor stands at x {x:.2f}, y {y:.2f}, z {z:.2f} m in the log's frame")
        return "\n".join(lines)


def write_log(
    path: Path, kind: str, source: Source, *, out: Path, options: LogOptions, every: int = 1, most: int = 0
) -> Written:
    """Writes the scans of a log to a folder of polar frames; those that are there are not made again, unless their
    files are cut off or what they are read from has changed since; of scans that are no whole turns any more they go.

    Every `every`-th scan is taken, and at most `most` (0: all). The first scans tell the sensor's beams and columns,
    and all frames lie on its grid. Raises ValueError where `out` holds another log's frames, and where scans are
    damaged, share a name, do not tell the sensor, or are no longer those that told it.
    """
    plain = {key: str(value) if isinstance(value, Path) else value for key, value in asdict(options).items()}
    made = json.loads(json.dumps({"log": str(path.resolve()), "kind": kind, "options": plain, "every": every}))
    record = out / RECORD
    claim(
        record,
        made,
        by="frames",
        filled=(out / "grid.json").is_file(),
        read=lambda text: {key: value for key, value in parse_json(text).items() if key != "sensor"},
    )
    items = _chosen(source.items(path, options), every, most)
    grid, layout, items = _begin(record, made, items, options=options, by=kind)
    written, already = 0, 0
    partial = 0
    filled = hidden = 0.0
    names: set[str] = set()
    with Announced(out, grid, by="frames") as announced, Progress(unit="frame", desc="reading") as bar:
        for place, item in enumerate(items):
            bar.update()
            if item.name in names:
                raise ValueError(
                    f"{kind}: {path} holds two scans of the name {item.name}, and a frame is known by its name; give "
                    "the folder of each by itself, with an --out of its own"
                )
            names.add(item.name)
            of = _stamp(item, path, options)
            if item.name in announced.frames and file_of(out, item.name, ".npz", by="frames").is_file():
                why = frame_anew(out, item.name, of)
                if not why:
                    already += 1
                    continue
                if why == CHANGED and place < FIRST:
                    raise ValueError(
                        f"frames: {out} holds {item.name}, and {why}: the sensor's beams were told from it, for all "
                        "frames; delete the folder, and the same command makes them anew, or give another --out"
                    )
                tell_anew({item.name: why}, by="frames")
            with naming_log(kind, path):
                scan = item.read()
                sweep = _sweep(scan, layout, grid, options=options, by=kind)
            is_partial = isinstance(scan, LogScan) and scan.is_partial
            if is_partial or np.asarray(sweep.image.valid).any(axis=0).mean() < LEAST_TURN:
                partial += 1
                announced.remove(item.name)  # of a scan that was whole before
                continue
            write_frame(out, sweep.name, sweep.image, **sweep.rasters, **({"source": of} if of else {}))
            announced.add({sweep.name: about_frame(sweep.scene, time_s=sweep.time_s)})
            written += 1
            filled += float(np.asarray(sweep.image.valid).mean())
            hidden += sweep.hidden
    if not written + already:
        raise ValueError(
            f"{kind}: no whole turn in {path}; {partial} were passed over: {PARTIAL}"
            if partial
            else f"{kind}: {path} holds no scan"
        )
    return Written(
        frames=written,
        already=already,
        partial=partial,
        rows=len(grid.elevation_rad),
        columns=len(grid.azimuth_rad),
        filled=filled / max(written, 1),
        hidden=hidden / max(written, 1),
        layout=layout,
    )


def _chosen(items: Any, every: int, most: int) -> Iterator[Item]:
    return islice(items, 0, most * every if most else None, every)


def _stamp(item: Item, log: Path, options: LogOptions) -> str:
    """The stamp of what a scan is read from: its own files, or the whole log, and what describes the sensor."""
    files = list(item.files)
    if not files:
        files = [log] if log.is_file() else sorted(path for path in log.glob("*") if path.is_file())
    return stamp([*files, options.meta] if options.meta else files)


def _begin(
    record: Path, made: dict[str, Any], items: Iterator[Item], *, options: LogOptions, by: str
) -> tuple[PolarGrid, ScanLayout | None, Iterator[Item]]:
    """The grid and the layout: those of a folder that is gone on with, else told from the first scans."""
    if record.is_file() and (record.parent / "grid.json").is_file():
        grid, _ = read_grid(record.parent)
        layout_before = read_json(record, by="frames").get("sensor")
        return (
            grid,
            None if layout_before is None else ScanLayout.from_json(layout_before, grid, where=f"frames: {record}"),
            items,
        )
    with naming_log(by, Path(made["log"])):
        first = [(item, item.read()) for item in islice(items, FIRST)]
        if not first:
            raise ValueError(f"{by}: {made['log']} holds no scan")
        scans = [scan for _, scan in first if isinstance(scan, LogScan)]
        layout = infer_layout([_of_rings(scan, options) for scan in scans], options, by=by) if scans else None
    grid = layout.grid if layout else next(scan.grid for _, scan in first if isinstance(scan, Sweep))
    write_text(record, json.dumps(made | {"sensor": layout.to_json() if layout else None}, indent=1))
    again = (item._replace(read=lambda scan=scan: scan) for item, scan in first)
    return grid, layout, chain(again, items)


def log_of(folder: Path) -> Path | None:
    """The log that a folder's frames were read from, where log.json tells it and it is there."""
    record = folder / RECORD
    if not record.is_file():
        return None
    with placed(f"frames: {record} does not tell its `log`", KeyError, TypeError):
        log = Path(read_json(record, by="frames")["log"])
    return log if log.exists() else None


def _sweep(scan: LogScan | Sweep, layout: ScanLayout | None, grid: PolarGrid, *, options: LogOptions, by: str) -> Sweep:
    if isinstance(scan, LogScan):
        if layout is None:
            raise ValueError(f"{by}: {scan.name} is a cloud, and the scans before had a grid of their own")
        return to_sweep(_of_rings(scan, options), layout, options, by=by)
    ignored = [name for name in ("rings", "lines", "sensor", "mount") if getattr(options, name)]
    if ignored:
        raise ValueError(
            f"{by}: --log.{ignored[0]} is for logs of points, and {scan.name} comes on the grid of its sensor's own "
            "beams; leave it out"
        )
    if options.columns not in (None, columns := len(scan.grid.azimuth_rad)):
        raise ValueError(
            f"{by}: --log.columns is {options.columns}, and {scan.name} comes on the {columns} columns of its sensor's "
            "own firings; leave it out"
        )
    if not same_grid(scan.grid, grid):
        raise ValueError(
            f"{by}: the beams or columns of {scan.name} are not those of the first scan; write each sensor, and each "
            "mode, to a folder of its own"
        )
    return scan


def _of_rings(scan: LogScan, options: LogOptions) -> LogScan:
    """The points of the rings that were asked for, which count from 0 now, and so do the beams where they are known.
    Raises ValueError where there are none, or one beam alone."""
    if not options.rings:
        return scan
    low, _, high = options.rings.partition("-")
    if not (low.isdecimal() and (high or low).isdecimal()):
        raise ValueError(f"frames: --log.rings is {options.rings!r}; give two numbers, as 0-31")
    if scan.ring is None:
        raise ValueError(f"frames: --log.rings was given, and {scan.name} has no rings")
    first, last = int(low), int(high or low)
    chosen = (scan.ring >= first) & (scan.ring <= last)
    if not chosen.any():
        raise ValueError(
            f"frames: {scan.name} has no point of rings {options.rings}; it has {scan.ring.min()}..{scan.ring.max()}"
        )
    spec = scan.spec and replace(
        scan.spec,
        elevation_deg=scan.spec.elevation_deg[first : last + 1],
        origin_m=scan.spec.origin_m[first : last + 1],
    )
    if spec is not None and spec.rows < 2:
        raise ValueError(
            f"frames: --log.rings is {options.rings!r}, one beam of {scan.name}; give two or more, as 0-31"
        )
    return replace(scan.only(chosen), ring=scan.ring[chosen] - first, spec=spec)
