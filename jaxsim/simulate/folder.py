"""Frames of a data set simulated into a folder, by the learned sensor of a run and the effects that it lacks.

OUT/polar             polar frames: grid.json and NAME.npz
OUT/clouds            NAME.bin, .pcd ...
OUT/previews          pictures of the first frames
OUT/simulation.json   what they are made with: the learned sensor, the data set and the seed
OUT/sensor.json       the effects that were added, where there are any
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal, NamedTuple, Protocol, runtime_checkable

import jax

from jaxsim.cloud import save_cloud
from jaxsim.config import DataConfig
from jaxsim.data import Dataset
from jaxsim.data.polar_frames import Announced, about_frame, frame_anew, write_frame
from jaxsim.effects.chain import SensorModel
from jaxsim.files import claim, file_of, files_in, parse_json, stamp_of, tell_anew
from jaxsim.frame import Array, Cloud, Frame, Painted, PolarImage
from jaxsim.geometry import polar_to_points
from jaxsim.prefetch import prefetch
from jaxsim.progress import Progress, check_all_done, counted
from jaxsim.simulate.frames import BATCH, begin_of, check_motion, motion_of, rasters, simulate_batch, take, with_effects
from jaxsim.simulate.grain import Grain
from jaxsim.simulate.learned_sensor import LearnedSensor, Projection

CloudFormat = Literal["bin", "pcd", "ply", "npz"]


@runtime_checkable
class Draw(Protocol):
    """Pictures of a frame: of its cloud, of what the sensor reports, and of what the camera's rasters show."""

    def __call__(self, name: str, cloud: Cloud, *, image: PolarImage, painted: Painted) -> None: ...


@dataclass(frozen=True)
class Speed:
    """How many frames were simulated, and how long it took."""

    simulated: int
    already: int
    """Frames that were there."""
    batch: int
    batches_s: tuple[float, ...]
    """Seconds of each batch from dense views to results."""
    total_s: float
    """Seconds of all, with loading, compiling and writing."""

    @property
    def frames_per_s(self) -> float | None:
        """Frames a second of the simulation alone; None where there was one batch.

        The first batch is left out, for it waits for the compiler. The last counts as full: it was computed so.
        """
        if len(self.batches_s) < 2:
            return None
        return self.batch * (len(self.batches_s) - 1) / sum(self.batches_s[1:])

    def words(self, out: Path, *, workers: bool = False) -> str:
        """Tells what is in `out`, how fast the simulation is, and how long all took with what else it does; of
        `workers` that share it only how fast they are together."""
        text = f"{counted(self.simulated, 'frame')} simulated, {self.already} were there: {out}"
        if not self.simulated:
            return text
        total = f"{self.total_s:.1f} s in all, with loading, compiling and writing"
        rate = self.frames_per_s
        if workers:
            return f"{text}\n{self.simulated / self.total_s:.2f} frames/s; {total}"
        if rate is None:
            why = "the simulation's own speed shows from the second batch on (a smaller --batch, more --frames)"
            return f"{text}\n{total}; {why}"
        return f"{text}\nsimulation alone {rate:.2f} frames/s (after the first batch); {total}"


Simulated = tuple[PolarImage, Painted, float]
"""What the sensor reports of a batch, what was painted of its views, and the seconds that both took."""
OF_NETWORK = 1
"""Tells a frame's draws by the network from those of its effects."""


class FrameBatch(NamedTuple):
    """Frames that are simulated together, by their places in the data set."""

    positions: tuple[int, ...]
    drawn: frozenset[int]
    """Which of these places have pictures drawn of their frames."""
    first_s: float
    """Time of the data set's first frame, which effects that drift count from."""
    sources: tuple[str, ...] = ()
    """Stamps of the files that the frames are read from, none of frames that have no files."""

    def part(self, chosen: Sequence[int]) -> FrameBatch:
        """Gives the batch with some of its frames alone."""
        sources = tuple(self.sources[k] for k in chosen) if self.sources else ()
        return self._replace(positions=tuple(self.positions[k] for k in chosen), sources=sources)


class MadeBatch(NamedTuple):
    """What became of a batch."""

    about: dict[str, dict[str, Any]]
    """What grid.json says of its frames, by name."""
    seconds: float
    """From dense views to results."""


@dataclass(frozen=True)
class FrameMaker:
    """Simulates frames of a data set, and writes them to `out`."""

    learned: LearnedSensor
    dataset: Dataset
    out: Path
    effects_model: SensorModel | None = None
    seed: int = 0
    """What the effects and, with `draws`, the network leave to chance depends on it and on a frame's place."""
    draws: bool = False
    grain: Grain | None = None
    """How the cells of a draw scatter together; none: each for itself."""
    projection: Projection = "lidar"
    formats: tuple[CloudFormat, ...] = ("bin", "pcd", "ply")
    batch: int = BATCH
    """Frames simulated at once: fewer are filled up, so that one compiled program serves all."""
    draw: Draw | None = None

    def __call__(self, chosen: FrameBatch) -> MadeBatch:
        frames = [self.dataset[position] for position in chosen.positions]
        return self.write(chosen, frames, self.simulate(chosen, frames))

    def simulate(self, chosen: FrameBatch, frames: Sequence[Frame]) -> Simulated:
        """What the network says of them."""
        of_network = [jax.random.fold_in(key, OF_NETWORK) for key in self.keys(chosen)] if self.draws else []
        how = {"projection": self.projection, "grain": self.grain}
        return simulate_batch(self.learned, frames, self.batch, keys=of_network, **how)

    def words(self, data: str) -> str:
        """The words `data` and, where frames are drawn, how. A folder is claimed by them, so that frames of the most
        likely answer, of draws cell by cell, and of draws with one grain or another never mix."""
        if not self.draws:
            return data
        return f"{data}, drawn" + (f", grain {self.grain.fingerprint}" if self.grain else "")

    def keys(self, chosen: FrameBatch) -> list[Array]:
        """What leaves a frame to chance, one a frame."""
        # By the frame's place, not its turn: a resumed folder, or one made by several, draws the same.
        return [jax.random.fold_in(jax.random.key(self.seed), position) for position in chosen.positions]

    def write(self, chosen: FrameBatch, frames: Sequence[Frame], simulated: Simulated) -> MadeBatch:
        """Puts the effects on them, and writes their files."""
        images, painted, seconds = simulated
        keys = self.keys(chosen)
        grid, _ = self.learned.window
        for k, (frame, position) in enumerate(zip(frames, chosen.positions, strict=True)):
            image, under = take((images, painted), k)
            if self.effects_model:
                motion = motion_of(frame, chosen.first_s)
                image = with_effects(self.effects_model, image, under, grid=grid, key=keys[k], **motion)
            cloud = polar_to_points(image, grid)
            # The polar frame is written last: where it is, the frame is whole.
            *clouds, _ = _files(self.out, frame.name, self.formats)
            for path in clouds:
                save_cloud(path, cloud)
            if self.draw and position in chosen.drawn:
                self.draw(frame.name, cloud, image=image, painted=under)
            source = {"source": chosen.sources[k]} if chosen.sources and chosen.sources[k] else {}
            write_frame(self.out / "polar", frame.name, image, **rasters(under, grid), **source)
        return MadeBatch({frame.name: about_frame(frame.scene, **motion_of(frame, 0.0)) for frame in frames}, seconds)


SpreadBatches = Callable[[Sequence[FrameBatch]], Iterator[MadeBatch]]


def simulate_folder(
    maker: FrameMaker,
    positions: Sequence[int],
    *,
    source: DataConfig,
    previews: int = 0,
    spread: SpreadBatches | None = None,
) -> Speed:
    """Simulates the frames at these positions of the maker's data set; those that are there are not made again, unless
    their files are cut off or the data set's have changed since.

    `source` are the settings of that data set. Pictures are drawn of the first `previews`. `spread` has batches made
    elsewhere, by the same maker, and gives what became of each as it is done. Raises ValueError where `out` holds
    frames of another making, where a frame lacks what the network or an effect needs, and, once the others are made,
    for frames that cannot be read.
    """
    # The folder: one making alone.
    out, dataset = maker.out, maker.dataset
    effects_model = maker.effects_model
    grid, _ = maker.learned.window
    first_s = 0.0
    if effects_model:
        first_s = begin_of(dataset)
        # Refused before the folder is claimed, not at the first frame that is written.
        if first := _first_read(dataset, positions):
            check_motion(effects_model, **motion_of(first, first_s))
    claim_effects(out, effects_model)
    claim_frames(
        out,
        fingerprint=maker.learned.fingerprint,
        data=maker.words(data_words(source, maker.projection)),
        seed=maker.seed if effects_model or maker.draws else None,
        source=source.of_frames,
    )
    announced = Announced(out / "polar", grid, order=[dataset.name_of(position) for position in positions])
    batches = _missing_batches(maker, positions, announced.frames, previews=previews, first_s=first_s)

    # Batches.
    begun = time.monotonic()
    missing = sum(len(batch.positions) for batch in batches)
    already = len(positions) - missing
    batches_s = []
    failures: list[str] = []
    with announced, Progress(total=len(positions), initial=already, unit="frame", desc="simulating") as bar:
        for made in (spread or partial(_overlapped, maker, failures=failures))(batches):
            announced.add(made.about)
            batches_s.append(made.seconds)
            bar.update(len(made.about))
    check_all_done(failures, missing, by="simulate")
    return Speed(missing, already, maker.batch, tuple(batches_s), time.monotonic() - begun)


def _first_read(dataset: Dataset, positions: Sequence[int]) -> Frame | None:
    """The first of these frames that can be read; None where none can, of which `simulate_folder` tells."""
    for position in positions:
        with suppress(ValueError, OSError):
            return dataset[position]
    return None


def _missing_batches(
    maker: FrameMaker, positions: Sequence[int], announced: Container[str], *, previews: int, first_s: float
) -> list[FrameBatch]:
    """The frames that are to be made, in batches: all but those that are announced, whole and of files that have not
    changed since, and, of the first `previews`, drawn."""
    out, dataset = maker.out, maker.dataset
    names = [dataset.name_of(position) for position in positions]
    there = [
        name for name in names if name in announced and all(path.is_file() for path in _files(out, name, maker.formats))
    ]
    sources = {name: stamp_of(dataset, position) for name, position in zip(names, positions, strict=True)}
    anew = {name: why for name in there if (why := _anew(out, name, maker.formats, source=sources[name]))}
    tell_anew(anew, by="simulate")
    # Of a frame whose pictures nobody asked for before, what they show is simulated again.
    undrawn = {name for name in names[:previews] if not all(path.is_file() for path in pictures_of(out, name))}
    done = {*there} - {*anew} - undrawn
    missing = [position for position, name in zip(positions, names, strict=True) if name not in done]
    drawn = frozenset(missing) & {*positions[:previews]}
    return [
        FrameBatch(tuple(chosen), drawn & {*chosen}, first_s, tuple(sources[dataset.name_of(k)] for k in chosen))
        for chosen in (missing[first : first + maker.batch] for first in range(0, len(missing), maker.batch))
    ]


def data_words(source: DataConfig, projection: Projection = "lidar") -> str:
    """What frames are of, in words: the kind of data set, and what else is unlike a run's own."""
    unlike = [f"LiDAR in the {source.lidar}"] * (source.kind == "vkitti2" and source.lidar != "kitti")
    unlike += ["not projected"] * (projection == "none")
    return ", ".join([source.kind, *unlike])


def _overlapped(maker: FrameMaker, batches: Sequence[FrameBatch], *, failures: list[str]) -> Iterator[MadeBatch]:
    """What became of each batch, in their order: while one is simulated the next is read, and the last is written.
    Frames that cannot be read are left out, and told to `failures`."""

    def read(batch: FrameBatch) -> tuple[FrameBatch, list[Frame]]:
        frames: dict[int, Frame] = {}
        for k, position in enumerate(batch.positions):
            try:
                frames[k] = maker.dataset[position]
            except (ValueError, OSError) as error:
                failures.append(str(error))
        return batch.part([*frames]), [*frames.values()]

    with ThreadPoolExecutor(1) as reader, ThreadPoolExecutor(1) as writer:
        whole = (one for one in prefetch(reader, read, batches) if one[1])
        simulated = ((batch, frames, maker.simulate(batch, frames)) for batch, frames in whole)
        yield from prefetch(writer, lambda parts: maker.write(*parts), simulated)


def _anew(out: Path, name: str, formats: Sequence[str], *, source: str) -> str:
    """Why a frame that is there is to be made anew, in words; empty where it may stay."""
    if "bin" in formats and file_of(out / "clouds", name, ".bin", by="simulate").stat().st_size % 16:
        return "its cloud is cut off"
    return frame_anew(out / "polar", name, source)


def _files(out: Path, name: str, formats: Sequence[str]) -> list[Path]:
    """All files of a frame that must be there."""
    clouds = (file_of(out / "clouds", name, f".{suffix}", by="simulate") for suffix in formats)
    return [*clouds, file_of(out / "polar", name, ".npz", by="simulate")]


def pictures_of(out: Path, name: str) -> tuple[Path, Path]:
    """Where a frame's pictures lie: that of its cloud, and that of its rasters."""
    of_cloud = file_of(out / "previews", name, "_cloud.png", by="simulate")
    return of_cloud, file_of(out / "previews", name, ".png", by="simulate")


def claim_frames(out: Path, *, fingerprint: str, data: str, seed: int | None, source: Mapping[str, Any]) -> None:
    """Claims `out` for frames of a trained sensor (its `fingerprint`), a kind of data set, `source`, which is what its
    frames depend on (`DataConfig.of_frames`), and a seed.

    The seed is None where nothing is left to chance. Raises ValueError where `out` holds frames of another making. A
    record of before that names no source is taken for this one's.
    """
    # As the file gives it back: what is compared with it must have lists for tuples.
    made = json.loads(json.dumps({"sensor": fingerprint, "data": data, "seed": seed, "source": source}))
    claim(
        out / "simulation.json",
        made,
        by="simulate",
        text=json.dumps(made, indent=2),
        filled=_has_frames(out),
        read=lambda record: {"source": made["source"]} | parse_json(record),
        note="sensor is the fingerprint of a trained one: another run has another, and the same run trained on",
    )


def claim_effects(out: Path, effects_model: SensorModel | None) -> None:
    """Claims `out` for frames with these effects, which are kept in OUT/sensor.json; no model is no file.

    Raises ValueError where `out` holds frames with other effects.
    """
    path = out / "sensor.json"
    claim(
        path,
        _plain(effects_model),
        by="simulate",
        filled=_has_frames(out) or path.is_file(),
        read=lambda _: _plain(SensorModel.load(path)),
        unsaid=_plain(None),
    )
    if effects_model is not None and not path.is_file():
        effects_model.save(path)


def _has_frames(out: Path) -> bool:
    return bool(files_in(out / "polar", ".npz"))


def _plain(effects_model: SensorModel | None) -> dict[str, Any]:
    """Names and parameters of the effects, as in sensor.json but each by itself."""
    model = effects_model or SensorModel()
    names = [name for name, _ in model.effects]
    return {"effects": names, "parameters": [dict(given) for _, given in model.effects], **model.optional()}
