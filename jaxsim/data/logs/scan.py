"""What a source of logs delivers, and what it is asked for; points whose values have names, as PCD, PLY, PointCloud2
and tables have them, as a scan.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxsim.config.ranges import Checked, Columns, Count, Positive
from jaxsim.data.sweeps import Sweep
from jaxsim.files import check_size, first_line
from jaxsim.geometry import LidarSpec

RING = ("ring", "laser_number", "channel", "beam", "beam_id", "line", "laser_id", "laserid", "scan_line", "row")
"""Names of the beam's number in drivers and data sets, the likeliest first."""
TIME = ("t", "time", "timestamp", "offset_time", "offset_ns", "time_offset", "gps_time", "time_stamp", "timeStampNs")
INTENSITY = ("intensity", "reflectivity", "i", "signal", "reflectance")
_CLOUDCOMPARE = "scalar_"


@dataclass(frozen=True)
class LogScan:
    """One turn of a sensor as its log has it, point by point (host memory), before it lies on a grid."""

    name: str
    scene: str
    """The recording."""
    xyz_m: Float[np.ndarray, "n 3"]
    """In the sensor's frame: x forward, y left, z up. Points that are not finite, or at the origin, are no returns."""
    intensity: Float[np.ndarray, " n"]
    """As the log has it; see `full_scale`."""
    ring: Int[np.ndarray, " n"] | None = None
    """The beam's number in the log; None where it has none."""
    shape: tuple[int, int] | None = None
    """Of an organised cloud, whose points lie in rows of so many; its ring may be left out."""
    offset_s: Float[np.ndarray, " n"] | None = None
    """When the point was measured, from the first on."""
    time_s: float | None = None
    full_scale: float | None = None
    """The intensity that becomes 1; None where the format leaves it open."""
    spec: LidarSpec | None = None
    """The sensor's beams, where they are known: `ring` is then their row."""
    columns: int | None = None
    """Firings of a turn, where they are known."""
    mount: Literal["sensor", "fit"] = "sensor"
    """`fit`: the points are in a car's frame, and where the sensor was is told from its rings."""
    is_partial: bool = False
    """Whether the turn is known to have begun before the recording, or to end after it."""
    layers: dict[str, np.ndarray] = field(default_factory=dict)
    """Further values of each point by the names of polar frames: semantic, instance, incidence."""
    fields: tuple[str, ...] = ()
    """Names of a point's values in the log, which are told where one is missed."""

    @property
    def came_back(self) -> Bool[np.ndarray, " n"]:
        """Which points are returns: others are not finite, or at the origin."""
        at_origin = (self.xyz_m == 0).all(axis=1)
        return np.isfinite(self.xyz_m).all(axis=1) & ~at_origin & np.isfinite(self.intensity)

    def only(self, mask: Bool[np.ndarray, " n"]) -> LogScan:
        """The scan with some of its points. It is no longer organised."""
        return replace(
            self,
            xyz_m=self.xyz_m[mask],
            intensity=self.intensity[mask],
            ring=None if self.ring is None else self.ring[mask],
            shape=None,
            offset_s=None if self.offset_s is None else self.offset_s[mask],
            layers={key: value[mask] for key, value in self.layers.items()},
        )


@dataclass(frozen=True)
class LogOptions(Checked):
    """How a log is read."""

    returns: Literal["strongest", "last"] = "strongest"
    """Which return of a firing that has several."""
    intensity: str = ""
    """Field to take as intensity, where a log has several: `reflectivity`, `signal` (Ouster) ... Empty: the one of that
    name, else reflectivity."""
    full_scale: Positive | None = None
    """The log's value that becomes intensity 1. None given: the format's own; where it has none, 255 for bytes, 65535
    for 16-bit numbers, and for other numbers 1 or 255, whichever the first scans stay under."""
    rings: str = ""
    """Beams to take, by their numbers in the log: `0-31` is the upper LiDAR of Argoverse 2, its default. Empty: all."""
    lines: Count | None = None
    """How many beams the sensor has, where the log does not say."""
    sensor: str = ""
    """Preset (`hdl64e`, `hdl32e` ...) whose nearest beam a point is of, where the log has no rings and its points do
    not lie on beams, because the car's motion was taken out: a few points end up a line off."""
    classes: str = ""
    """Of range images: what their numbers of classes are, `semantickitti` for that set's 20, or pairs of a number and a
    Cityscapes class, `0:road,2:building`. Empty: frames have no classes."""
    columns: Columns | None = None
    """Columns of the frames. None given: as many as a beam fires in a turn."""
    mount: Literal["", "sensor", "fit"] = ""
    """`fit`: the points are in a car's frame; where the sensor was is told from its beams. Empty: as the source has
    it."""
    topic: str = ""
    """Of a bag or trace with several: the topic to read."""
    frame: str = ""
    """The frame that points of a bag must be in (`header.frame_id`); others are an error."""
    meta: Path | None = None
    """The sensor's description beside a recording: Ouster's .json, the calibration (.yml) of an HDL-64E, CARLA's
    attributes.json."""
    version: str = "0.9.15"
    """CARLA's version: its tags of classes changed with 0.9.14."""


class Item(NamedTuple):
    """A scan of a log, read when asked for."""

    name: str
    read: Callable[[], LogScan | Sweep]
    files: tuple[Path, ...] = ()
    """What it is read from, where that is not the whole log: once one has changed its frame is made anew."""

    @classmethod
    def of(cls, scan: LogScan | Sweep) -> Item:
        """A scan that is read already."""
        return cls(scan.name, lambda: scan)


class Source(NamedTuple):
    """A family of logs. Others join by entry points of the group `jaxsim.sources`, whose values are Sources."""

    title: str
    takes: Callable[[Path], bool]
    """Whether a path looks like one of the family's; without reading more than its head."""
    items: Callable[[Path, LogOptions], Iterable[Item]]
    """The scans, in order. A source that can only be read from front to back reads them as it is asked for the next."""
    extra: str = ""
    """What to install for it: `pip install 'jaxsim-lidar[EXTRA]'`."""


@contextmanager
def reading(by: str, path: Path, hint: str) -> Iterator[None]:
    """What a library raises on a file that is not what it should be becomes a ValueError that names the file.

    What is no regular file is refused before: a library would wait for ever for somebody who writes into a pipe.
    """
    for file in path.iterdir() if path.is_dir() else (path,):
        if not file.is_dir():
            check_size(file, by=by)
    with naming_log(by, path):
        try:
            yield
        except Exception as error:  # libraries of formats have no common base for their errors
            ours = isinstance(error, ValueError) and str(error).startswith(f"{by}:")
            if ours or isinstance(error, ModuleNotFoundError):
                raise
            words = f"{type(error).__name__}: {first_line(error)}"
            raise ValueError(f"{by}: {path} cannot be read ({words}); {hint}") from error


@contextmanager
def naming_log(by: str, path: Path) -> Iterator[None]:
    """In the block a ValueError names the log: of what is wrong with a scan's values the scan alone is known."""
    try:
        yield
    except ValueError as error:
        if str(path) in str(error):
            raise
        raise ValueError(f"{by}: {path}: {str(error).removeprefix(f'{by}: ')}") from error


def scan_of_fields(
    values: Mapping[str, np.ndarray],
    options: LogOptions,
    *,
    by: str,
    where: str,
    name: str,
    scene: str,
    time_s: float | None = None,
    **more: Any,
) -> LogScan:
    """A scan of arrays by the names of their fields, which drivers and data sets spell as RING, TIME and INTENSITY say.

    `where` is what the errors name. Times in whole numbers are nanoseconds, others seconds. Points that neither came
    back nor have a ring are left out. Raises ValueError where coordinates or intensity are missing.
    """
    missing = [axis for axis in "xyz" if axis not in values]
    if missing:
        raise ValueError(
            f"{by}: {where} has no field {', '.join(missing)}; it has {', '.join(values) or 'none'}: a cloud "
            "has x, y, z"
        )
    key = options.intensity or _name_of(INTENSITY, values)
    if key not in values:
        raise ValueError(
            f"{by}: {where} has no field {key or 'intensity'}; it has {', '.join(values)}: name the one that holds it "
            "with --log.intensity"
        )
    times = values.get(_name_of(TIME, values))
    known: dict[str, Any] = {"full_scale": scale_of(values[key])} | more
    scan = LogScan(
        name=name,
        scene=scene,
        xyz_m=np.stack([values[axis].ravel() for axis in "xyz"], axis=1).astype(np.float32),
        intensity=values[key].ravel().astype(np.float32),
        offset_s=None if times is None else offsets(times.ravel()),
        time_s=time_s,
        fields=tuple(values),
        **known,
    )
    key = _name_of(RING, values)
    if not key:
        return scan
    ring = values[key].ravel()
    if ring.dtype.kind == "f":
        # Organised clouds have a place for rays without return, and some drivers write NaN into all of it.
        told = np.isfinite(ring) | scan.came_back
        scan, ring = (scan, ring) if told.all() else (scan.only(told), ring[told])
        if not np.array_equal(ring, np.round(ring)):
            raise ValueError(
                f"{by}: {where} has rings that are no whole numbers, in its field {key}; is it another field?"
            )
    return replace(scan, ring=ring.astype(np.int64))


def _name_of(known: Iterable[str], fields: Iterable[str]) -> str:
    """The first of the known names that a field has, or has as CloudCompare writes it (`scalar_Gps_Time`); else
    nothing."""
    plain = {_plain(name): name for name in fields if name.startswith(_CLOUDCOMPARE)}
    plain |= {name: name for name in fields}
    return next((plain[name] for one in known for name in (one, _plain(one)) if name in plain), "")


def _plain(name: str) -> str:
    return name.removeprefix(_CLOUDCOMPARE).replace("_", "").lower()


def offsets(times: np.ndarray) -> Float[np.ndarray, " n"]:
    """Seconds from the first: of whole numbers, which are nanoseconds, or of seconds."""
    if not len(times):
        return np.zeros(0, np.float32)
    if times.dtype.kind in "iu":
        return ((times.astype(np.int64) - int(times.min())) * 1e-9).astype(np.float32)
    known = times[np.isfinite(times)]
    return (times.astype(np.float64) - float(known.min() if len(known) else 0)).astype(np.float32)


def scale_of(values: np.ndarray) -> float | None:
    """The largest value that a type of whole numbers holds, where it has one or two bytes; None for any other."""
    return float(np.iinfo(values.dtype).max) if values.dtype.kind == "u" and values.dtype.itemsize <= 2 else None


def ring_of_shape(shape: tuple[int, int], axis: int) -> Int[np.ndarray, " n"]:
    """Ring of an organised cloud's points, which is their index along an axis."""
    return np.broadcast_to(np.arange(shape[axis])[:, None] if axis == 0 else np.arange(shape[1]), shape).ravel()
