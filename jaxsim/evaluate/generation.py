"""LiDAR generation metrics between two folders: polar frames, or clouds (.bin as KITTI has them, .npz as ours).

No cloud is kept. What adds up over frames (Jensen-Shannon divergences, tables of intensity, Chamfer distances of frames
of the same name) is taken of all. What holds each frame against each other, or sorts all at once (MMD, sliced
Wasserstein and Fréchet distances), grows faster than the folder, and is taken of COMPARED frames of it, evenly spaced.
"""

from __future__ import annotations

import logging
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Float, Int

from jaxsim.cloud import points_of
from jaxsim.data.clouds import SUFFIXES, cloud_files, read_cloud
from jaxsim.data.polar_frames import PolarFrames, open_polar_frames
from jaxsim.files import files_in, placed
from jaxsim.frame import Array, PolarGrid, PolarImage
from jaxsim.geometry import incidence, pad_points, polar_to_points, room_for, same_grid
from jaxsim.metrics import Score
from jaxsim.metrics.bev import BINS, COUNTS, jensen_shannon, lidm_occupancy, mmd
from jaxsim.metrics.chamfer import Chamfer, chamfer
from jaxsim.metrics.conditional import conditional_intensity, intensity_table
from jaxsim.metrics.frechet import frechet_distance_of
from jaxsim.metrics.rangenet import Kernels, range_features
from jaxsim.metrics.sliced_wasserstein import sliced_wasserstein
from jaxsim.progress import Progress

_log = logging.getLogger(__name__)

BATCH, POINTS = 8, 2**14
"""Clouds of a batch, and the multiple that they are padded to."""
COMPARED = 1000
"""Frames of a folder that are held against each other: 80 MB of histograms."""


@dataclass(frozen=True)
class Folder:
    """Frames of one folder, read when asked for."""

    path: Path
    names: tuple[str, ...]
    frames: PolarFrames | None
    """None: a folder of clouds."""
    clouds: Mapping[str, Path] = field(default_factory=dict)
    """Files of such a folder by name."""

    @property
    def grid(self) -> PolarGrid | None:
        """The grid of polar frames; None in a folder of clouds."""
        return self.frames and self.frames.grid

    def image(self, name: str) -> tuple[PolarImage, dict[str, np.ndarray]]:
        """A polar frame and its further rasters. Raises ValueError where its raster is not the grid's."""
        assert self.frames is not None
        return self.frames.read(name)

    def points(self, name: str) -> Float[np.ndarray, "n 4"]:
        """Rows x, y, z (m), intensity (0..1; 0 where a cloud has none)."""
        if self.frames is not None:
            return points_of(polar_to_points(self.image(name)[0], self.frames.grid))
        points = read_cloud(self.clouds[name])
        return points if points.shape[1] == 4 else np.pad(points, ((0, 0), (0, 1)))


def open_folder(path: Path) -> Folder:
    """A folder of polar frames (with grid.json) or of clouds. Raises ValueError where it is neither."""
    polar = (path / "grid.json").is_file()
    files = {file.stem: file for file in (files_in(path, *SUFFIXES) if polar else cloud_files(path))}
    if not files:
        raise ValueError(
            f"generation: {path} holds no frames; give a folder of polar frames (grid.json, NAME.npz; `jaxsim "
            "discover --help` tells the format) or of clouds (.bin with x, y, z, intensity float32, or .npz with xyz)"
        )
    if polar:
        frames = open_polar_frames(path)
        return Folder(path, frames.names, frames)
    return Folder(path, tuple(files), None, clouds=files)


def spaced(names: Sequence[str], most: int) -> list[str]:
    """At most so many of the names, evenly spaced, the first and the last among them."""
    places = np.linspace(0, len(names) - 1, min(most, len(names)))
    return [names[int(place.round())] for place in places]


def _batches(folder: Folder, names: Sequence[str]) -> Iterator[tuple[Sequence[str], np.ndarray, np.ndarray]]:
    """Names, (b, n, 4) points and (b, n) which of them are real."""
    for first in range(0, len(names), BATCH):
        chosen = names[first : first + BATCH]
        clouds = [folder.points(name) for name in chosen]
        room = room_for(max(map(len, clouds)), POINTS)
        padded = [pad_points(cloud, room) for cloud in clouds]
        yield chosen, np.stack([points for points, _ in padded]), np.stack([real for _, real in padded])


class _Histograms(NamedTuple):
    """Of a folder's frames, seen from above, by definition."""

    each: dict[str, np.ndarray]
    """(n, 100, 100), of the frames that are compared."""
    total: dict[str, np.ndarray]
    """(100, 100), of all frames."""
    occupied: np.ndarray
    """(2000, 2000), of all frames: how many have a point in each of LiDAR-Diffusion's cells."""


def _histograms(folder: Folder, compared: Collection[str]) -> _Histograms:
    each: dict[str, list[np.ndarray]] = {name: [] for name in COUNTS}
    total = {name: np.zeros((BINS, BINS)) for name in COUNTS}
    occupied = lidm_occupancy([])
    with Progress(total=len(folder.names), desc=f"seen from above: {folder.path.name}", unit="frame") as bar:
        for names, points, valid in _batches(folder, folder.names):
            chosen = [name in compared for name in names]
            for definition, count in COUNTS.items():
                histograms = np.asarray(count(points[..., :3], valid))
                each[definition].append(histograms[chosen])
                if not (held := histograms[chosen].any((1, 2))).all():
                    name = np.array(names)[chosen][~held][0]
                    raise ValueError(
                        f"generation: {folder.path / name} has no point within the ranges of {definition}'s "
                        "definition; leave it out of both folders"
                    )
                # float32 would stop counting at 2^24 points a cell.
                total[definition] += histograms.sum(0, dtype=np.float64)
            occupied += lidm_occupancy(cloud[real, :3] for cloud, real in zip(points, valid, strict=True))
            bar.update(len(names))
    return _Histograms({name: np.concatenate(parts) for name, parts in each.items()}, total, occupied)


def _bev(a: Folder, b: Folder, compared: int) -> dict[str, Score]:
    first = _histograms(a, {*spaced(a.names, compared)})
    second = _histograms(b, {*spaced(b.names, compared)})
    # A distance rests on the smaller of the two folders.
    count = min(len(a.names), len(b.names))
    scores = {}
    for name in COUNTS:
        scores[f"{name}_jsd"] = Score(jensen_shannon(first.total[name], second.total[name]), "1", count)
        value = mmd(first.each[name], second.each[name], definition=name)
        scores[f"{name}_mmd"] = Score(value, "1", min(count, compared))
    return scores | {"lidm_jsd": Score(jensen_shannon(first.occupied, second.occupied), "1", count)}


@dataclass(frozen=True)
class _Pictures:
    """Range (logarithmic, 0..1 at 63 m; 0 where nothing returned) and intensity of frames, read when asked for."""

    folder: Folder
    names: Sequence[str]

    @property
    def shape(self) -> tuple[int, ...]:
        grid = self.folder.grid
        assert grid is not None
        return len(self.names), len(grid.elevation_rad), len(grid.azimuth_rad), 2

    def __getitem__(self, chosen: slice) -> np.ndarray:
        pictures = []
        for name in self.names[chosen]:
            image, _ = self.folder.image(name)
            # log2(63 + 1) = 6: the scale ends at 63 m, and near ranges take most of it.
            log = np.clip(np.log2(image.range_m + 1) / 6, 0, 1)
            pictures.append(np.where(image.valid[..., None], np.stack([log, image.intensity], -1), 0))
        return np.stack(pictures).astype(np.float32)


@jax.jit
def _counted(image: PolarImage, semantic: Int[Array, "b r c"], grid: PolarGrid) -> Int[Array, "34 8 9 101"]:
    """The table of intensity of a batch of frames."""
    angle, known = incidence(image.range_m, image.valid, grid)
    return intensity_table(
        image.intensity, image.range_m, angle, incidence_known=known, semantic=semantic, valid=image.valid
    )


def _tables(a: Folder, b: Folder) -> tuple[np.ndarray, np.ndarray, bool]:
    """Tables of intensity of both folders, and whether they have classes.

    Angles come from each side's own range image. A frame without classes takes those of its namesake.
    """
    shared = {*a.names} & {*b.names} if a.grid and b.grid and same_grid(a.grid, b.grid) else set()
    tables, classes = [], True
    for folder, other in ((a, b), (b, a)):
        assert folder.grid is not None
        # A batch's counts fit 32 bits, those of a folder may not.
        table = np.zeros((), np.int64)
        with Progress(total=len(folder.names), desc=f"intensities: {folder.path.name}", unit="frame") as bar:
            for first in range(0, len(folder.names), BATCH):
                images, labels = [], []
                for name in folder.names[first : first + BATCH]:
                    image, columns = folder.image(name)
                    semantic = columns.get("semantic")
                    if semantic is None and name in shared:
                        # Frames of one name and grid see the same street: what stands there has one class.
                        semantic = other.image(name)[1].get("semantic")
                    classes = classes and semantic is not None
                    labels.append(np.zeros(image.valid.shape, np.int32) if semantic is None else semantic)
                    images.append(image)
                stacked = jax.tree.map(lambda *rasters: np.stack(rasters), *images)
                table = table + np.asarray(_counted(stacked, np.stack(labels).astype(np.int32), folder.grid))
                bar.update(len(images))
        tables.append(table)
    return tables[0], tables[1], classes


def _chamfer(a: Folder, b: Folder, name: str) -> Chamfer:
    """Distances of the frames of one name. Raises ValueError, with the name, where one has no points."""
    clouds = [folder.points(name)[:, :3] for folder in (a, b)]
    with placed(f"generation: {name}"):
        return chamfer(*clouds)


def generation_scores(
    a: Folder, b: Folder, *, rangenet: Kernels | None = None, compared: int = COMPARED
) -> dict[str, Score]:
    """Every metric that these folders allow (`a` simulated, `b` measured): name -> value, unit, frames or rays.

    Polar frames on one grid have all; clouds have the bird's-eye-view and Chamfer distances. Chamfer distances are
    of frames of the same name. With RangeNet's values also the Fréchet distance over range images. MMD, sliced
    Wasserstein and Fréchet distances are taken of at most `compared` frames of each folder, evenly spaced. Warns where
    frames of one name have the same points.
    """
    scores = _bev(a, b, compared)
    shared = sorted({*a.names} & {*b.names})
    if shared:
        named = Progress(shared, desc="frames of the same name", unit="frame")
        pairs = [_chamfer(a, b, name) for name in named]
        if same := [name for name, pair in zip(shared, pairs, strict=True) if pair.distance_m == 0]:
            _log.warning(
                f"generation: the points of {len(same)} of {len(shared)} frames of one name are the same in {a.path} "
                f"and {b.path} (the first: {same[0]}): by that alone their distances are 0; intensities may differ. Is "
                "one folder a copy of the other?"
            )
        for name, unit in (("distance_m", "m"), ("square_m2", "m2"), ("density_aware", "1")):
            value = float(np.mean([getattr(pair, name) for pair in pairs]))
            scores[f"chamfer_{name}"] = Score(value, unit, len(pairs))
    if rangenet is not None:
        features = []
        for folder in (a, b):
            names = spaced(folder.names, compared)
            batches = Progress(_batches(folder, names), total=-(-len(names) // BATCH), desc="RangeNet", unit="batch")
            features.append(range_features(rangenet, ((p[..., :3], p[..., 3], valid) for _, p, valid in batches)))
        scores["frechet_rangenet53"] = Score(frechet_distance_of(*features), "1", min(map(len, features)))
    if a.grid is None or b.grid is None:
        return scores
    if same_grid(a.grid, b.grid) and min(len(a.grid.elevation_rad), len(a.grid.azimuth_rad)) >= 16:
        count = min(len(a.names), len(b.names), compared)
        # Of the same frames where there are enough, so that streets do not count as a difference of sensors.
        both = (shared, shared) if len(shared) >= count else (a.names, b.names)
        swd = sliced_wasserstein(*(_Pictures(f, spaced(n, count)) for f, n in zip((a, b), both, strict=True)))
        scores |= {name: Score(value, "1", count) for name, value in swd.items()}
    first, second, classes = _tables(a, b)
    for name, score in conditional_intensity(first, second, classes=classes).items():
        scores[name] = Score(score.distance, "intensity", score.rays)
        scores[f"{name}_floor"] = Score(score.floor, "intensity", score.rays)
    return scores
