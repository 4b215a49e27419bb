"""Frames of a data set simulated into a folder, by the learned sensor of a run and the effects that it lacks.

OUT/polar             polar frames: grid.json and NAME.npz
OUT/clouds            NAME.bin, .pcd ...
OUT/simulation.json   what they are made with: the learned sensor, the data set and the seed
OUT/sensor.json       the effects that were added, where there are any
"""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import jax
from tqdm import tqdm

from jaxsim.cloud import save_cloud
from jaxsim.data import Dataset
from jaxsim.data.polar_frames import write_frame
from jaxsim.effects.chain import SensorModel
from jaxsim.effects.origin import origin_of
from jaxsim.files import claim, file_of, files_in
from jaxsim.frame import Cloud, Painted, PolarImage
from jaxsim.geometry import polar_to_points
from jaxsim.simulate.announced import Announced
from jaxsim.simulate.frames import check_motion, motion_of, rasters, simulate_batch, take, with_effects
from jaxsim.simulate.sensor import LearnedSensor, Projection


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


OF_NETWORK = 1
"""Tells a frame's draws by the network from those of its effects."""


def simulate_folder(
    learned: LearnedSensor,
    dataset: Dataset,
    positions: Sequence[int],
    *,
    out: Path,
    data: str,
    effects_model: SensorModel | None = None,
    seed: int = 0,
    draws: bool = False,
    projection: Projection = "lidar",
    formats: Sequence[str] = ("bin", "pcd", "ply"),
    batch: int = 8,
    draw: Draw | None = None,
    previews: int = 0,
) -> Speed:
    """Simulates frames of a data set and writes them to `out`; those that are there are not made again.

    `data` says in words what the frames are of. What the effects and, with `draws`, the network leave to chance depends
    leftover = seed if effects_model or draws else None
    claim_frames(out, sensor=learned.fingerprint, data=f"{data}, drawn" if draws else data, seed=leftover)
    are drawn. Raises ValueError where `out` holds frames of another making, and where a frame lacks what the network
    or an effect needs.
    """
    # The folder: one making alone.
    grid, _ = learned.window
    first_s = 0.0
    if effects_model:
        opening = dataset[positions[0]]
        check_motion(effects_model, **motion_of(opening))
        first_s = opening.time_s or 0.0
    claim_effects(out, effects_model)
    claim_frames(
        out,
        sensor=learned.fingerprint,
        data=f"{data}, drawn" if draws else data,
        seed=seed if effects_model or draws else None,
    )
    announced = Announced(out / "polar", grid)
    missing = [p for p in positions if not _is_done(out, dataset.name_of(p), formats, announced=announced)]

    # Batches: the last is filled up, so that one compiled program serves all.
    begun = time.monotonic()
    batches_s = []
    number = already = len(positions) - len(missing)
    with announced, tqdm(total=len(positions), initial=already, unit="frame", desc="simulating") as bar:
        for first in range(0, len(missing), batch):
            chosen = missing[first : first + batch]
            frames = [dataset[position] for position in chosen]
            keys = [jax.random.fold_in(jax.random.key(seed), position) for position in chosen]
            of_network = [jax.random.fold_in(key, OF_NETWORK) for key in keys] if draws else []
            images, painted, seconds = simulate_batch(learned, frames, batch, projection=projection, keys=of_network)
            batches_s.append(seconds)
            announced.add(frames)
            for k, frame in enumerate(frames):
                image, under = take((images, painted), k)
                if effects_model:
                    image = with_effects(
                        effects_model, image, under, grid=grid, key=keys[k], **motion_of(frame, first_s)
                    )
                cloud = polar_to_points(image, grid)
                # The polar frame is written last: where it is, the frame is whole.
                *clouds, _ = _files(out, frame.name, formats)
                for path in clouds:
                    save_cloud(path, cloud)
                if draw and number < previews:
                    draw(frame.name, cloud, image=image, painted=under)
                write_frame(out / "polar", frame.name, image, **rasters(under, grid))
                number += 1
            bar.update(len(frames))
    return Speed(len(missing), already, batch, tuple(batches_s), time.monotonic() - begun)


def _is_done(out: Path, name: str, formats: Sequence[str], *, announced: Announced) -> bool:
    """Whether a frame needs not be made: it is announced, and its files are there."""
    return name in announced.frames and all(path.is_file() for path in _files(out, name, formats))


def _files(out: Path, name: str, formats: Sequence[str]) -> list[Path]:
    """All files of a frame that must be there."""
    clouds = (file_of(out / "clouds", name, f".{suffix}", by="simulate") for suffix in formats)
    return [*clouds, file_of(out / "polar", name, ".npz", by="simulate")]


def claim_frames(out: Path, *, sensor: str, data: str, seed: int | None) -> None:
    """Claims `out` for frames of a trained sensor (its fingerprint), a kind of data set and a seed.

    The seed is None where nothing is left to chance. Raises ValueError where `out` holds frames of another making.
    """
    made = {"sensor": sensor, "data": data, "seed": seed}
    note = "sensor is the fingerprint of a trained one: another run has another, and the same run trained on"
    filled = _has_frames(out)
    claim(out / "simulation.json", made, by="simulate", text=json.dumps(made, indent=2), filled=filled, note=note)


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
    effects = effects_model.effects if effects_model else ()
    own = {name: origin for name, _ in effects if (origin := origin_of(name))}
    plain = {"effects": [name for name, _ in effects], "parameters": [dict(parameters) for _, parameters in effects]}
    learned = effects_model.learned if effects_model else ()
    more = ({"own": own} if own else {}) | ({"learned": [law.to_json() for law in learned]} if learned else {})
    regions = effects_model.regions if effects_model else {}
    more |= {"where": {name: region.to_json() for name, region in regions.items()}} if regions else {}
    return plain | more
