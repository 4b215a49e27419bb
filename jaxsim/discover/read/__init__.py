"""Two folders of polar frames as one comparison.

checks           units, one grid, the same streets under the same names
notes            what is told of two folders that pass
control          what an earlier answer says the simulator lacks by itself
registration     what a registration of two sides is of, and what it says
motion           where the sensor stood, by ranges alone: least squares
stretch          how far ranges are too long, beside that
search           from where all that begins: `register`
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool

from jaxsim.data.polar_frames import PolarFrames, open_polar_frames, scene_of
from jaxsim.discover.model.evidence import Measured
from jaxsim.discover.model.noise_levels import Levels
from jaxsim.discover.read import checks
from jaxsim.discover.read.control import NO_CONTROL, Control
from jaxsim.discover.read.notes import brightness, fading, same_numbers, sceneless, uneven, unpartnered, very_fast
from jaxsim.discover.read.registration import Registration, other_moments, speeds_read
from jaxsim.discover.read.search import register
from jaxsim.effects.rays import Scan
from jaxsim.effects.scan import scan_of
from jaxsim.frame import PolarGrid, PolarImage

MOST_CELLS = 72 * 64 * 1024
"""Most cells that all frames that are read may have: a fit sees RAYS of them however many there are, and these take
about 3 GiB."""
FEWEST_FRAMES = 16
"""So many frames are read however large they are."""


@dataclass(frozen=True)
class Comparison:
    """Simulated and measured frames of the same names on one grid."""

    scan: Scan
    measured: Measured
    names: tuple[str, ...]
    scenes: tuple[str, ...]
    """The scene of each frame."""
    notes: tuple[str, ...] = ()
    """What a reader of the verdict must know of the folders."""
    registration: Registration | None = None
    """The sensor's motion from where the simulator has it."""
    speeds: dict[str, float] | None = None
    """Speed of each scene, m/s, where they are not given and the frames tell them."""
    between_unknown: bool = False
    """Whether it is not known what lies between the surfaces of two rays of a row, for the simulated frames were cast
    again from aside."""
    told: Bool[np.ndarray, "f r n"] | None = None
    """Rays of frames that were cast again of which the simulated frames tell anything; others count on neither side.
    None where all do."""
    lattices: Levels | None = None
    """The simulator's lattices as its frames were read, where they were cast again, for what lies between two readings
    is on none. None where `scan` shows them."""
    as_read: Scan | None = None
    """The simulated frames where they were, of other moments than the measured ones: `scan` is as seen from where these
    stood, and rays whose ranges are of different surfaces count on neither side. None where frames are of one moment.
    """
    own_places: bool = False
    """Whether each simulated frame was brought to where its own partner stood."""
    rest: Rest | None = None
    """The frames that were not read, because so many do not fit into memory."""
    control: Control = NO_CONTROL
    """What the simulator is known to lack by itself: it is in place whatever is asked."""

    @property
    def classless(self) -> bool:
        """Whether the simulated frames tell no classes: all is of one."""
        return len(np.unique(np.asarray(self.scan.semantic))) == 1

    @property
    def other_moments(self) -> bool:
        """Whether frames of one name are of different moments."""
        return self.as_read is not None


@dataclass(frozen=True)
class Rest:
    """Frames of two folders that are yet to be read."""

    simulated: PolarFrames
    measured: PolarFrames
    names: tuple[str, ...]
    first_s: float = 0.0
    """When the first of the frames that were read was taken, from which theirs count."""
    rasters: frozenset[str] = frozenset()
    """What the frames that were read tell besides range and intensity."""

    def scene_of(self, name: str) -> str:
        return scene_of(name, self.measured, self.simulated)

    def sound(self) -> tuple[Rest, tuple[str, ...]]:
        """Gives the frames that can be compared as those that were read, and what is wrong with each of the others."""
        wrong: dict[str, str] = {}
        for name in self.names:
            try:
                _, _, [rasters] = _read([name], self.simulated, self.measured)
            except (ValueError, OSError) as error:
                wrong[name] = str(error)
                continue
            if lacking := self.rasters - {*rasters}:
                wrong[name] = f"{name} of {self.simulated.folder} lacks {', '.join(sorted(lacking))}"
        return replace(self, names=tuple(name for name in self.names if name not in wrong)), tuple(wrong.values())


def read_comparison(simulated: Path, measured: Path) -> Comparison:
    """Reads the frames that two folders of polar frames share. Single ones that are no pair are left out, and a note
    names them.

    Raises ValueError where the grids differ, no names are shared, values have wrong units, frames are empty or most do
    not show the same street, rasters are given for some frames only, or both folders hold the same readings.
    """
    return _read_frames(open_polar_frames(Path(simulated)), open_polar_frames(Path(measured)), left_out={})


def _read_frames(simulated: PolarFrames, measured: PolarFrames, *, left_out: Mapping[str, str]) -> Comparison:
    """Reads the frames that two folders share, but for those that are `left_out`, which says why, by name."""
    grid = simulated.grid
    checks.check_one_grid(simulated, measured)
    names = sorted(({*simulated.names} & {*measured.names}) - {*left_out})
    if not names:
        raise ValueError(
            f"discover: no frame of {simulated.folder} ({', '.join(simulated.names[:3])} ...) has the name of one of "
            f"{measured.folder} ({', '.join(measured.names[:3])} ...); frames of the same name are compared"
        )
    shared = names
    names = thin_frames(names, [scene_of(name, simulated, measured) for name in names], grid=grid)
    read = {*names}
    simulated_images, measured_images, rasters = _read(names, simulated, measured)
    # Some may be alike, where nothing is in reach of the sensor.
    sides = _readings(names, simulated_images), _readings(names, measured_images)
    checks.check_no_copies(simulated, measured, sides=sides, allowed=len(names) - 1)
    if doubles := checks.doubles(sides):
        # One street counts once, under whatever name.
        return _read_frames(simulated, measured, left_out={**left_out, **doubles})
    about = _about(names, simulated, measured)
    # Times count from the first frame that is shared, whether it is read or not. What simulates with the answer counts
    # from its data set's first: the same where the folders hold the recording from its start.
    first_s = min(float(fact.get("time", 0.0)) for fact in _about(shared, simulated, measured))
    unread = tuple(name for name in shared if name not in read)
    rest = Rest(simulated, measured, unread, first_s=first_s, rasters=frozenset(rasters[0]))
    scenes = [scene_of(name, simulated, measured) for name in names]
    scan = _counted_from(first_s, scan_of(grid, simulated_images, rasters, about=about), about)
    measured_rays = _measured(measured_images)
    # Before anything is compared: sides that stand apart would fail every check for other reasons.
    registration = register(scan, measured_rays.range_m, measured_rays.valid, scenes=scenes)
    if no_pairs := checks.check_partners(names, simulated_images, measured_images, registered=registration):
        # What was asked with them (where the sensor stands, which frames are read) is asked again without them.
        return _read_frames(simulated, measured, left_out={**left_out, **no_pairs})
    checks.all_or_none(simulated.folder, names, rasters)
    if "incidence" in rasters[0]:
        checks.check_incidence(names[0], simulated_images[0], angle_rad=rasters[0]["incidence"], grid=grid)
    checks.check_instances(names[0], simulated_images[0], rasters=rasters[0])
    level = brightness(simulated_images, measured_images)
    notes = [
        *(f"left out: {why}" for _, why in sorted(left_out.items())),
        *unpartnered(simulated.names, measured.names),
        *checks.constant_intensity(*([*map(checks.levels_of, side)] for side in (simulated_images, measured_images))),
        *uneven(names, level),
        *fading(scenes, about, level),
        *same_numbers(simulated_images, measured_images),
        *very_fast(np.asarray(scan.speed_mps)),
    ]
    if rest.names:
        notes.append(
            f"{len(names)} of {len(shared)} frames were compared, spread evenly over {len(set(scenes))} scenes"
        )
    for name in names:
        scene = simulated.about.get(name, {}).get("scene")
        other = measured.about.get(name, {}).get("scene")
        if None not in (scene, other) and str(scene) != str(other):
            raise ValueError(
                f"discover: {name} is of scene {scene!r} in {simulated.folder}, of {other!r} in {measured.folder}; "
                "frames of the same name must be a pair"
            )
    if registration.early_or_late:
        notes.append(other_moments(registration, np.asarray(scan.speed_mps)))
    # Speeds that frames say are believed; only where none says any is it read from their distortion.
    speeds = None if any("speed" in fact for fact in about) else registration.speeds(scenes)
    if speeds:
        notes.append(speeds_read(speeds))
        scan = replace(scan, speed_mps=np.array([speeds[scene] for scene in scenes], np.float32))
    return Comparison(
        scan=scan,
        measured=measured_rays,
        names=tuple(names),
        scenes=tuple(scenes),
        notes=(*notes, *sceneless(names, about)),
        registration=registration,
        speeds=speeds,
        rest=rest if rest.names else None,
    )


def read_part(rest: Rest, names: Sequence[str], like: Comparison) -> Comparison:
    """Reads some of the frames that were not read at first, as those of `like` were: with its registration and speeds.

    Raises ValueError for frames that are empty or in wrong units.
    """
    simulated_images, measured_images, rasters = _read(names, rest.simulated, rest.measured)
    checks.all_or_none(rest.simulated.folder, names, rasters)
    scenes = tuple(rest.scene_of(name) for name in names)
    about = _about(names, rest.simulated, rest.measured)
    scan = _counted_from(rest.first_s, scan_of(rest.simulated.grid, simulated_images, rasters, about=about), about)
    if like.speeds:
        # A scene of which no frame was read tells no speed; the others' mean is nearest.
        usual = float(np.mean([*like.speeds.values()]))
        scan = replace(scan, speed_mps=np.array([like.speeds.get(scene, usual) for scene in scenes], np.float32))
    return replace(like, scan=scan, measured=_measured(measured_images), names=tuple(names), scenes=scenes, rest=None)


def _read(
    names: Sequence[str], simulated: PolarFrames, measured: PolarFrames
) -> tuple[list[PolarImage], list[PolarImage], list[Mapping[str, np.ndarray]]]:
    """Reads both sides of frames, and the simulated ones' further rasters. Raises ValueError for what cannot be a
    frame."""
    simulated_images: list[PolarImage] = []
    measured_images: list[PolarImage] = []
    simulated_rasters: list[Mapping[str, np.ndarray]] = []
    measured_rasters: list[Mapping[str, np.ndarray]] = []
    for name in names:
        image, rasters = simulated.read(name)
        checks.plausible(name, image, "simulated")
        simulated_images.append(image)
        simulated_rasters.append(rasters)
        image, rasters = measured.read(name)
        checks.plausible(name, image, "measured")
        measured_images.append(image)
        measured_rasters.append(rasters)
    given = {*chain(*simulated_rasters)}, {*chain(*measured_rasters)}
    checks.check_sides(simulated.folder, measured.folder, rasters=given)
    readings = _readings(names, simulated_images), _readings(names, measured_images)
    checks.check_no_doubles(measured.folder, readings)
    return simulated_images, measured_images, simulated_rasters


def _readings(names: Sequence[str], images: Sequence[PolarImage]) -> dict[str, bytes]:
    return {name: checks.readings_of(image) for name, image in zip(names, images, strict=True)}


def _about(names: Sequence[str], simulated: PolarFrames, measured: PolarFrames) -> list[dict[str, Any]]:
    """Gives what grid.json says of frames. The simulator's own facts win: its frames were made with them."""
    return [{**measured.about.get(name, {}), **simulated.about.get(name, {})} for name in names]


def _counted_from(first_s: float, scan: Scan, about: Sequence[Mapping[str, Any]]) -> Scan:
    """Gives the scan with times since a moment, where `scan_of` counts from the first of its frames."""
    since_s = [float(fact.get("time", 0.0)) - first_s for fact in about]
    return replace(scan, time_s=np.array(since_s, np.float32))


def _measured(images: Sequence[PolarImage]) -> Measured:
    return Measured(*(np.stack([getattr(m, part) for m in images]) for part in ("range_m", "intensity", "valid")))


def thin_frames(names: Sequence[str], scenes: Sequence[str], *, grid: PolarGrid) -> list[str]:
    """Chooses as many frames as MOST_CELLS allow, in order: as many of each scene, spread evenly over it; where there
    are more scenes than that, one frame of scenes that are spread evenly."""
    most = max(FEWEST_FRAMES, MOST_CELLS // (len(grid.elevation_rad) * len(grid.azimuth_rad)))
    if len(names) <= most:
        return list(names)
    of_scene: dict[str, list[str]] = {}
    for name, scene in zip(names, scenes, strict=True):
        of_scene.setdefault(scene, []).append(name)
    visited = [list(of_scene)[k] for k in _evenly(len(of_scene), most)]
    chosen: set[str] = set()
    # Short scenes first: what they leave is for longer ones.
    for done, scene in enumerate(sorted(visited, key=lambda scene: len(of_scene[scene]))):
        frames = of_scene[scene]
        chosen |= {frames[k] for k in _evenly(len(frames), (most - len(chosen)) // (len(visited) - done))}
    return [name for name in names if name in chosen]


def _evenly(count: int, most: int) -> list[int]:
    """Gives at most so many of the numbers 0 to count - 1, from the middle of as many equal parts."""
    parts = min(count, most)
    return [(2 * k + 1) * count // (2 * parts) for k in range(parts)]
